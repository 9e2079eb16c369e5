"""Asks a scenario's laws: what would be, at a given speed and feed, and over the whole plane of both.

``python -m turning_env whatif`` and ``python -m turning_env map``. All is nominal: what nobody is told of the
lot, and how inserts and bars differ, is left out.
"""
