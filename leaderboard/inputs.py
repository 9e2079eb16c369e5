"""What an agent is given, in training and at run time, and the class in which it is ranked.

The parameters in an agent's file state it: an algorithm declares what its training is given, and
the terms of the training say the rest (``train/terms.py``). Training, the agent's file, play,
tables and cards read the same record, ``Inputs``.

A policy that is given more in training than observations, rewards and costs is privileged: it is
trained with what no lathe reveals (asymmetric or privileged training, such as Pinto et al. 2018,
arXiv 1710.06542). It is ranked in a class of its own.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

from baselines.policy_spec import PolicySpec
from turning_env import Scenario

TRAINING_INPUTS = {
    "rewards": "the return that it maximises, step by step",
    "overload share": "the share of severe overload and its allowance, in place of its price",
    "model gradients": "gradients of the true laws, limits and drive lags",
    "simulator gradients": "gradients of the charged cost, by copies of the simulated lathe that "
    "take the step with other speeds and feeds",
    "true states": "hidden depth of cut, hardness and wear after each step",
    "life price": "the price of edge life by dynamic programming, in place of the flat charge",
    "spreads": "how much hardness and depth of cut vary",
    "geometry": "length and diameter of the bars",
    "rule's actions": "what a rule would do in each state that the student visits; the rule sees "
    "observations and the nominal model",
}
"""Inputs of a training beside observations, by name, in the order of tables."""
RUN_TIME_INPUTS = {
    "context": "is told numbers of the job: those of the nominal model, and those of the "
    "catalogue that its family shows",
    "memory": "remembers earlier observations",
    "belief": "is shown what a Kalman filter, which knows the nominal model, estimates from the "
    "observations",
    "position": "tracks the tool's position along the bar, from observations and the bars' "
    "geometry",
    "derived inputs": "is shown the higher load, and distances of speed and feed from the nominal "
    "optimum, the chip breaker's window and the base speed",
    "load target": "sets the target of a feed loop, which knows the nominal optimum and the "
    "exponents of feed",
}
"""Inputs at run time beside the present observation, by name, in the order of tables."""
CLASSES = {
    "model-free agent": "trained on observations, rewards and costs alone; no estimator and no "
    "planner runs in the policy",
    "agent on a belief": "trained on rewards, costs and what a Kalman filter with the nominal "
    "model estimates from observations",
    "student of a rule": "trained to act as a rule does that has the nominal model; no hidden "
    "state, no true law",
    "privileged agent": "trained with what no lathe reveals, such as true states or gradients of "
    "the true laws",
    "other agent": "its file does not state what training gave it",
    "rule": "a controller, tuned on tuning seeds or training jobs; may know the nominal model and "
    "numbers of the catalogue",
    "oracle": "knows hidden quantities at run time, or is a bound; not ranked",
}
"""Classes of policies, each ranked for itself."""
MODEL_FREE = frozenset({"rewards", "overload share"})
"""Inputs that a real lathe has, too. A training with any other input is privileged."""
IMITATION = frozenset({"rule's actions"})
"""Inputs of a student that imitates a rule; a real lathe has them, too."""
BEHAVIOURS = {
    "self_tuning": "rule's actions",
    "mixture": "rule's actions",
    "causal": "true states",  # by which the oracle has acted
}
"""Inputs of a training on recorded episodes, by the policy of the data set
(``train/datasets.py``)."""
LIFE_PRICE = frozenset({"life price", "spreads"})
"""Inputs of a price of edge life p(D): dynamic programming needs the spreads."""
MAX_STEPS = 2**63 - 1
"""Largest number of steps that a training states."""


@dataclass(frozen=True)
class Inputs:
    """What an agent is given, in training and at run time.

    What a file does not state, or states as no training would, is not guessed.
    """

    training: tuple[str, ...] | None
    """Inputs of the training beside observations, names in ``TRAINING_INPUTS``; None: not
    stated."""
    context_entries: int  # numbers of a family's job in an observation; 0 without a family
    hides_context: bool  # whether the agent does not see them
    belief: bool  # sees the estimates of the optimisers' filter (``baselines/belief.py``)
    derived: bool  # sees the entries of ``baselines/derived_observation.py``
    load_target: bool  # sets the target of a feed loop (``baselines/load_target.py``)
    position: bool  # tracks the tool's position along the bar
    frames: int  # successive observations that it sees
    is_recurrent: bool  # its network has a memory
    steps: int | None  # environment steps of the training; None: not stated

    @classmethod
    def of(cls, parameters: Mapping[str, Any]) -> Self:
        """Return the inputs that the parameters of a training, or of its agent's file, state."""
        context = parameters.get("context")
        names = context.get("names") if isinstance(context, Mapping) else None
        return cls(
            training=_stated_training(parameters),
            context_entries=len(names) if isinstance(names, list | tuple) else 0,
            hides_context=parameters.get("hides_context") is True,
            belief=parameters.get("belief") is True,
            derived=parameters.get("derived") is True,
            load_target=parameters.get("load_target") is True,
            position=parameters.get("position") is True,
            frames=_whole_number(parameters, "frames") or 1,
            is_recurrent=parameters.get("memory") is True or "lstm_hidden_size" in parameters,
            steps=_whole_number(parameters, "total_timesteps"),
        )

    def on(self, scenario: Scenario) -> Self:
        """Return the inputs that count on a scenario.

        A price of edge life does not count where the job ends before the edge.
        """
        if self.training is None or scenario.control.edge_changes != "end":
            return self
        if scenario.workpiece.bars == 0:
            return self
        counted = tuple(name for name in self.training if name not in LIFE_PRICE)
        return replace(self, training=counted)

    @property
    def wrappers(self) -> tuple[str, ...]:
        """Settings that belong around the agent's network in play, as it was trained with them."""
        is_set = {
            "belief": self.belief,
            "derived": self.derived,
            "load_target": self.load_target,
        }
        return tuple(name for name in is_set if is_set[name])

    @property
    def run_time(self) -> tuple[str, ...]:
        """Inputs at run time, names in ``RUN_TIME_INPUTS``."""
        is_given = {
            "context": self.context_entries > 0 and not self.hides_context,
            "memory": self.is_recurrent or self.frames > 1,
            "belief": self.belief,
            "position": self.position,
            "derived inputs": self.derived,
            "load target": self.load_target,
        }
        return tuple(name for name in RUN_TIME_INPUTS if is_given[name])

    @property
    def agent_class(self) -> str:
        """The class of an agent, one of ``CLASSES``."""
        if self.training is None:
            return "other agent"
        given = set(self.training)
        if not given <= MODEL_FREE | IMITATION:
            return "privileged agent"
        if given & IMITATION:
            return "student of a rule"
        return "agent on a belief" if self.belief else "model-free agent"


def training_inputs(declared: Iterable[str], parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the inputs of a training with some parameters, in the order of ``TRAINING_INPUTS``.

    Args:
        declared: the inputs that the training's algorithm declares.
        parameters: of these, ``asymmetric`` shows the hidden state to a critic. ``life_price``
            decides whether the training has a price of edge life; without it, the algorithm does.
            ``behaviour`` names the policy of recorded episodes.
    """
    given = set(declared)
    behaviour = parameters.get("behaviour")
    if behaviour in BEHAVIOURS:
        given.add(BEHAVIOURS[behaviour])
    if parameters.get("asymmetric") is True:
        given.add("true states")
    life_price = parameters.get("life_price")
    if life_price == "marginal":
        given |= LIFE_PRICE
    elif life_price is not None:
        given -= LIFE_PRICE
    return tuple(name for name in TRAINING_INPUTS if name in given)


def class_of(policy: PolicySpec) -> str:
    """Return the class of a policy, one of ``CLASSES``."""
    if policy.kind != "agent":
        return policy.kind
    return Inputs.of(policy.parameters).agent_class


def _stated_training(parameters: Mapping[str, Any]) -> tuple[str, ...] | None:
    stated = parameters.get("training_information")
    if not isinstance(stated, list | tuple):
        return None
    if not all(isinstance(name, str) and name in TRAINING_INPUTS for name in stated):
        return None
    return tuple(name for name in TRAINING_INPUTS if name in stated)


def _whole_number(parameters: Mapping[str, Any], name: str) -> int | None:
    """Return a whole number that a file states.

    Return None if it states none, or one that no training has.
    """
    value = parameters.get(name)
    if type(value) is int and 0 <= value <= MAX_STEPS:  # True and False are no numbers
        return value
    return None
