"""Part programs for a lathe's control: read, play, adapt and write them.

``dialects`` (data), ``words``, ``modal`` and ``moves`` read every program. ``stock``, ``removal``,
``cutting``, ``report`` and ``adapt`` play and adapt them.
"""

from turning_shop.extras import register

register()
