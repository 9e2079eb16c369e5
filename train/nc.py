"""The command line ``python -m train.export --nc``: part programs of agents and controllers."""

import argparse
import inspect
import json
import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tqdm import tqdm

from baselines import catalogue
from train import nc_programs
from train.agents import onnx_policy
from train.agents.agent_file import check_fits
from turning_env import Scenario
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.scoring.policy import PolicyFactory
from turning_env.scoring.seeds import tuning_seeds
from turning_nc import simulate
from turning_nc.program import Program, read, read_file, write
from turning_nc.simulate import Totals
from turning_nc.words import NcError

PROGRAM = "python -m train.export --nc"
MAX_DIFFERENCE = 0.02  # largest relative difference of removed metal, time and wear between a program read back and its original
MAX_OVERRIDE_DIFFERENCE = 0.5  # largest difference between a law read back and its controller [percentage points of override]
REVIEW = (
    "Tool, zero offset, clamping, retraction, coolant, limits and every value must be checked by whoever is responsible for the "
    "machine."
)
CAUTION = f"Simulation output: not for a machine without review. {REVIEW}"
Options = argparse.Namespace


@exits(KeyError, ValueError, interrupted="interrupted: nothing was written")
def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit status."""
    options = _parser().parse_args(arguments)
    options.command = f"{PROGRAM} {shlex.join(arguments)}"
    done: dict[str, Any] = options.run(options)
    print(json.dumps(done) if options.json else _lines(done))
    return 0


def _parser() -> argparse.ArgumentParser:
    about = f"Write the commands of a policy as a part program for a SINUMERIK lathe, read it back and play it. {CAUTION}"
    runs = _schedule, _table, _law, _check
    examples = [line.strip() for run in runs for line in (run.__doc__ or "").splitlines() if PROGRAM in line]
    parser = argparse.ArgumentParser(prog=PROGRAM, **described("\n\n".join((about, "\n".join(examples)))))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(run: Callable[[Options], dict[str, Any]], scenario: str | None) -> argparse.ArgumentParser:
        title, *others = inspect.cleandoc(run.__doc__ or "").split("\n\n")
        added = commands.add_parser(run.__name__[1:], help=title, **described("\n\n".join((f"{title} {CAUTION}", *others))))
        added.set_defaults(run=run)
        default = scenario or "the agent's own, or rough_turning"
        added.add_argument("--scenario", default=scenario, help=f"preset or TOML file (default: {default})")
        added.add_argument("--json", action="store_true", help="print the summary as one line of JSON")
        if run is not _table:
            seeds, help_ = added.add_mutually_exclusive_group(), "bars and edge of the tuning seed number N (default: 0)"
            seeds.add_argument("--tuning-seed", type=int, default=0, metavar="N", help=help_)
            seeds.add_argument("--seed", type=int, metavar="S", help="bars and edge of any seed")
        if run is not _check:
            added.add_argument("--out", required=True, type=Path, metavar="FILE", help="program to write, such as bar.mpf")
        return added

    added = command(_schedule, None)
    policy = added.add_mutually_exclusive_group(required=True)
    policy.add_argument("--agent", type=Path, metavar="FILE", help="an agent's ONNX file")
    policy.add_argument("--rule", metavar="NAME", help=f"a controller: {', '.join(catalogue.RULES)}")
    added.add_argument("--bars", type=int, default=1, metavar="N", help="the first N bars of the seed (default: 1)")
    help_ = "largest relative difference of speeds and feeds that merge into one block (default: %(default)s)"
    added.add_argument("--tolerance", type=float, default=simulate.TOLERANCE, metavar="SHARE", help=help_)
    help_ = "time for which a pair is kept (default: the scenario's control interval)"
    command(_table, "rough_turning").add_argument("--interval", type=float, metavar="MIN", help=help_)
    help_ = f"one of {', '.join(nc_programs.LAWS)}"
    command(_law, "override").add_argument("--rule", required=True, metavar="NAME", help=help_)
    command(_check, "rough_turning").add_argument("file", type=Path, metavar="FILE", help="the program")
    return parser


def _seed(options: Options) -> int:
    if options.seed is not None:
        return int(options.seed)
    if options.tuning_seed < 0:
        raise NcError(f"--tuning-seed is {options.tuning_seed}, but must be 0 or more")
    return tuning_seeds(options.tuning_seed + 1)[-1]


def _schedule(options: Options) -> dict[str, Any]:
    """Write the speeds and feeds that a policy commands on given bars, as blocks along Z.

    python -m train.export --nc schedule --agent agents/RoughTurning-v0/rough_turning/ppo-seed0.onnx --out bar.mpf
    python -m train.export --nc schedule --rule rescaled_grid_search --seed 7 --bars 3 --tolerance 0.05 --out bars.mpf
    """
    name, make, scenario = _policy(options)
    if not 0.0 <= options.tolerance <= 1.0:
        raise NcError(f"--tolerance is {options.tolerance}, but must be 0 to 1")
    merged = f"speeds and feeds within {100.0 * options.tolerance:g} % are one block"
    comment = f"{name} on scenario {scenario.name}, seed {_seed(options)}; {merged}"
    workpiece = scenario.workpiece
    with tqdm(
        total=options.bars * (workpiece.approach + workpiece.bar_length), unit="mm", unit_scale=True, disable=None, leave=False
    ) as progress:
        played = simulate.play_schedule(
            make, scenario, _seed(options), options.bars, options.tolerance, lambda path: progress.update(path - progress.n)
        )
    comments = [comment, *_early_end(played[0], scenario, options.bars)]
    return _written(options, *played, lambda program: simulate.simulate(program, scenario, _seed(options)), *comments)


def _policy(options: Options) -> tuple[str, PolicyFactory, Scenario]:
    if options.agent is None:
        scenario = Scenario.load(options.scenario or "rough_turning")
        return options.rule, catalogue.spec(options.rule, scenario).make, scenario
    agent = onnx_policy.load(options.agent)
    scenario = Scenario.load(options.scenario) if options.scenario or agent.trained_on is None else agent.trained_on
    check_fits(agent, scenario)
    return f"{agent.name} (training seed {agent.training_seed})", agent.make, scenario


def _table(options: Options) -> dict[str, Any]:
    """Write the speeds and feeds of the grid search for one edge on nominal models.

    python -m train.export --nc table --interval 1 --out edge.mpf
    """
    even, longer = nc_programs.table_scenarios(Scenario.load(options.scenario), options.interval)
    interval = f"an interval of {longer.control.interval / 60.0:g} min"
    comment = f"interval table of the grid search on the nominal models of scenario {even.name}: one edge, {interval}"
    make = catalogue.spec("grid_search", longer).make
    bars = even.workpiece.bars or 1000
    played = simulate.play_schedule(make, longer, 0, bars, 0.0)
    comments = [comment, *_early_end(played[0], even, bars)]
    return _written(options, *played, lambda program: simulate.simulate(program, even, 0), *comments)


def _early_end(program: Program, scenario: Scenario, bars: int) -> list[str]:
    if len(program.bars) == bars and program.bars[-1][-1].z <= 1e-3 - scenario.workpiece.bar_length:
        return []
    return [f"the edge or the time limit ended the episode in bar {len(program.bars)}: the program ends there"]


def _law(options: Options) -> dict[str, Any]:
    """Write a controller from spindle load to feed override as synchronized actions.

    python -m train.export --nc law --rule modified_fuzzy_override --out override.mpf
    """
    scenario = Scenario.load(options.scenario)
    program = nc_programs.law_program(options.rule, scenario)
    by_power = f"spindle power over {scenario.machine.rated_power:g} kW"
    load = by_power if scenario.spindle.reading == "power" else "spindle torque over the torque available at its speed"
    comments = (
        f"feed override of {options.rule} on scenario {scenario.name}",
        f"$AA_LOAD[S1] is taken for {load}, in per cent; the law is made for an interpolation "
        f"cycle of {1000.0 * scenario.control.interval:g} ms",
    )
    make, seed = catalogue.spec(options.rule, scenario).make, _seed(options)
    differences, original = simulate.compare(program, make, scenario, seed)
    largest = max(differences)
    if not largest <= MAX_OVERRIDE_DIFFERENCE:
        raise NcError(
            f"the law differs from {options.rule} by {largest:.2f} percentage points of override; "
            f"{MAX_OVERRIDE_DIFFERENCE} are allowed, and nothing was written"
        )
    summary = {
        "polynomials": len(program.law.polynomials),
        "actions": len(program.law.actions),
        "steps": len(differences),
        "mean_override_difference": sum(differences) / len(differences),
        "largest_override_difference": largest,
    }
    return _written(options, program, original, lambda back: simulate.simulate(back, scenario, seed), *comments, **summary)


def _check(options: Options) -> dict[str, Any]:
    """Read a program of one cut along bars and play it on given bars.

    python -m train.export --nc check bar.mpf --tuning-seed 0
    """
    program = read_file(options.file)
    totals = simulate.simulate(program, Scenario.load(options.scenario), _seed(options))
    return {"path": str(options.file), "bars": len(program.bars), "blocks": program.blocks, "simulated": asdict(totals)}


def _written(
    options: Options, program: Program, original: Totals, play: Callable[[Program], Totals], *comments: str, **summary: float
) -> dict[str, Any]:
    """Write a program that reads back equal, and that played comes to its original's totals; return the summary."""
    text = write(program, (REVIEW, f"made by rough-turning {version('rough-turning')}: {options.command}", *comments))
    if read(text) != program:
        raise NcError("the program reads back as another: nothing was written")
    simulated = play(read(text))
    difference = simulated.difference(original)
    if not difference <= MAX_DIFFERENCE:
        raise NcError(
            f"the program read back comes to {simulated}, but what it was made from to {original}: {100.0 * difference:.1f} % "
            f"apart, where {100.0 * MAX_DIFFERENCE:g} % are allowed, and nothing was written; a smaller tolerance may help"
        )
    replace_file(options.out, lambda partial: partial.write_text(text, "ascii"))
    totals = {"original": asdict(original), "simulated": asdict(simulated), "largest_difference": difference}
    return {"path": str(options.out), "bars": len(program.bars), "blocks": program.blocks} | summary | totals


def _lines(done: dict[str, Any]) -> str:
    countable = [name for name in ("bars", "blocks", "polynomials", "actions") if name in done]
    counts = ", ".join(f"{done[name]} {name if done[name] != 1 else name.removesuffix('s')}" for name in countable)
    lines = [f"{done['path']}: {counts}"]
    if "steps" in done:
        largest, mean = done["largest_override_difference"], done["mean_override_difference"]
        lines.append(
            f"override: at most {largest:.3f} percentage points off the controller, mean {mean:.3f} over {done['steps']} steps"
        )
    for name, of in (("original", "original"), ("simulated", "read back and played")):
        if name in done:
            totals = done[name]
            lines.append(f"{of}: {totals['removed']:.2f} cm3 removed in {totals['time']:.3f} min, wear {totals['wear']:.4f} mm")
    if "largest_difference" in done:
        lines.append(f"largest difference: {100.0 * done['largest_difference']:.3f} %")
    return "\n".join(lines)
