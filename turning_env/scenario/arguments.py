"""Arguments of command lines that name a task."""

import argparse

from turning_env import FAMILY_ID
from turning_env.scenario.family import families


def environment_id(word: str) -> str:
    """Return an argument that names an environment, as it is.

    Raises:
        argparse.ArgumentTypeError: it names a family, which is no id.
    """
    if word in families():
        raise argparse.ArgumentTypeError(f"{word} is a family of {FAMILY_ID}, not an id")
    return word
