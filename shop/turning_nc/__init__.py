"""Part programs for a lathe's control: read, play, adapt and write them.

``dialects`` (data), ``words``, ``modal`` and ``moves`` read every program; ``stock`` to ``report`` play and adapt those of users;
``program`` to ``simulate`` write and play the project's own. Policies come from the caller, as in ``shop/turning_nc/export_law.py``.
"""
