"""The inputs of an agent in training and at run time, and the length of its training, derived from its file.

The algorithm, taken from the training command, decides what training gave; scenario and hyperparameters decide the rest. A
policy that sees more in training than observations, rewards and costs is privileged: it is trained with what no lathe reveals
(asymmetric or privileged training, such as Pinto et al. 2018, arXiv 1710.06542). It ranks in a class of its own.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from baselines.guided import HOLD
from train.agents.agent_file import MAX_NUMBER
from turning_env import Scenario
from turning_env.scoring.policy import PolicySpec

GIVEN = {
    "rewards": "the return that it maximises, step by step",
    "overload share": "the share of severe overload and its allowance, in place of its price",
    "model gradients": "gradients of the true laws, limits and drive lags",
    "true states": "hidden depth of cut, hardness and wear after each step",
    "life price": "the price of edge life by dynamic programming, in place of the flat charge",
    "spreads": "how much hardness and depth of cut vary",
    "geometry": "length and diameter of the bars",
}
"""Inputs of training beside observations, by name."""
SEEN = {
    "context": "is told numbers of the job: those of the nominal model, and those of the catalogue that its family shows",
    "memory": "remembers earlier observations",
    "belief": "is shown what a Kalman filter, which knows the nominal model, estimates from the observations",
    "rule": "sets two limits of the rule self_tuning, which knows the nominal model and does the rest",
    "position": "tracks the tool's position along the bar, from observations and the bars' geometry",
}
"""Inputs at run time beside the present observation, by name."""
_MODEL_FREE = frozenset({"rewards", "overload share"})
_REWARDS = frozenset({"rewards"})
_PRICED = frozenset({"life price", "spreads"})
_TEACHER = frozenset({"model gradients", "true states", "geometry"}) | _PRICED
_ALGORITHMS: Mapping[str, frozenset[str]] = {
    "ppo": _REWARDS,
    "recurrent_ppo": _REWARDS,
    "guided_ppo": _REWARDS,
    "sac": _REWARDS,
    "tqc": _REWARDS,
    "lagrangian_ppo": _REWARDS | {"overload share"},
    "analytic_gradient": _TEACHER,
}
CLASSES = {
    "model-free agent": "trained on observations, rewards and costs alone",
    "guiding agent": "trained on observations, rewards and costs alone; sets two limits of a rule that has the nominal model",
    "privileged agent": "trained with what no lathe reveals, such as true states or gradients of the true laws",
    "other agent": "its file does not state what training gave it",
    "rule": "a controller, tuned on tuning seeds or training jobs; may know the nominal model and numbers of the catalogue",
    "oracle": "knows hidden quantities at run time, or is a bound; not ranked",
}
"""Classes of policies, each ranked for itself."""


@dataclass(frozen=True)
class Information:
    """The inputs of an agent in training and at run time; None: not stated."""

    given: tuple[str, ...] | None  # names in GIVEN of its inputs in training
    seen: tuple[str, ...] | None  # names in SEEN of its inputs at run time
    steps: int | None  # environment steps of the training


def class_of(policy: PolicySpec) -> str:
    """Return the class of a policy, one of ``CLASSES``."""
    if policy.kind != "agent":
        return policy.kind
    algorithm = _algorithm(policy.command)
    if algorithm is None:
        return "other agent"
    if not _given(algorithm, policy.parameters) <= _MODEL_FREE:
        return "privileged agent"
    return "guiding agent" if policy.parameters.get("guide") is True else "model-free agent"


def information(policy: PolicySpec, scenario: Scenario) -> Information | None:
    """Return an agent's training data and observations on the scenario of its training; None if the policy is no agent."""
    if policy.kind != "agent":
        return None
    algorithm, p = _algorithm(policy.command), policy.parameters
    if algorithm is None:
        return Information(None, None, None)
    given = _given(algorithm, p)
    if scenario.workpiece.bars > 0 and scenario.control.edge_changes == "end":
        given -= _PRICED  # the job ends before the edge: its life has the flat price
    gradient = given.isdisjoint(_REWARDS)
    has = {
        "context": "context" in p and p.get("hides_context") is not True,
        "memory": p.get("memory", gradient) is True
        or "memory_cells" in p
        or (_whole(p, "frames") or 1) > 1,
        "belief": p.get("belief") is True or p.get("guide") is True,
        "rule": p.get("guide") is True,
        "position": p.get("position", gradient) is True,
    }
    return Information(
        given=tuple(name for name in GIVEN if name in given),
        seen=tuple(name for name in SEEN if has[name]),
        steps=_environment_steps(p),
    )


def _environment_steps(parameters: Mapping[str, object]) -> int | None:
    """Return the environment steps of a training; that of a guide counts decisions, each of ``HOLD`` steps."""
    steps = _whole(parameters, "steps")
    guides = parameters.get("guide") is True
    return steps * HOLD if steps is not None and guides else steps


def _given(algorithm: str, parameters: Mapping[str, object]) -> frozenset[str]:
    """Return the inputs of a training; ``life_price`` and ``asymmetric`` are terms of it (``train/terms.py``)."""
    hidden = {"true states"} if parameters.get("asymmetric") is True else set()
    price, given = parameters.get("life_price"), _ALGORITHMS[algorithm] | hidden
    return (
        given | _PRICED if price == "marginal" else given - _PRICED if price is not None else given
    )


def _algorithm(command: str | None) -> str | None:
    """Return the algorithm that a command line trains with; None if it is not one of the project's."""
    found = re.match(r"python -m train\.(\w+)( |$)", command or "")
    return found[1] if found and found[1] in _ALGORITHMS else None


def _whole(parameters: Mapping[str, object], name: str) -> int | None:
    """Return a whole number that a file states; None if it states none, or one that no training has."""
    value = parameters.get(name)
    return value if type(value) is int and 0 <= value <= MAX_NUMBER else None
