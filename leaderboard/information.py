"""The inputs of an agent in training and at run time, and the class in which it is ranked.

``leaderboard.training_information`` says what the training was given. Scenario and hyperparameters
decide the rest. A policy that is given more in training than observations, rewards and costs is
privileged: it is trained with what no lathe reveals (asymmetric or privileged training, such as
Pinto et al. 2018, arXiv 1710.06542). It is ranked in a class of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from baselines.guided import HOLD
from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import MAX_NUMBER
from leaderboard.training_information import (
    IMITATION,
    LIFE_PRICE,
    MODEL_FREE,
    TRAINING_INPUTS,
    training_information,
)
from turning_env import Scenario

RUN_TIME_INPUTS = {
    "context": "is told numbers of the job: those of the nominal model, and those of the "
    "catalogue that its family shows",
    "memory": "remembers earlier observations",
    "belief": "is shown what a Kalman filter, which knows the nominal model, estimates from the "
    "observations",
    "rule": "sets two limits of the rule self_tuning, which knows the nominal model and does the "
    "rest",
    "position": "tracks the tool's position along the bar, from observations and the bars' "
    "geometry",
}
"""Inputs at run time beside the present observation, by name, in the order of tables."""
CLASSES = {
    "model-free agent": "trained on observations, rewards and costs alone; no model runs in the "
    "policy",
    "agent on a belief": "trained on rewards, costs and what a Kalman filter with the nominal "
    "model estimates from observations",
    "learned guide of a rule": "trained on observations, rewards and costs alone; sets two limits "
    "of a rule that has the nominal model",
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


@dataclass(frozen=True)
class Information:
    """The inputs of an agent in training and at run time; None: its file does not state them."""

    given: tuple[str, ...] | None  # inputs in training, names in TRAINING_INPUTS
    seen: tuple[str, ...] | None  # inputs at run time, names in RUN_TIME_INPUTS
    steps: int | None  # environment steps of the training


def class_of(policy: PolicySpec) -> str:
    """Return the class of a policy, one of ``CLASSES``."""
    if policy.kind != "agent":
        return policy.kind
    given = training_information(policy.parameters)
    if given is None:
        return "other agent"
    if not given <= MODEL_FREE | IMITATION:
        return "privileged agent"
    if given & IMITATION:
        return "student of a rule"
    if _guides(policy.parameters):
        return "learned guide of a rule"
    return "agent on a belief" if policy.parameters.get("belief") is True else "model-free agent"


def information(policy: PolicySpec, scenario: Scenario) -> Information | None:
    """Return the inputs of an agent, trained on a scenario; None if the policy is no agent."""
    if policy.kind != "agent":
        return None
    given = training_information(policy.parameters)
    if given is None:
        return Information(given=None, seen=None, steps=None)
    seen = _run_time_inputs(policy.parameters)
    if scenario.workpiece.bars > 0 and scenario.control.edge_changes == "end":
        given -= LIFE_PRICE  # the job ends before the edge: its life has the flat price
    return Information(
        given=tuple(name for name in TRAINING_INPUTS if name in given),
        seen=tuple(name for name in RUN_TIME_INPUTS if name in seen),
        steps=_environment_steps(policy.parameters),
    )


def _run_time_inputs(parameters: Mapping[str, object]) -> set[str]:
    """Return the inputs at run time, names in ``RUN_TIME_INPUTS``."""
    inputs = set()
    if "context" in parameters and parameters.get("hides_context") is not True:
        inputs.add("context")
    frames = _whole_number(parameters, "frames") or 1
    remembers = parameters.get("memory") is True
    if remembers or "lstm_hidden_size" in parameters or frames > 1:
        inputs.add("memory")
    if parameters.get("belief") is True:
        inputs.add("belief")
    if _guides(parameters):
        inputs |= {"belief", "rule"}  # the rule's belief is shown to its guide
    if parameters.get("position") is True:
        inputs.add("position")
    return inputs


def _guides(parameters: Mapping[str, object]) -> bool:
    """Return whether an agent sets limits of a rule in place of speed and feed."""
    return parameters.get("guide") is True


def _environment_steps(parameters: Mapping[str, object]) -> int | None:
    """Return the environment steps of a training.

    The training of a guide counts decisions, each of ``HOLD`` steps.
    """
    steps = _whole_number(parameters, "total_timesteps")
    if steps is not None and _guides(parameters):
        return steps * HOLD
    return steps


def _whole_number(parameters: Mapping[str, object], name: str) -> int | None:
    """Return a whole number that a file states.

    Return None if it states none, or one that no training has.
    """
    value = parameters.get(name)
    if type(value) is int and 0 <= value <= MAX_NUMBER:  # True and False are no numbers
        return value
    return None
