"""Record a machine, and drive it by a policy behind the shield.

python -m turning_control log opc.tcp://192.0.2.1:4840 --out log.csv
python -m turning_control demo
python -m turning_control drive --policy programmed --url opc.tcp://lathe --nodes nodes.toml
"""

import argparse
import logging
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from turning_control import linuxcnc, opcua
from turning_control.core import Controller, on_control, safe_feed
from turning_control.linuxcnc import LinuxCncError, find_policy
from turning_control.machine_log import command as machine_log
from turning_control.security_options import add_security, security_of
from turning_control.shield import LOG
from turning_control.streams import standard_streams_taken

from turning_env.console import Parser, UserError, described, exits, positive
from turning_env.scenario import Scenario

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

    machine_log.add_log_options(
        command("log", machine_log.log, "record a machine, read-only: OPC UA, MTConnect, LinuxCNC")
    )
    machine_log.add_cuts_options(
        command("cuts", machine_log.find, "write the cuts of a record into a sheet for calibrate")
    )
    drive = command("drive", _drive, "drive a control: OPC UA, or LinuxCNC's pins")
    demo = command("demo", _demo, "run policies through LinuxCNC")
    plant = command("plant", _plant, "answer a HAL component's pins in place of a lathe")

    demo.add_argument(
        "--policies",
        nargs="+",
        default=["programmed", "modified_fuzzy_override"],
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
    _add_policy(drive)
    drive.add_argument(
        "--url",
        metavar="URL",
        help="URL of the control's server, such as opc.tcp://192.0.2.1:4840 (default: HAL pins)",
    )
    drive.add_argument(
        "--nodes", type=Path, metavar="FILE", help="TOML file that names the server's nodes"
    )
    add_security(drive)
    plant.add_argument(
        "--log", type=Path, required=True, metavar="CSV", help="file for every cycle"
    )
    _add_seed(demo)
    _add_seed(plant)
    _add_scenario(demo)
    _add_scenario(drive)
    _add_scenario(plant)

    options = parser.parse_args(arguments)
    return exits(ValueError, LinuxCncError, KeyError, OSError)(options.run)(options)


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
    for policy in options.policies:
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


def _drive(options: argparse.Namespace) -> int:
    """Read a control and command its feed, behind the shield, until interrupted.

    With --url, a server of OPC UA is read and commanded; in the end the safe feed holds. Without,
    lines of LinuxCNC's pins (JSON) are answered, for which hal_bridge.py starts this command.

    python -m turning_control drive --policy programmed --url opc.tcp://lathe --nodes nodes.toml
    python -m turning_control drive --policy programmed --scenario override
    """
    if (options.url is None) != (options.nodes is None):
        raise UserError("--url and --nodes belong together")
    scenario = _logged(options)
    deadline = ANSWERED * scenario.control.interval
    if options.url is None:
        with standard_streams_taken() as streams:  # before a policy is loaded, which may print
            policy = find_policy(options.policy, scenario, deadline)
            linuxcnc.serve(on_control(scenario), policy, linuxcnc.Pins(*streams))
        return 0
    opcua.drive(
        Controller(on_control(scenario), find_policy(options.policy, scenario, deadline)),
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
