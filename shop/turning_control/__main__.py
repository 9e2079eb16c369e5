"""Guard policies, and run them on a real control.

python -m turning_control shield
python -m turning_control demo
python -m turning_control log opc.tcp://192.0.2.1:4840 --out log.csv
"""

import argparse
import logging
import signal
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from turning_control import adversary, linuxcnc, measure, opcua
from turning_control.core import Controller, on_control, safe_feed
from turning_control.linuxcnc import LinuxCncError, find_policy
from turning_control.machine_log import command as machine_log
from turning_control.security_options import add_security, security_of
from turning_control.shield import LOG, Settings
from turning_control.streams import standard_streams_taken

from turning_env import IDS
from turning_env.console import (
    Parser,
    UserError,
    described,
    exits,
    number_within,
    positive,
    print_json,
)
from turning_env.scenario import Scenario

# Tasks with an action per step, which the shield guards.
TASKS = [env_id for env_id in IDS if env_id != "RoughTurning-Batch-v0"]

ANSWERED = 0.8  # share of a control interval within which a policy's process must answer [-]

Run = Callable[[argparse.Namespace], int]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    parser = Parser(prog="python -m turning_control", **described(__doc__))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, run: Run, text: str) -> argparse.ArgumentParser:
        subparser = commands.add_parser(name, help=text, **described(run.__doc__))
        subparser.set_defaults(run=run)
        return subparser

    _add_shield(command("shield", _shield, "measure the shield in simulation"))
    _add_attack(command("attack", _attack, "search for policies that get past the shield"))
    demo = command("demo", _demo, "run policies through LinuxCNC")
    serve = command("serve", _serve, "answer a HAL component's pins with a policy")
    linked = command("opcua", _opcua, "drive a control that serves OPC UA")
    machine_log.add_log_options(
        command("log", machine_log.log, "record a machine, read-only: OPC UA, MTConnect, LinuxCNC")
    )
    machine_log.add_cuts_options(
        command("cuts", machine_log.find, "write the cuts of a record into a sheet for calibrate")
    )
    plant = command("plant", _plant, "answer a HAL component's pins in place of a lathe")

    demo.add_argument(
        "--policies",
        nargs="+",
        metavar="POLICY",
        help="programmed, a rule's name, module:object that you trust, or ONNX files",
    )
    demo.add_argument(
        "--bars",
        type=positive,
        default=2,
        metavar="N",
        help="bars per policy (default: %(default)s)",
    )
    _add_policy(serve)
    _add_policy(linked)
    linked.add_argument(
        "--url",
        required=True,
        metavar="URL",
        help="URL of the control's server, such as opc.tcp://192.0.2.1:4840",
    )
    linked.add_argument(
        "--nodes", type=Path, required=True, metavar="FILE", help="TOML file that names the nodes"
    )
    add_security(linked)
    plant.add_argument(
        "--log", type=Path, required=True, metavar="CSV", help="file for every cycle"
    )
    _add_seed(demo)
    _add_seed(plant)
    _add_scenario(demo)
    _add_scenario(serve)
    _add_scenario(linked)
    _add_scenario(plant)

    options = parser.parse_args(arguments)
    return exits(ValueError, LinuxCncError, KeyError, OSError)(options.run)(options)


def _add_shield(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--episodes",
        type=positive,
        default=1000,
        metavar="N",
        help="held-out seeds per task (default: %(default)s)",
    )
    parser.add_argument(
        "--env", nargs="+", choices=TASKS, default=TASKS, metavar="ID", help="tasks (default: all)"
    )
    parser.add_argument(
        "--agents",
        type=Path,
        default=Path("agents"),
        metavar="FOLDER",
        help="agents (default: %(default)s)",
    )
    parser.add_argument(
        "--target",
        type=number_within(0.1, 2, "-"),
        default=Settings.target,
        metavar="X",
        help="expected load over its limit that is allowed (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def _add_attack(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--env", choices=TASKS, default=TASKS[0], metavar="ID", help="task (default: %(default)s)"
    )

    def add_number(name: str, default: int, text: str) -> None:
        parser.add_argument(
            name, type=positive, default=default, metavar="N", help=f"{text} (default: %(default)s)"
        )

    add_number("--candidates", 40, "adversaries per generation")
    add_number("--generations", 4, "generations")
    add_number("--episodes", 12, "tuning seeds that each adversary plays")
    add_number("--worst", 5, "adversaries to report")
    parser.add_argument(
        "--held-out",
        type=int,
        default=0,
        metavar="N",
        help="held-out seeds that these play as well (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def _add_policy(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--policy",
        required=True,
        metavar="POLICY",
        help="as for demo; a file plays in a sandbox, a module in a process with your rights",
    )
    parser.add_argument("--log", type=Path, metavar="FILE", help="text file for every decision")


def _add_seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="determines bars and edges (default: %(default)s)",
    )


def _add_scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenario",
        default="override",
        metavar="NAME",
        help="preset or TOML file (default: %(default)s)",
    )


def _shield(options: argparse.Namespace) -> int:
    """Play random actions and the best shipped agent of every task, with and without the shield.

    python -m turning_control shield
    python -m turning_control shield --env RoughTurning-v0 --episodes 4 --json
    """
    LOG.setLevel(logging.ERROR)  # takeovers are counted
    settings = Settings(target=options.target)
    results = list(measure.rows(options.env, options.episodes, options.agents, settings))
    if options.json:
        print_json([result._asdict() for result in results])
    else:
        print(measure.table(results))
    return 0


def _attack(options: argparse.Namespace) -> int:
    """Search for policies that exceed limits most behind the shield.

    The search plays tuning seeds. The worst policies then play held-out seeds.

    python -m turning_control attack --held-out 256
    python -m turning_control attack --env RoughTurning-Shift-v0 --candidates 12 --generations 1
    """
    if options.held_out < 0:
        raise UserError(f"--held-out is {options.held_out}, but must be 0 or more")
    LOG.setLevel(logging.ERROR)  # takeovers are counted
    scenario = Scenario.load(IDS[options.env])
    budget = adversary.Budget(
        candidates=options.candidates,
        generations=options.generations,
        episodes=options.episodes,
        worst=options.worst,
        held_out=options.held_out,
    )
    attacks = list(adversary.attack(options.env, scenario, budget, Settings()))
    if options.json:
        print_json([asdict(attack) for attack in attacks])
    else:
        print(adversary.table(attacks))
    return 0


def _demo(options: argparse.Namespace) -> int:
    """Start LinuxCNC without a screen or hardware, and run policies on the same bars.

    python -m turning_control demo
    python -m turning_control demo --policies programmed --bars 1
    """
    # Exit by an exception, so that LinuxCNC is ended, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    scenario = Scenario.load(options.scenario)
    safe_share = safe_feed(scenario)
    comparisons = {}
    for policy in options.policies or _demo_policies():
        print(f"{policy} ...", file=sys.stderr)
        rows = linuxcnc.run(
            policy,
            options.scenario,
            bars=options.bars,
            seed=options.seed,
        )
        simulated = linuxcnc.simulated(
            policy,
            scenario,
            bars=options.bars,
            seed=options.seed,
        )
        name = Path(policy).stem if policy.endswith(".onnx") else policy
        comparisons[name] = linuxcnc.Comparison(
            linuxcnc=linuxcnc.figures(rows, safe_share),
            simulation=simulated,
        )
    print(linuxcnc.table(comparisons))
    return 0


def _demo_policies() -> list[str]:
    """Return the part program's feed, and the best rule and the best agent of the override."""
    policies = ["programmed"]
    agent = measure.best_agent("RoughTurning-Override-v1", Path("agents"))
    if agent is not None:
        policies += ["modified_fuzzy_override", str(agent)]
    return policies


def _serve(options: argparse.Namespace) -> int:
    """Answer lines of pins (JSON) with lines of commands; ``hal_bridge.py`` starts this.

    python -m turning_control serve --policy programmed --scenario override
    """
    scenario = _logged(options)
    deadline = ANSWERED * scenario.control.interval
    with standard_streams_taken() as streams:  # before a policy is loaded, which may print
        policy = find_policy(options.policy, scenario, deadline)
        linuxcnc.serve(on_control(scenario), policy, linuxcnc.Pins(*streams))
    return 0


def _opcua(options: argparse.Namespace) -> int:
    """Read a control's nodes and command its feed over OPC UA until interrupted.

    Then the safe feed holds.

    python -m turning_control opcua --policy programmed --url opc.tcp://lathe --nodes nodes.toml
    """
    scenario = _logged(options)
    policy = find_policy(options.policy, scenario, deadline=ANSWERED * scenario.control.interval)
    controller = Controller(on_control(scenario), policy)
    opcua.drive(
        controller,
        options.url,
        nodes=options.nodes,
        interval=scenario.control.interval,
        security=security_of(options),
    )
    return 0


def _logged(options: argparse.Namespace) -> Scenario:
    """Log every decision to a file, if one is given, and return the scenario."""
    if options.log:
        logging.basicConfig(filename=options.log, format="%(asctime)s %(message)s")
        LOG.setLevel(logging.DEBUG)
    return Scenario.load(options.scenario)


def _plant(options: argparse.Namespace) -> int:
    """Answer lines of pins (JSON) with simulated loads; ``hal_bridge.py`` starts this.

    python -m turning_control plant --scenario override --log plant.csv
    """
    scenario = Scenario.load(options.scenario)
    with standard_streams_taken() as streams:
        linuxcnc.serve_plant(scenario, options.seed, options.log, linuxcnc.Pins(*streams))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
