"""Record a machine, and drive it by a policy behind the shield.

python -m turning_control log opc.tcp://192.0.2.1:4840 --out log.csv
python -m turning_control drive --policy programmed --simulated
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
from turning_control.pins import Pins
from turning_control.security_options import add_security, security_of
from turning_control.shield import LOG
from turning_control.streams import standard_streams_taken

from turning_env.console import DONE, Parser, UserError, described, exits, positive
from turning_env.scenario import Scenario

ANSWERED = 0.8  # share of a control interval within which a policy's process must answer [-]
BARS = 2  # that a run on the simulated lathe cuts

Run = Callable[[argparse.Namespace], int]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    parser = Parser(prog="python -m turning_control", **described(__doc__))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, run: Run, text: str) -> argparse.ArgumentParser:
        subparser = commands.add_parser(name, help=text, **described(run.__doc__))
        subparser.set_defaults(run=run)
        return subparser

    machine_log.add_options(
        command("log", machine_log.log, "record a machine, read-only, and find a record's cuts")
    )
    _add_drive_options(
        command("drive", _drive, "drive a control (OPC UA, LinuxCNC) or a simulated lathe")
    )
    options = parser.parse_args(arguments)
    return exits(ValueError, LinuxCncError, KeyError, OSError)(options.run)(options)


def _add_drive_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``drive``."""
    add = parser.add_argument
    add(
        "--policy",
        required=True,
        metavar="POLICY",
        help="programmed, a rule's name, an ONNX file, which plays in a sandbox, or module:object, "
        "which has a process with your rights",
    )
    add(
        "--scenario",
        default="override",
        metavar="NAME",
        help="preset or TOML file (default: %(default)s)",
    )
    add("--log", type=Path, metavar="FILE", help="text file for every decision")
    add(
        "--url",
        metavar="URL",
        help="URL of the control's server, such as opc.tcp://192.0.2.1:4840 (default: HAL pins)",
    )
    add("--nodes", type=Path, metavar="FILE", help="TOML file that names the server's nodes")
    add_security(parser)

    group = parser.add_argument_group("simulated lathe")
    group.add_argument(
        "--simulated",
        action="store_true",
        help="start LinuxCNC without a screen or hardware, and drive a simulated lathe",
    )
    group.add_argument("--bars", type=positive, metavar="N", help=f"bars to cut (default: {BARS})")
    group.add_argument(
        "--seed", type=int, metavar="N", help="determines bars and edges (default: 0)"
    )


def _drive(options: argparse.Namespace) -> int:
    """Read a control and command its feed, behind the shield, until interrupted.

    With --url, a server of OPC UA is read and commanded; in the end the safe feed holds. With
    --simulated, LinuxCNC runs a simulated lathe, and a table compares it with the simulation.
    With neither, lines of LinuxCNC's pins (JSON) are answered, for which hal_bridge.py starts this
    command.

    python -m turning_control drive --policy programmed --simulated --bars 1
    python -m turning_control drive --policy programmed --url opc.tcp://lathe --nodes nodes.toml
    python -m turning_control drive --policy programmed --scenario override
    """
    if (options.url is None) != (options.nodes is None):
        raise UserError("--url and --nodes belong together")
    if options.simulated and options.url is not None:
        raise UserError("--simulated drives a lathe of its own, without --url")
    if not options.simulated and (options.bars is not None or options.seed is not None):
        raise UserError("--bars and --seed belong to --simulated")
    if options.simulated:
        return _drive_simulated(options)

    if options.log:
        logging.basicConfig(filename=options.log, format="%(asctime)s %(message)s")
        LOG.setLevel(logging.DEBUG)
    scenario = Scenario.load(options.scenario)
    deadline = ANSWERED * scenario.control.interval
    if options.url is None:
        with standard_streams_taken() as streams:  # before a policy is loaded, which may print
            policy = find_policy(options.policy, scenario, deadline)
            linuxcnc.serve(on_control(scenario), policy, Pins(*streams))
        return DONE
    opcua.drive(
        Controller(on_control(scenario), find_policy(options.policy, scenario, deadline)),
        options.url,
        nodes=options.nodes,
        interval=scenario.control.interval,
        security=security_of(options),
    )
    return DONE


def _drive_simulated(options: argparse.Namespace) -> int:
    """Run a policy through LinuxCNC and in the simulation, and print the figures of both."""
    # Exit by an exception, so that LinuxCNC is ended, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    scenario = Scenario.load(options.scenario)
    bars = options.bars or BARS
    seed = options.seed or 0
    rows = linuxcnc.run(
        options.policy,
        options.scenario,
        bars=bars,
        seed=seed,
        decisions=options.log,
    )
    comparison = linuxcnc.Comparison(
        linuxcnc=linuxcnc.figures(rows, safe_feed(scenario)),
        simulation=linuxcnc.simulated(options.policy, scenario, bars=bars, seed=seed),
    )
    name = Path(options.policy).stem if options.policy.endswith(".onnx") else options.policy
    print(linuxcnc.figures_table({name: comparison}))
    if warning := linuxcnc.lateness(comparison.linuxcnc):
        print(f"warning: {warning}", file=sys.stderr)
    return DONE


if __name__ == "__main__":
    raise SystemExit(main())
