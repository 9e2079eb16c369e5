"""Arguments of command lines that name a task."""

import argparse
from collections.abc import Sequence
from difflib import get_close_matches

from turning_env import ALL_IDS, FAMILY_ID, ScenarioError
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
        raise argparse.ArgumentTypeError(f"{word!r} is no id; {id_instead(word, ALL_IDS)}")
    return word


def id_instead(word: str, ids: Sequence[str]) -> str:
    """Return advice on an unknown id: the one that it resembles, or all."""
    # All ids begin alike, so only the rest tells them apart.
    id_by_rest = {env_id.removeprefix(PREFIX).lower(): env_id for env_id in ids}
    rest = word[:100].lower().removeprefix(PREFIX.lower())
    similar = get_close_matches(rest, id_by_rest, n=1, cutoff=0.5)
    if similar:
        return f"did you mean {id_by_rest[similar[0]]}?"
    return f"allowed are {', '.join(ids)}"


def refuse_family(source: str | None) -> None:
    """Raise ScenarioError if the name of a scenario is that of a family."""
    if source in families():
        raise ScenarioError(f"{source} is a family, not a scenario: add --env {FAMILY_ID}")
