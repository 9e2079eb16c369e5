"""The workshop: its packages are installed under their own names.

Only ``shop.tests`` and ``shop.examples`` belong here.
"""
