"""Adapters that give the batch to other libraries, one file each, which imports its library.

No other file imports these, so ``import turning_env`` stays light.
"""
