"""Part programs from policies: the command line, the override laws of controllers, the interval table of the grid search.

Programs as such (read, write, play) belong in ``turning_nc``.
"""
