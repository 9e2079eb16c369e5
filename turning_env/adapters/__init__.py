"""Adapters that give other libraries the batch, one file per library; each file imports its library.

No other file imports these, so ``import turning_env`` stays light.
"""
