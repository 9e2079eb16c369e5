"""Part programs for a lathe's control: write, read and play them.

Override laws made from controllers belong in ``train/nc``, which the wheel does not contain.
"""
