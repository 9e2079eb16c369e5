"""Arguments of command lines that name a task."""

import argparse
from difflib import get_close_matches

from turning_env import ALL_IDS, FAMILY_ID
from turning_env.scenario.family import families

PREFIX = "RoughTurning-"


def environment_id(word: str) -> str:
    """Return an argument that names an environment, as it is.

    Raises:
        argparse.ArgumentTypeError: it is no id; the message names the id that it resembles.
    """
    if word in families():
        raise argparse.ArgumentTypeError(f"{word} is a family of {FAMILY_ID}, not an id")
    if word not in ALL_IDS:
        raise argparse.ArgumentTypeError(f"{word!r} is no id; {_advice(word)}")
    return word


def _advice(word: str) -> str:
    """Return the id that a word resembles, or all ids."""
    # All ids begin alike, so only the rest tells them apart.
    id_by_rest = {env_id.removeprefix(PREFIX).lower(): env_id for env_id in ALL_IDS}
    rest = word[:100].lower().removeprefix(PREFIX.lower())
    similar = get_close_matches(rest, id_by_rest, n=1, cutoff=0.5)
    if similar:
        return f"did you mean {id_by_rest[similar[0]]}?"
    return f"allowed are {', '.join(ALL_IDS)}"
