"""Part programs for a lathe's control: write, read and play them.

Controllers' override laws belong to the clone (``train/nc``), beside the controllers that they come from.
"""
