"""Shift splits: ``RoughTurning-v0`` on lots, tools, sensors and steels other than those that its controllers were made for.

On the first four the controller is told what it is told on RoughTurning-v0, and the lot differs (``sections.Mismatch``). On the last
two it is told another diameter and another steel, but nothing was tuned or trained on them. All are to be played by controllers
that are built with ``Scenario.nominal()``. Values and why: ``docs/choices.md``.
"""

SPLITS = ("harder_lot", "forging_skin", "worn_lot", "sensor_bias", "small_diameter", "ck45")
"""Presets' names, in the order in which they are reported."""
