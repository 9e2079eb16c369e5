"""The command ``log`` of ``python -m turning_control``: records of machines, and their cuts."""

import argparse
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from turning_control.machine_log import cuts, mtconnect, opcua, record
from turning_control.machine_log.linuxcnc import LinuxCncSource
from turning_control.security_options import add_security, security_of

from turning_env.console import (
    DONE,
    UserError,
    number_within,
)

MIN_INTERVAL = 0.01  # [s]
# Options that only ``--cuts`` uses.
OF_CUTS = (
    "x",
    "diameter",
    "rated_power",
    "idle_power",
    "depth",
    "wear",
    "edge",
    "fresh",
    "overwrite",
)


def log(options: argparse.Namespace) -> int:
    """Record loads, speeds, overrides and positions of a machine until interrupted. Read-only.

    SOURCE is the machine: an address that begins with opc.tcp:// (OPC UA, found by the names of the
    companion specifications 40502 and 40501-1), http:// or https:// (MTConnect), or the word
    linuxcnc (on this computer). Nothing is written to the machine. A lost connection is made again;
    what cannot be had afterwards is a gap, which the record names. Interrupt with Ctrl-C.

    With --cuts, SOURCE is such a record, whose cuts become rows of a sheet for calibrate. A cut is
    a stretch at feed, with the power above that of idling, at one cutting speed and feed. Its power
    is the mean without its ends, less the idle power: that of the spindle turning at about this
    speed while no axis feeds. Depth of cut and wear are not known to a control: fill them in, or
    state one for all cuts.

    python -m turning_control log opc.tcp://192.0.2.1:4840 --out log.csv
    python -m turning_control log http://192.0.2.1:5000 --list
    python -m turning_control log linuxcnc --pin spindle_power=drive.power-kw --out log.csv
    python -m turning_control log log.csv --cuts cuts.csv --x diameter --depth 2
    python -m turning_control log log.csv --cuts cuts.csv --diameter 60 --rated-power 15
    """
    if options.cuts is not None:
        return _find_cuts(options)
    misplaced = _stated(options, OF_CUTS)
    if misplaced:
        raise UserError(f"{misplaced[0]} is for the cuts of a record, --cuts FILE")
    source = _source(options)
    if options.list:
        print("\n".join(source.found()))
        return DONE
    if options.out is None:
        raise UserError("--out FILE is missing; --list only says what the machine offers")
    stopped: list[bool] = []
    end = float("inf")
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
    last = record.last_sample(options.out, options.append)

    def runs() -> bool:
        return not stopped and time.monotonic() < end

    with record.Recorder(options.out) as recorder:
        try:
            for sample in record.reconnecting(source, last, runs):
                if options.duration and not recorder.count:
                    end = time.monotonic() + options.duration
                recorder.write(sample)
        except KeyboardInterrupt:
            print("stopped", file=sys.stderr)
    print(f"{recorder.count} samples, {recorder.gaps} gaps: {options.out}")
    return DONE


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``log``."""
    add = parser.add_argument
    add(
        "source",
        metavar="SOURCE",
        help="opc.tcp://HOST:PORT, http://HOST:PORT or linuxcnc; with --cuts a record",
    )
    add("--out", type=Path, metavar="CSV", help="record to write, line by line")
    add("--append", action="store_true", help="continue a record, from where it ends")
    add("--list", action="store_true", help="print what the machine offers, and record nothing")
    add(
        "--interval",
        type=number_within(MIN_INTERVAL, 3600.0, unit="s"),
        default=0.1,
        metavar="S",
        help="time between two reads [s] (default: %(default)s)",
    )
    add(
        "--duration",
        type=number_within(0.1, 1e7, unit="s"),
        metavar="S",
        help="stop this time after the first sample [s]",
    )
    add("--machine", metavar="NAME", help="machine, if the server has more than one")
    add("--spindle", metavar="NAME", help="spindle, if the machine has more than one")
    add("--channel", metavar="NAME", help="channel (path), if the machine has more than one")
    add(
        "--nodes",
        type=Path,
        metavar="TOML",
        help="OPC UA: node ids of quantities, for servers that follow no companion specification",
    )
    add(
        "--pin",
        action="append",
        default=[],
        type=_pin,
        metavar="QUANTITY=PIN",
        help="LinuxCNC: HAL pin or signal with a quantity in the record's unit; may be repeated",
    )
    add_security(parser)
    _add_cuts_options(parser)


def _pin(text: str) -> tuple[str, str]:
    """Return a quantity and its pin, as an argparse type."""
    name, _, pin = text.partition("=")
    if not pin or name not in record.QUANTITIES:
        raise argparse.ArgumentTypeError(
            f"{text!r} must be QUANTITY=PIN, where QUANTITY is {', '.join(record.QUANTITIES)}"
        )
    return name, pin


def _source(options: argparse.Namespace) -> record.Source:
    """Return the source that a user names."""
    name = options.source
    of_opcua = name.startswith("opc.tcp://")
    if options.nodes and not of_opcua:
        raise UserError("--nodes is for OPC UA, opc.tcp://HOST:PORT")
    if options.pin and name != "linuxcnc":
        raise UserError("--pin is for linuxcnc")
    if name == "linuxcnc":
        return LinuxCncSource(options.interval, dict(options.pin))
    parts: Any = {
        "machine": options.machine,
        "spindle": options.spindle,
        "channel": options.channel,
    }
    if of_opcua:
        return opcua.OpcUaSource(
            name,
            options.interval,
            parts=opcua.Parts(**parts),
            security=security_of(options),
            nodes=options.nodes,
        )
    if name.startswith(("http://", "https://")):
        return mtconnect.MTConnectSource(
            name,
            options.interval,
            parts=mtconnect.Parts(**parts),
            security=security_of(options),
        )
    raise UserError(
        f"SOURCE is {name!r}, but must begin with opc.tcp:// (OPC UA), http:// or https:// "
        "(MTConnect), or be linuxcnc; the cuts of a record need --cuts FILE"
    )


def _stated(options: argparse.Namespace, names: Sequence[str]) -> list[str]:
    """Return which of some options, that have no default, the user states."""
    stated = []
    for name in names:
        value = getattr(options, name)
        if value is not None and value is not False:  # 0 is stated
            stated.append(f"--{name.replace('_', '-')}")
    return stated


def _find_cuts(options: argparse.Namespace) -> int:
    """Write the cuts of a record into a sheet, one per row."""
    misplaced = _stated(options, ("out", "append", "list", "duration"))
    if misplaced:
        raise UserError(f"{misplaced[0]} is for a machine, but --cuts reads a record")
    sheet = options.cuts
    if sheet.exists() and not options.overwrite:
        raise UserError(f"{sheet} exists; --overwrite replaces it")
    settings = cuts.CutSettings(
        x=options.x,
        diameter=options.diameter,
        rated_power=options.rated_power,
        idle_power=options.idle_power,
        depth=options.depth,
        wear=options.wear,
        edge=options.edge,
        is_fresh=options.fresh,
    )
    result = cuts.find_cuts(cuts.read_record(Path(options.source), settings), settings)
    cuts.write_sheet(result.cuts, settings, sheet)
    for note in result.notes:
        print(note, file=sys.stderr)
    print(sheet)
    return DONE


def _add_cuts_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that find the cuts of a record."""
    add = parser.add_argument_group("cuts of a record").add_argument

    def add_number(name: str, low: float, high: float, unit: str, text: str) -> None:
        add(name, type=number_within(low, high, unit=unit), metavar="X", help=f"{text} [{unit}]")

    add("--cuts", type=Path, metavar="CSV", help="sheet to write from the record SOURCE")
    add(
        "--x",
        choices=("radius", "diameter"),
        help="what the record's x is, if the machine gives no diameter",
    )
    add_number("--diameter", 0.5, 5000.0, unit="mm", text="diameter of the bar in all cuts")
    add_number("--rated-power", 0.05, 1000.0, unit="kW", text="power at 100 %% of the load")
    add_number("--idle-power", 0.0, 500.0, unit="kW", text="idle power (default: as recorded)")
    add_number("--depth", 0.01, 50.0, unit="mm", text="depth of cut of all cuts")
    add_number("--wear", 0.0, 5.0, unit="mm", text="flank wear in all cuts; 0: fresh edges")
    add("--edge", metavar="NAME", help="edge of all cuts (default: the tool's number)")
    add(
        "--fresh",
        action="store_true",
        help="each tool had a fresh edge when the record began: write its cutting time",
    )
    add("--overwrite", action="store_true", help="replace an existing sheet")
