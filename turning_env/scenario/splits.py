"""Shift splits: ``RoughTurning-v0`` with bars, tools, sensors and steels for which its policies were not tuned or trained.

The first four have the nominal model of RoughTurning-v0 and a model mismatch (``sections.Mismatch``). The last two have a nominal
model with another diameter or another steel. Build policies for them with ``Scenario.nominal()``. Reasons: ``docs/choices.md``.
"""

SPLITS = ("harder_lot", "forging_skin", "worn_lot", "sensor_bias", "small_diameter", "ck45")
"""Names of the presets, in the order in which they are reported."""
