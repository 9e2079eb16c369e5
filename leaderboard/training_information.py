"""The inputs of a training beside observations, as an agent's file states them.

An algorithm declares its inputs in its own file (``Algorithm.training_information``). Two terms of
a training change them (``train/terms.py``). The file of a trained agent states the result among
its parameters, as ``training_information``. Leaderboards rank agents in classes by their inputs;
this module leaves the classes to them.
"""

from collections.abc import Iterable, Mapping
from typing import Any

TRAINING_INPUTS = {
    "rewards": "the return that it maximises, step by step",
    "overload share": "the share of severe overload and its allowance, in place of its price",
    "model gradients": "gradients of the true laws, limits and drive lags",
    "true states": "hidden depth of cut, hardness and wear after each step",
    "life price": "the price of edge life by dynamic programming, in place of the flat charge",
    "spreads": "how much hardness and depth of cut vary",
    "geometry": "length and diameter of the bars",
    "rule's actions": "what a rule would do in each state that the student visits; the rule sees "
    "observations and the nominal model",
}
"""Inputs of a training beside observations, by name, in the order of tables."""
MODEL_FREE = frozenset({"rewards", "overload share"})
"""Inputs that a real lathe has, too. A training with any other input is privileged."""
IMITATION = frozenset({"rule's actions"})
"""Inputs of a student that imitates a rule; a real lathe has them, too."""
LIFE_PRICE = frozenset({"life price", "spreads"})
"""Inputs of a price of edge life p(D): dynamic programming needs the spreads."""


def with_terms(inputs: Iterable[str], parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the inputs of a training with some parameters, in the order of ``TRAINING_INPUTS``.

    Args:
        inputs: the inputs that the training's algorithm declares.
        parameters: of these, ``asymmetric`` shows the hidden state to a critic. ``life_price``
            decides whether the training has a price of edge life; without it, the algorithm does.
    """
    given = set(inputs)
    if parameters.get("asymmetric") is True:
        given.add("true states")
    life_price = parameters.get("life_price")
    if life_price == "marginal":
        given |= LIFE_PRICE
    elif life_price is not None:
        given -= LIFE_PRICE
    return tuple(name for name in TRAINING_INPUTS if name in given)


def training_information(parameters: Mapping[str, Any]) -> frozenset[str] | None:
    """Return the inputs of an agent's training, or None if its file does not state them.

    The inputs are names in ``TRAINING_INPUTS``; ``parameters`` are those in the agent's file.
    """
    stated = parameters.get("training_information")
    if not isinstance(stated, list | tuple):
        return None
    is_known = all(isinstance(name, str) and name in TRAINING_INPUTS for name in stated)
    return frozenset(stated) if is_known else None
