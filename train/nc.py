"""The command line ``python -m train.export --nc``: part programs of agents and controllers."""

import argparse
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
from turning_nc import schedule, simulate
from turning_nc.program import Program, read, read_file, write
from turning_nc.simulate import Totals
from turning_nc.words import NcError

PROGRAM = "python -m train.export --nc"
MAX_DIFFERENCE = 0.02
"""Largest relative difference of removed metal, time and wear between a program read back and its original."""
MAX_OVERRIDE_DIFFERENCE = 0.5
"""Largest difference between a law read back and its controller [percentage points of override]."""
REVIEW = (
    "Tool, zero offset, clamping, retraction, coolant, limits and every value must be checked by whoever is responsible for the "
    "machine."
)
CAUTION = f"Simulation output: not for a machine without review. {REVIEW}"
EXAMPLES = f"""\
{PROGRAM} schedule --agent agents/RoughTurning-v0/rough_turning/analytic_gradient-seed0.onnx --tuning-seed 0 --out bar.mpf
{PROGRAM} schedule --rule rescaled_grid_search --seed 7 --bars 3 --tolerance 0.05 --out bars.mpf
{PROGRAM} table --interval 1 --out edge.mpf
{PROGRAM} law --rule modified_fuzzy_override --out override.mpf
{PROGRAM} check bar.mpf --tuning-seed 0"""


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
    parser = argparse.ArgumentParser(prog=PROGRAM, **described(f"{about}\n\n{EXAMPLES}"))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(
        run: Callable[[argparse.Namespace], dict[str, Any]],
        scenario: str | None,
        about: str,
        *,
        seeded: bool = True,
        out: bool = True,
    ) -> argparse.ArgumentParser:
        name = run.__name__.removeprefix("_")
        examples = "\n".join(line for line in EXAMPLES.splitlines() if line.startswith(f"{PROGRAM} {name} "))
        details = described(f"{about[0].upper()}{about[1:]}. {CAUTION}\n\n{examples}")
        added = commands.add_parser(name, help=about, **details)
        added.set_defaults(run=run)
        default = scenario or "the agent's own, or rough_turning"
        added.add_argument("--scenario", default=scenario, help=f"preset or TOML file (default: {default})")
        added.add_argument("--json", action="store_true", help="print the summary as one line of JSON")
        if seeded:
            seeds = added.add_mutually_exclusive_group()
            tuning_help = "bars and edge of the tuning seed number N (default: 0)"
            seeds.add_argument("--tuning-seed", type=int, default=0, metavar="N", help=tuning_help)
            seeds.add_argument("--seed", type=int, metavar="S", help="bars and edge of any seed")
        if out:
            added.add_argument("--out", required=True, type=Path, metavar="FILE", help="program to write, such as bar.mpf")
        return added

    added = command(_schedule, None, "write the speeds and feeds that a policy commands on given bars, as blocks along Z")
    policy = added.add_mutually_exclusive_group(required=True)
    policy.add_argument("--agent", type=Path, metavar="FILE", help="an agent's ONNX file")
    policy.add_argument("--rule", metavar="NAME", help=f"a controller: {', '.join(catalogue.RULES)}")
    added.add_argument("--bars", type=int, default=1, metavar="N", help="the first N bars of the seed (default: 1)")
    tolerance_help = "largest relative difference of speeds and feeds that merge into one block (default: %(default)s)"
    added.add_argument("--tolerance", type=float, default=schedule.TOLERANCE, metavar="SHARE", help=tolerance_help)

    about = "write the speeds and feeds of the grid search for one edge on nominal models"
    added = command(_table, "rough_turning", about, seeded=False)
    interval_help = "cutting time of an interval (default: the scenario's control interval)"
    added.add_argument("--interval", type=float, metavar="MIN", help=interval_help)

    added = command(_law, "override", "write a controller from spindle load to feed override as synchronized actions")
    added.add_argument("--rule", required=True, metavar="NAME", help=f"one of {', '.join(nc_programs.LAWS)}")

    added = command(_check, "rough_turning", "read a program of one cut along bars and play it on given bars", out=False)
    added.add_argument("file", type=Path, metavar="FILE", help="the program")
    return parser


def _seed(options: argparse.Namespace) -> int:
    if options.seed is not None:
        return int(options.seed)
    if options.tuning_seed < 0:
        raise NcError(f"--tuning-seed is {options.tuning_seed}, but must be 0 or more")
    return tuning_seeds(options.tuning_seed + 1)[-1]


def _schedule(options: argparse.Namespace) -> dict[str, Any]:
    name, make, scenario = _policy(options)
    if not 0.0 <= options.tolerance <= 1.0:
        raise NcError(f"--tolerance is {options.tolerance}, but must be 0 to 1")
    merged = f"speeds and feeds within {100.0 * options.tolerance:g} % are one block"
    comment = f"{name} on scenario {scenario.name}, seed {_seed(options)}; {merged}"
    return _play(options, make, (scenario, scenario), _seed(options), options.bars, options.tolerance, comment)


def _table(options: argparse.Namespace) -> dict[str, Any]:
    scenarios = nc_programs.table_scenarios(Scenario.load(options.scenario), options.interval)
    even, longer = scenarios
    interval = f"an interval of {longer.control.interval / 60.0:g} min"
    comment = f"interval table of the grid search on the nominal models of scenario {even.name}: one edge, {interval}"
    make = catalogue.spec("grid_search", longer).make
    return _play(options, make, scenarios, 0, even.workpiece.bars or 1000, 0.0, comment)


def _play(
    options: argparse.Namespace,
    make: PolicyFactory,
    scenarios: tuple[Scenario, Scenario],
    seed: int,
    bars: int,
    tolerance: float,
    comment: str,
) -> dict[str, Any]:
    """Write the schedule of a policy on the second scenario, after a check on the first."""
    workpiece, comments = scenarios[0].workpiece, [comment]
    with tqdm(
        total=bars * (workpiece.approach + workpiece.bar_length), unit="mm", unit_scale=True, disable=None, leave=False
    ) as progress:
        program, original = simulate.play_schedule(
            make, scenarios[1], seed, bars, tolerance, lambda path: progress.update(path - progress.n)
        )
    if program.bars[-1][-1].z > 1e-3 - workpiece.bar_length or len(program.bars) < bars:
        comments.append(f"the edge or the time limit ended the episode in bar {len(program.bars)}: the program ends there")
    text, program = _read_back(program, comments, options)
    return _written(options, text, program, original, simulate.simulate(program, scenarios[0], seed))


def _policy(options: argparse.Namespace) -> tuple[str, PolicyFactory, Scenario]:
    if options.agent is None:
        scenario = Scenario.load(options.scenario or "rough_turning")
        return options.rule, catalogue.spec(options.rule, scenario).make, scenario
    agent = onnx_policy.load(options.agent)
    scenario = Scenario.load(options.scenario) if options.scenario or agent.trained_on is None else agent.trained_on
    check_fits(agent, scenario)
    return f"{agent.name} (training seed {agent.training_seed})", agent.make, scenario


def _law(options: argparse.Namespace) -> dict[str, Any]:
    scenario = Scenario.load(options.scenario)
    program = nc_programs.law_program(options.rule, scenario)
    by_power = f"spindle power over {scenario.machine.rated_power:g} kW"
    load = by_power if scenario.spindle.reading == "power" else "spindle torque over the torque available at its speed"
    comments = [
        f"feed override of {options.rule} on scenario {scenario.name}",
        f"$AA_LOAD[S1] is taken for {load}, in per cent; the law is made for an interpolation "
        f"cycle of {1000.0 * scenario.control.interval:g} ms",
    ]
    text, program = _read_back(program, comments, options)
    compared = simulate.compare(program, catalogue.spec(options.rule, scenario).make, scenario, _seed(options))
    if not compared.largest_difference <= MAX_OVERRIDE_DIFFERENCE:
        raise NcError(
            f"the law read back differs from {options.rule} by {compared.largest_difference:.2f} percentage points of override; "
            f"{MAX_OVERRIDE_DIFFERENCE} are allowed, and nothing was written"
        )
    return _written(
        *(options, text, program, compared.original, compared.simulated),
        polynomials=len(program.law.polynomials),
        actions=len(program.law.actions),
        steps=compared.steps,
        mean_override_difference=compared.mean_difference,
        largest_override_difference=compared.largest_difference,
    )


def _check(options: argparse.Namespace) -> dict[str, Any]:
    program = read_file(options.file)
    totals = simulate.simulate(program, Scenario.load(options.scenario), _seed(options))
    return {"path": str(options.file), "bars": len(program.bars), "blocks": program.blocks, "simulated": asdict(totals)}


def _read_back(program: Program, comments: list[str], options: argparse.Namespace) -> tuple[str, Program]:
    """Return a program's text, and the program that is read back from it."""
    text = write(program, (REVIEW, f"made by rough-turning {version('rough-turning')}: {options.command}", *comments))
    read_back = read(text)
    if read_back != program:
        raise NcError("the program reads back as another: nothing was written")
    return text, read_back


def _written(
    options: argparse.Namespace, text: str, program: Program, original: Totals, simulated: Totals, **summary: float
) -> dict[str, Any]:
    """Write a program whose totals agree with those of its original; return the summary."""
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
