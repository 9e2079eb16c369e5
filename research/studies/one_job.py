"""Draw one job of a family as a rule and as an agent play it.

    python -m research.studies.one_job --job 173 --agent AGENT.onnx --out FILE.svg

The picture shows cutting speed, used life and broken edges over machine time. Used life is the true
one, which neither knows.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from baselines import tuned
from baselines.catalogue import spec
from baselines.guided import START_SHARE
from leaderboard.agents.agent_file import informed
from leaderboard.agents.onnx_policy import load
from turning_env import FamilyEnv, Scenario
from turning_env.console import described, exits
from turning_env.policy import Policy
from turning_env.rendering import plot_style as style

SHOWN = ("cutting_speed", "used_life", "edges_broken")


def record(env: FamilyEnv, policy: Policy, job: int) -> tuple[dict[str, Any], float]:
    """Play a job; return machine time [min] and ``SHOWN`` over its steps, and the return [s]."""
    observation, _ = env.reset(seed=job)
    policy.reset(np.ones(1, np.bool_))
    values: dict[str, list[float]] = {"clock": []}
    for name in SHOWN:
        values[name] = []
    total = 0.0
    clock = 0.0
    ended = False
    while not ended:
        actions = policy.act(observation[np.newaxis])
        observation, reward, terminated, truncated, info = env.step(actions[0])
        total += float(reward)
        clock += info["time"] / 60.0
        ended = terminated or truncated
        values["clock"].append(clock)
        for name in SHOWN:
            values[name].append(float(info[name]))
    arrays = {name: np.array(numbers) for name, numbers in values.items()}
    return arrays, total


def draw(runs: dict[str, tuple[dict[str, Any], float]], start_speed: float, path: Path) -> None:
    """Draw the runs, by the policies' names; speeds over the material's start speed [m/min]."""
    with style.for_print():
        figure = Figure(figsize=(4.8, 3.6), layout="constrained")
        speed_axes, life_axes = figure.subplots(2, 1, sharex=True)
        for k, (name, (values, total)) in enumerate(runs.items()):
            colour, _ = style.LINES[k]
            label = f"{name}: {total:.0f} s"
            clock = values["clock"]
            used_life = values["used_life"]
            # The lines have a gap where the edge was changed.
            stopped = np.diff(clock, prepend=0.0) > 0.5
            shown_speed = np.where(stopped, np.nan, values["cutting_speed"] / start_speed)
            shown_life = np.where(stopped, np.nan, used_life)
            speed_axes.plot(clock, shown_speed, color=colour, label=label)
            life_axes.plot(clock, shown_life, color=colour)
            broken = np.flatnonzero(values["edges_broken"] > 0)
            before = np.maximum(broken - 1, 0)
            life_axes.plot(
                clock[before],
                used_life[before],
                "x",
                color=colour,
                markersize=9,
            )
        speed_axes.set_ylabel("cutting speed\nover start value [-]")
        life_axes.set_ylabel("used life [-]\nx: edge broken")
        life_axes.set_xlabel("machine time [min]")
        speed_axes.legend(loc="upper right", ncols=2)
        style.save(style.readable(figure), path)


@exits(ValueError, OSError)
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.one_job", **described(__doc__)
    )
    parser.add_argument("--family", default="unmodelled", help="family (default: %(default)s)")
    parser.add_argument("--split", default="validation", help="split (default: %(default)s)")
    parser.add_argument(
        "--job", type=int, default=0, help="number of the job (default: %(default)s)"
    )
    parser.add_argument("--rule", default="self_tuning", help="rule (default: %(default)s)")
    parser.add_argument("--agent", type=Path, required=True, metavar="FILE", help="agent's file")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="picture to write: .svg, .png or .pdf",
    )
    parsed = parser.parse_args(arguments)
    env = FamilyEnv(parsed.family, parsed.split)
    env.reset(seed=parsed.job)
    scenario = env.job().scenario
    rule = spec(
        parsed.rule,
        scenario,
        Scenario.load(env.family.base),
        tuned.on_family(env.family, parsed.rule),
    ).make(1)
    agent = informed(load(parsed.agent), [scenario])(1)
    hidden = FamilyEnv(parsed.family, parsed.split, "hidden")
    runs = {
        parsed.rule: record(hidden, rule, parsed.job),
        parsed.agent.stem: record(env, agent, parsed.job),
    }
    draw(runs, START_SHARE * scenario.machine.cutting_speed_max, parsed.out)
    for name, (values, total) in runs.items():
        print(f"{name}: {total:.0f} s, {values['edges_broken'].sum():.0f} edges broken")
    return 0


if __name__ == "__main__":
    sys.exit(main())
