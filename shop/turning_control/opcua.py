"""OPC UA: an adapter for controls with nodes for their readings and an override (extra ``opcua``).

A TOML file names the nodes (``docs/connect_a_lathe.md``). Readings are the fields of
``readings.Readings`` except ``engaged_time``. In place of ``new_edge`` there may be ``edge``, a
counter of edge changes. ``alive`` counts this program's cycles. The control must fall back to the
safe feed by itself when the counter stops: nothing else tells it that this program has died or
hangs.

``opcua_security.py`` opens the connection; ``core.py`` decides.
"""

import contextlib
import math
import time
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from turning_control.core import Commands, Controller, Status
from turning_control.opcua_security import Security, connected
from turning_control.readings import SWITCHES, Readings
from turning_control.shield import LOG
from turning_control.watch import STUCK_INTERVALS, STUCK_TIME

from turning_env.files import read_regular
from turning_env.scenario.scenario import MAX_TOML

NEEDED = ("spindle_speed", "feed_velocity", "in_feed", "cutting")
READINGS = {field.name for field in fields(Readings)} - {"engaged_time", "new_edge"} | {"edge"}
COMMANDS = {"adaptive_feed", "spindle_override", "status", "alive"}
ALIVE_WRAP = 2**15  # at which ``alive`` wraps to 0, so that it fits a signed 16-bit node


class Nodes(NamedTuple):
    """What a file of nodes says."""

    readings: dict[str, str]  # node ids by the names of readings
    commands: dict[str, str]  # node ids by the names of commands
    # Highest ages by the names of readings [s]; others have the default.
    max_ages: dict[str, float]


def load_nodes(path: Path) -> Nodes:
    """Return the nodes that a file names.

    ValueError if the file is not TOML, a name is unknown or missing, a node id is no text, or an
    age is not above 0; OSError if the file cannot be read.
    """
    try:
        plan = tomllib.loads(read_regular(path, MAX_TOML).decode())
    except ValueError as error:  # no TOML, or no text
        raise ValueError(f"{path} is not TOML: {error}") from error
    for section, values in plan.items():
        if not isinstance(values, dict):
            raise ValueError(f"{path}: {section!r} is {values!r}, but must be a table")
    nodes = Nodes(
        readings=plan.get("readings", {}),
        commands=plan.get("commands", {}),
        max_ages=plan.get("max_age", {}),
    )
    _check_names(path, "readings", names=nodes.readings, allowed=READINGS)
    _check_names(path, "commands", names=nodes.commands, allowed=COMMANDS)
    _check_names(path, "max_age", names=nodes.max_ages, allowed=set(nodes.readings))
    named = {**nodes.readings, **nodes.commands}
    for name in (*NEEDED, "adaptive_feed"):
        if name not in named:
            raise ValueError(f"{path}: {name!r} is missing")
    for name, node in named.items():
        if not isinstance(node, str):
            raise ValueError(f"{path}: {name!r} is {node!r}, but must be a node id in quotes")
    for name, age in nodes.max_ages.items():
        if not isinstance(age, int | float) or not age > 0.0:
            raise ValueError(f"{path}: max_age of {name!r} is {age}, but must be above 0 s")
    return nodes


def _check_names(path: Path, section: str, names: Mapping[str, object], allowed: set[str]) -> None:
    """Raise ValueError if a section of the file has a name that is not allowed."""
    unknown = sorted(set(names) - allowed)
    if unknown:
        raise ValueError(
            f"{path}: {section} has {unknown[0]!r}, but must be one of {', '.join(sorted(allowed))}"
        )


class Ages:
    """The ages of values by the timestamps of their source.

    A value is as old as the newest one was when it last advanced, and older by the difference of
    both timestamps. So no clock needs to agree with this computer's.
    """

    def __init__(self) -> None:
        self._newest: datetime | None = None
        self._advanced = -math.inf  # when the newest timestamp was seen to advance [s]

    def of(self, stamps: Mapping[str, datetime | None], now: float) -> dict[str, float]:
        """Return the ages [s] of values by their timestamps; infinite if one is not known.

        Until timestamps advance for the first time, all are.

        Args:
            stamps: timestamps by name; None: the source gives none.
            now: time of a clock that never goes back [s].
        """
        known = [stamp for stamp in stamps.values() if stamp is not None]
        if not known:
            return dict.fromkeys(stamps, math.inf)
        newest = max(known)
        if self._newest is not None and newest > self._newest:
            self._advanced = now
        self._newest = newest
        ages = {}
        for name, stamp in stamps.items():
            behind = math.inf if stamp is None else (newest - stamp).total_seconds()
            ages[name] = behind + now - self._advanced
        return ages


def drive(
    controller: Controller,
    url: str,
    nodes: Path,
    interval: float,
    runs: Callable[[], bool] = lambda: True,
    security: Security = Security(),  # noqa: B008 - immutable
) -> None:
    """Read, decide and command once per control interval until stopped; then leave the safe feed.

    Args:
        controller: decides on commands.
        url: of the server, such as ``opc.tcp://127.0.0.1:4840``.
        nodes: TOML file that names the nodes.
        interval: control interval [s].
        runs: whether to go on; asked once per cycle.
        security: credentials, and what the connection must be.

    Raises:
        OSError: The connection cannot be made, or is lost.
        UserError: The server offers no connection that fits ``security``.
    """
    from asyncua import ua
    from asyncua.ua.attribute_ids import AttributeIds

    plan = load_nodes(nodes)
    max_age = max(STUCK_TIME, STUCK_INTERVALS * interval)
    safe = Commands(
        adaptive_feed=controller.safe_feed,
        spindle_override=1.0,
        status=Status.SAFE,
        reason="stopped",
    )
    with connected(url, max(10.0 * interval, 1.0), security) as client:
        sources = [client.get_node(node_id) for node_id in plan.readings.values()]
        targets = {name: client.get_node(node_id) for name, node_id in plan.commands.items()}
        # A server refuses numbers of another type than the node's.
        types = {name: node.read_data_type_as_variant_type() for name, node in targets.items()}

        def send(commands: Commands, alive: int) -> None:
            values = {
                "adaptive_feed": commands.adaptive_feed,
                "spindle_override": commands.spindle_override,
                "status": int(commands.status),
                "alive": alive,
            }
            variants = [ua.Variant(values[name], types[name]) for name in targets]
            client.write_values(list(targets.values()), variants)

        before = time.monotonic()
        due = time.monotonic()
        edge: Any = None  # the counter of edge changes before
        alive = 0
        ages = Ages()
        try:
            while runs():
                now = time.monotonic()
                received = client.read_attributes(sources, AttributeIds.Value)
                values = dict(zip(plan.readings, received, strict=True))
                stamps = {name: data.SourceTimestamp for name, data in values.items()}
                good: dict[str, Any] = dict.fromkeys(values)
                for name, age in ages.of(stamps, now).items():
                    is_fresh = age <= plan.max_ages.get(name, max_age)
                    if is_fresh and values[name].StatusCode.is_good():
                        good[name] = values[name].Value.Value
                readings = readings_of(good, now - before, edge_before=edge)
                before = now
                if good.get("edge") is not None:
                    edge = good["edge"]
                alive = (alive + 1) % ALIVE_WRAP
                send(controller.decide(readings), alive)
                # After a late cycle, the next ones keep the interval instead of catching up.
                due = max(due + interval, time.monotonic())
                time.sleep(max(due - time.monotonic(), 0.0))
        finally:
            LOG.warning("stopped: the safe feed holds")
            send(safe, alive)


def readings_of(values: Mapping[str, Any], seconds: float, edge_before: Any) -> Readings:
    """Return readings of values by their names; None: the value is lost.

    Args:
        values: as the server sent them.
        seconds: time since the last readings [s].
        edge_before: the last good counter of edge changes; None: there was none.
    """
    in_feed = _switch(values["in_feed"])
    cutting = _switch(values["cutting"])
    # An edge whose state is not known wears.
    is_idle = in_feed is False or cutting is False
    new_edge: bool | None = False
    if "edge" in values:
        edge = values["edge"]
        new_edge = None if edge is None else edge_before is not None and edge != edge_before
    numbers = {"spindle_speed": math.nan, "feed_velocity": math.nan}
    for name, value in values.items():
        if name not in SWITCHES and name != "edge":
            numbers[name] = _number(value)
    return Readings(
        **numbers,
        in_feed=in_feed,
        cutting=cutting,
        engaged_time=0.0 if is_idle else seconds,
        new_edge=new_edge,
    )


def _switch(value: Any) -> bool | None:
    """Return a value that is true or false, or 1 or 0, as a switch; None if it is neither."""
    return bool(value) if value in (True, False) else None


def _number(value: Any) -> float:
    """Return a value as a number; NaN if it is none."""
    with contextlib.suppress(TypeError, ValueError):
        return float(value)
    return math.nan
