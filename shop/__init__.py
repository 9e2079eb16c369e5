"""The workshop: its packages are installed under their own names; only `shop.tests` and `shop.examples` belong here."""
