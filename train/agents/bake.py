"""Write the agent of a family as the agent of one scenario, without training: its nominal model becomes constants in the file.

    python -m train.export --agent family_gradient-seed0.onnx --scenario mine.toml
    python -m train.export --agent family_gradient-seed0.onnx --scenario mine.toml --doubt 0.3

The first matrix product in the file tells the network how wrong the nominal model may be. Here it also tells the context,
and moves speed and feed to a range as wide as the family's, if the scenario's is not. A last product turns the agent's action
into the scenario's, which has other steps or no edge changes.
"""

import argparse
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from baselines.models.edge_value import worth
from train.agents import agent_file
from train.agents.agent_file import ONNX_SUFFIX, AgentFile, Metadata, Space
from train.agents.network import tried
from train.agents.to_onnx import with_properties
from train.job_optimum import SET_POINT
from turning_env import FAMILY_ID, IDS, OBS, Scenario
from turning_env.batch.driver import action_space, observation_space
from turning_env.console import described
from turning_env.files import replace_file
from turning_env.physics.quantities import layout
from turning_env.scenario.plan import MIDDLE, Columns, features, plan_of

Floats = NDArray[np.float64]

_DRIVES = (
    ("cutting_speed", (OBS.cutting_speed, OBS.commanded_cutting_speed)),
    ("feed", (OBS.feed, OBS.commanded_feed)),
)
"""Names of ranges, and places of their entries in observations."""
_MIN_COST = 0.01
_TURNS = 5
_NEVER_SEEN = "removed_wear"
"""Entry that a scenario may lack: it stays 0, as before the first change of an edge."""


@dataclass(frozen=True)
class _Range:
    """A range of speed or feed by the logarithms of its lowest value and of its ratio."""

    low: float
    span: float

    @classmethod
    def of(cls, scenario: Scenario, name: str) -> "_Range":
        low, high = (getattr(scenario.machine, f"{name}_{end}") for end in ("min", "max"))
        return cls(math.log(low), math.log(high / low))


def baked(file: AgentFile, scenario: Scenario, doubt: float, command: str) -> bytes:
    """Return the content of the file of a family's agent for one scenario.

    Args:
        file: the agent's file.
        scenario: scenario that it is to play.
        doubt: how wrong the nominal model may be, over how wrong the family's is [-].
        command: the command, for the metadata.

    Raises:
        ValueError: the agent is not a family's, it was not trained on such doubt, or the scenario has other observations or
            actions than the family.
    """
    about = file.metadata
    if about.env_id != FAMILY_ID:
        raise ValueError(f"its environment is {about.env_id}, but only agents of {FAMILY_ID} receive a nominal model")
    errors: Any = about.parameters.get("errors", [1.0])
    if not min(errors) <= doubt <= max(errors):
        raise ValueError(f"doubt is {doubt}, but must be {min(errors)} to {max(errors)}, as in its training")
    _check_plays(about.scenario, scenario)
    model = onnx.load_model_from_string(file.content)
    _set_products(model, *_products(about, scenario, doubt))
    played = "RoughTurning-Shift-v0" if scenario.control.edge_changes == "commanded" else "RoughTurning-v0"
    own = [env_id for env_id, preset in IDS.items() if Scenario.load(preset).digest() == scenario.digest()]
    metadata = Metadata(
        format=about.format,
        algorithm=about.algorithm,
        name=f"{about.name}_{scenario.name}",
        seed=about.seed,
        env_id=(own or [played])[0],
        scenario=scenario,
        observation_space=Space.of(observation_space(scenario)),
        action_space=Space.of(action_space(scenario)),
        parameters={name: value for name, value in about.parameters.items() if name != "context"},
        trained_steps=about.trained_steps,
        command=command,
        versions=about.versions,
    )
    result = with_properties(model, metadata)
    memory = agent_file.checked(result).memory_size
    tried(result, len(metadata.observation_space.low), len(metadata.action_space.low), memory)
    return result


def _check_plays(trained_on: Scenario, scenario: Scenario) -> None:
    for field in ("control.action", "control.aim", "control.interval", "sensors.force", "sensors.probe"):
        section, name = field.split(".")
        mine, its = (getattr(getattr(each, section), name) for each in (trained_on, scenario))
        if mine != its:
            raise ValueError(f"{field} is {its!r} in scenario {scenario.name!r}, but must be {mine!r}, as in the family")
    known, given = set(layout(trained_on)), set(layout(scenario))
    if more := sorted((given - known) | (known - given - {_NEVER_SEEN})):
        raise ValueError(f"scenario {scenario.name!r} and the family differ in the observation's {', '.join(more)}")


def _window(family: Scenario, scenario: Scenario, name: str, best: float, usual: float) -> _Range:
    """Return the range in which the agent sees speed or feed: as wide as the family's.

    It is the scenario's, if that is as wide. Otherwise the nominal model's ``best`` set point is where the family has it
    ``usual``ly: logarithms of it, and of it over the lowest one.
    """
    own, wanted = _Range.of(scenario, name), _Range.of(family, name)
    return own if math.isclose(own.span, wanted.span, rel_tol=1e-3) else _Range(best - usual, wanted.span)


def _edge_cost(scenario: Scenario, values: dict[str, Any]) -> float:
    """Return the edge's price [min] with which metal and time have the agent's prices; ``values``: the scenario's.

    The agent takes a minute of the nominal model's best set point, edges included, for worth a minute, and expects another edge
    after each. A scenario may value metal otherwise, and its episode may end with the edge: then time is worth itself, and a
    whole edge what its life earns at that price. All prices are scaled so that metal is worth what the agent expects.
    """
    own, change = scenario.economics, scenario.economics.edge_change_time
    cost = own.edge_cost
    if scenario.control.edge_changes == "end":
        cost = float(worth(scenario, own.overload_price).life.mean()) / 60.0 - change
    stated = cost
    for _ in range(_TURNS):  # the best set point depends on the price
        economics = values["economics"] | {"edge_cost": max(stated, _MIN_COST)}
        plan = plan_of(Columns(values | {"economics": economics}), 1)
        speed, feed, life = (each[0, MIDDLE] for each in (plan.speed, plan.feed, plan.life))
        metal = speed * feed * scenario.workpiece.depth_of_cut / own.reference_removal_rate
        stated = cost * (1.0 + change / life) / max(metal - cost / life, _MIN_COST)
    return float(max(stated, _MIN_COST))


def _products(about: Metadata, scenario: Scenario, doubt: float) -> tuple[Floats, Floats, Floats]:
    """Return matrices: the network sees observation @ see + seen, and acts by action @ act."""
    family, trained = about.scenario, about.parameters["context"]
    assert isinstance(trained, dict)
    mean, spread = (np.array(trained[name], np.float64) for name in ("mean", "spread"))
    names: Any = trained["names"]
    usual = dict(zip(names, mean.tolist(), strict=True))
    values = scenario.nominal().model_dump(exclude={"name", "nominal_model"})
    values["economics"]["edge_cost"] = _edge_cost(scenario.nominal(), values)
    plan = plan_of(Columns(values), 1)
    bests = {"cutting_speed": plan.speed[0, MIDDLE], "feed": plan.feed[0, MIDDLE]}
    windows = {}
    for (name, _), place in zip(_DRIVES, SET_POINT, strict=True):
        windows[name] = _window(family, scenario, name, math.log(bests[name]), usual[place])
        values["machine"][f"{name}_min"] = math.exp(windows[name].low)
    found = features(Columns(values), plan)
    context = (np.array([found[name][0] for name in names]) - mean) / spread

    entries = layout(family)
    see = np.eye(len(entries), len(entries) + len(context) + 1)[[entries.index(name) for name in layout(scenario)]]
    seen = np.concatenate([np.zeros(len(entries)), context, [doubt]])
    for name, places in _DRIVES:
        own, window = _Range.of(scenario, name), windows[name]
        for place in places:
            see[place, place] = own.span / window.span
            seen[place] = (2.0 * (own.low - window.low) + own.span) / window.span - 1.0
    steps = [getattr(family.control, f"{name}_step") / getattr(scenario.control, f"{name}_step") for name, _ in _DRIVES]
    act = np.diag([*steps, 1.0])[:, : (action_space(scenario).shape or (0,))[0]]
    return see, seen, act


def _set_products(model: onnx.ModelProto, see: Floats, seen: Floats, act: Floats) -> None:
    """Let the network see and act by other products; its action is clipped."""
    graph = model.graph
    for node in graph.node:
        node.output[:] = ["told_action" if name == "action" else name for name in node.output]
    bounds = {"lowest_action": np.array(-1.0), "highest_action": np.array(1.0)}
    constants = {"see_weight": see, "see_bias": seen, "act": act, **bounds}
    if missing := {"see_weight", "see_bias"} - {tensor.name for tensor in graph.initializer}:
        raise ValueError(f"its network has no {min(missing)}: train it again with this version")
    kept = [tensor for tensor in graph.initializer if tensor.name not in constants]
    del graph.initializer[:], graph.value_info[:]
    graph.initializer.extend(kept)
    graph.initializer.extend(numpy_helper.from_array(value.astype(np.float32), name) for name, value in constants.items())
    graph.node.append(helper.make_node("MatMul", ["told_action", "act"], ["unclipped_action"]))
    graph.node.append(helper.make_node("Clip", ["unclipped_action", "lowest_action", "highest_action"], ["action"]))
    for value, name, size in ((graph.input, "observation", len(see)), (graph.output, "action", act.shape[1])):
        (found,) = (each for each in value if each.name == name)
        found.type.tensor_type.shape.dim[1].dim_value = size


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.export", **described(__doc__))
    parser.add_argument("--agent", required=True, type=Path, metavar="FILE", help="agent's file of a family, of your own")
    parser.add_argument("--scenario", required=True, help="preset or TOML file with the nominal model")
    doubt_help = "how wrong the nominal model may be: 1 if from a catalogue (default), less if measured on this lathe"
    parser.add_argument("--doubt", type=float, default=1.0, metavar="SHARE", help=doubt_help)
    parser.add_argument("--out", type=Path, default=Path(), metavar="FOLDER", help="folder to write to (default: this one)")
    parsed = parser.parse_args(arguments)
    scenario = Scenario.load(parsed.scenario)
    try:
        command = f"python -m train.export {shlex.join(arguments)}"
        content = baked(agent_file.read(parsed.agent), scenario, parsed.doubt, command)
    except ValueError as error:
        raise ValueError(f"{parsed.agent} cannot play {parsed.scenario}: {error}") from error
    path = parsed.out / f"{agent_file.checked(content).label}{ONNX_SUFFIX}"
    replace_file(path, lambda partial: partial.write_bytes(content))
    print(path)
    return 0
