"""Argparse types of the commands, whose errors say what is allowed."""

import argparse
from collections.abc import Callable

from turning_env import console


def number_within(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return an argparse type for a number within a range [unit], ends included.

    It is that of ``turning_env.console``, but its error names the range and the decimal point for
    text that is no number, too.
    """
    within = console.number_within(low, high, unit)

    def number(text: str) -> float:
        try:
            return within(text)
        except ValueError as error:
            allowed = f"{low:g} to {high:g} {unit}".rstrip(" -")
            raise argparse.ArgumentTypeError(
                f"{text!r} is no number: give {allowed}, without a unit; decimals have a point"
            ) from error

    return number
