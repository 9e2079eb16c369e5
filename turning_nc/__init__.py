"""Part programs for a lathe's control: write, read, play and adapt them.

``read``, ``write`` and ``simulate`` hold the programs that the project writes; ``blocks`` to ``adapt`` read those of users.

Override laws made from controllers belong in ``train/nc``, which the wheel does not contain.
"""
