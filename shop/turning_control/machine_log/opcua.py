"""Read a machine over OPC UA (extra ``opcua``): browse, read and history read, nothing else.

Nodes are looked up by their browse names, never by node ids, in two companion specifications:

* OPC 40502, CNC systems: an object with ``CncSpindleList``, ``CncAxisList`` and ``CncChannelList``,
  in the namespace ``http://opcfoundation.org/UA/CNC`` (6.1 to 6.9).
* OPC 40501-1, machine tools (umati): ``Monitoring`` of a machine, for overrides that the first does
  not give, in the namespace ``http://opcfoundation.org/UA/MachineTool/``.

A file may name further nodes, for servers that follow neither. Where the server keeps a history,
what passed while the connection was lost is read from it; otherwise the record has a gap.
"""

import math
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from turning_control.machine_log.record import (
    QUANTITIES,
    Announcer,
    Runs,
    Sample,
    header_of,
    pause_until,
    silence,
)
from turning_control.opcua_security import Security, connected

from turning_env.console import UserError, printable
from turning_env.files import read_regular
from turning_env.scenario.scenario import MAX_TOML

CNC = "http://opcfoundation.org/UA/CNC"
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"
LISTS = ("CncSpindleList", "CncAxisList", "CncChannelList")
MAX_DEPTH = 6  # of objects below the folder Objects in which a machine is looked for
MAX_OBJECTS = 5000  # looked at before the search is given up
RUNNING = 1  # CncChannelProgramStatus: Running (OPC 40502, 9.5)
SERVER_STARTED = "i=2257"  # node of the time at which the server has started (OPC UA part 5, 12.5)
BROWSED = 0x1 | 0x2  # node classes: objects and variables

UNITS = {
    "kW": {"WTT": 1e-3, "KWT": 1.0, "BHP": 0.7457},
    "%": {"P1": 1.0, "C62": 100.0},
    "rev/min": {"C94": 1.0, "RPM": 1.0, "C97": 60.0, "RPS": 60.0},
    "mm/min": {"H81": 1.0, "C16": 60.0, "MTS": 6e4, "2X": 1e3},
    "N m": {"NU": 1.0},
    "mm": {"MMT": 1.0, "MTR": 1e3, "INH": 25.4},
    "-": {},
}
"""Sizes of the units that a node may have, by the unit of the record and the code of UN/ECE.

The id of EngineeringUnits is the code's letters as one number (OPC UA part 8, 5.6.3).
"""
NAMED_UNITS = {
    "kW": {"w": 1e-3, "kw": 1.0},
    "%": {"%": 1.0, "percent": 1.0},
    "rev/min": {"min\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}": 1.0, "1/min": 1.0, "rpm": 1.0},
    "mm/min": {"mm/min": 1.0, "mm/s": 60.0, "m/min": 1e3},
    "N m": {"n\N{MIDDLE DOT}m": 1.0, "nm": 1.0},
    "mm": {"mm": 1.0, "m": 1e3, "in": 25.4, "inch": 25.4},
    "-": {},
}
"""The same by the displayed name in small letters, for servers with other ids."""
CNC_UNITS = {"spindle_power": 1e-3}
"""Sizes of units where a node of OPC 40502 states none: its nodeset has W for powers."""


class Wanted(NamedTuple):
    """A quantity, and browse names that lead to it; the first path that exists counts."""

    quantity: str
    paths: tuple[str, ...]


SPINDLE = (
    Wanted("spindle_speed", ("ActSpeed",)),
    Wanted("spindle_power", ("ActPower",)),
    Wanted("spindle_load", ("ActLoad",)),
    Wanted("spindle_torque", ("ActTorque",)),
    # The commanded override is the operator's switch; the actual one follows it.
    Wanted("spindle_override", ("ActOverride", "CmdOverride")),
)
CHANNEL = (
    Wanted("feed_rate", ("ActFeedrate",)),
    Wanted("feed_override", ("ActOverride", "CmdOverride")),
    Wanted("x", ("PosTcpWcsX/ActPos",)),
    Wanted("z", ("PosTcpWcsZ/ActPos",)),
    Wanted("running", ("ActProgramStatus",)),
    Wanted("tool", ("ToolId",)),
)
MONITORED = (
    Wanted("feed_override", ("FeedOverride",)),
    Wanted("rapid_override", ("RapidOverride",)),
    Wanted("spindle_override", ("Override",)),
)


class Child(NamedTuple):
    """A node below another."""

    name: str  # browse name
    namespace: int  # of the browse name
    node: Any


@dataclass(frozen=True)
class Parts:
    """The parts of a machine to read, where it has more than one; names as on the server."""

    machine: str | None = None
    spindle: str | None = None
    channel: str | None = None


@dataclass(frozen=True)
class NodeReading:
    """A node to read."""

    quantity: str
    node: Any
    where: str  # browse path, for people
    factor: float  # size of the node's unit in the record's; NaN if the unit is not known
    unit: str  # as the server displays it; empty if it states none


class OpcUaSource:
    """A machine that serves OPC UA, read once per interval."""

    def __init__(
        self,
        url: str,
        interval: float,
        parts: Parts,
        security: Security,
        nodes: Path | None = None,
    ) -> None:
        """Keep the settings; nothing is connected yet.

        Args:
            url: of the server, such as ``opc.tcp://192.0.2.1:4840``.
            interval: time between two reads [s].
            parts: which spindle and channel to read.
            security: credentials, and what the connection must be.
            nodes: TOML file with node ids of quantities, for servers of no companion specification.

        Raises:
            UserError: The file names an unknown quantity.
        """
        self._url = url
        self._interval = interval
        self._parts = parts
        self._security = security
        self._stated = {} if nodes is None else _load_nodes(nodes)
        self._announcer = Announcer()

    def found(self) -> list[str]:
        with self._connected() as client:
            return [_describe(reading) for reading in self._readings(client)]

    def samples(self, last: Sample | None, runs: Runs) -> Iterator[Sample]:
        from asyncua.ua.attribute_ids import AttributeIds

        with self._connected() as client:
            readings = self._readings(client)
            self._announcer.say([_describe(reading) for reading in readings])
            nodes = [reading.node for reading in readings]
            due = time.monotonic()
            while runs():
                received = client.read_attributes(nodes, AttributeIds.Value)
                now = datetime.now(UTC)
                gap = silence(last, now, self._interval)
                if gap and last is not None:
                    past, lacking = _history(client, readings, last=last, now=now)
                    yield from past
                    gap = f"{gap}: {lacking}" if lacking else ""
                sample = _sample(readings, received, Sample(time=now, gap=gap))
                yield sample
                last = sample
                # After a late cycle, the next ones keep the interval instead of catching up.
                due = max(due + self._interval, time.monotonic())
                pause_until(due, runs)

    def _connected(self) -> Any:
        return connected(self._url, max(10.0 * self._interval, 5.0), self._security)

    def _readings(self, client: Any) -> list[NodeReading]:
        """Return the nodes to read; UserError if there are none."""
        browser = Browser(client)
        readings: dict[str, NodeReading] = {}
        candidates = [*_stated(browser, self._stated), *_standard(browser, self._parts)]
        for reading in candidates:
            readings.setdefault(reading.quantity, reading)
        if not readings:
            raise UserError(
                f"{self._url} follows neither OPC 40502 (CNC systems) nor OPC 40501-1 (machine "
                "tools): name its nodes in a file, --nodes FILE"
            )
        return list(readings.values())


def _load_nodes(path: Path) -> dict[str, str]:
    """Return the node ids of quantities in a file; UserError if a name is unknown."""
    try:
        plan = tomllib.loads(read_regular(path, MAX_TOML).decode())
    except ValueError as error:
        raise UserError(f"{path} is not TOML: {error}") from error
    allowed = [*QUANTITIES, "tool"]
    for name, node in plan.items():
        if name not in allowed:
            raise UserError(f"{path}: {name!r} is not one of {', '.join(allowed)}")
        if not isinstance(node, str):
            raise UserError(f"{path}: {name} is {node!r}, but must be a node id in quotes")
    return plan


class Browser:
    """Looks at the children of nodes, once at each; it can do nothing else with them."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self._seen: dict[str, list[Child]] = {}

    def children(self, node: Any) -> list[Child]:
        """Return the objects and variables below a node."""
        identity = node.nodeid.to_string()
        if identity in self._seen:
            return self._seen[identity]
        children: list[Child] = []
        for reference in node.get_children_descriptions(nodeclassmask=BROWSED):
            name = reference.BrowseName
            child = self.client.get_node(reference.NodeId)
            children.append(Child(name.Name, name.NamespaceIndex, child))
        self._seen[identity] = children
        return children

    def child(self, node: Any, name: str, namespace: int) -> Any:
        """Return the child with a browse name, or None."""
        for child in self.children(node):
            if (child.name, child.namespace) == (name, namespace):
                return child.node
        return None

    def having(self, names: Sequence[str], namespace: int) -> Iterator[tuple[Child, list[Child]]]:
        """Yield the objects that have children of all these names, and their children."""
        level = [Child("Objects", 0, self.client.nodes.objects)]
        visited = set()
        for _ in range(MAX_DEPTH):
            below = []
            for candidate in level:
                identity = candidate.node.nodeid.to_string()
                if identity in visited or candidate.name in ("Server", "Types"):
                    continue
                visited.add(identity)
                if len(visited) > MAX_OBJECTS:
                    return
                children = self.children(candidate.node)
                present = {child.name for child in children if child.namespace == namespace}
                if present.issuperset(names):
                    yield candidate, children
                else:
                    below += children
            level = below


def _stated(browser: Browser, nodes: Mapping[str, str]) -> Iterator[NodeReading]:
    """Yield the readings of nodes that the user names."""
    from asyncua.ua.uaerrors import UaError

    for quantity, node_id in nodes.items():
        try:
            node = browser.client.get_node(node_id)
            node.read_browse_name()
        except (UaError, ValueError) as error:
            raise UserError(
                f"{quantity} = {node_id!r}: the server has no such node ({type(error).__name__})"
            ) from error
        yield _reading(browser, quantity, [node], where=node_id, size=1.0)


def _standard(browser: Browser, parts: Parts) -> Iterator[NodeReading]:
    """Yield the readings that companion specifications name."""
    namespaces = browser.client.get_namespace_array()
    if CNC in namespaces:
        index = namespaces.index(CNC)
        machines = {}
        for machine, children in browser.having(LISTS, index):
            machines[machine.name] = children
        lists = _chosen(machines, parts.machine, "--machine")
        if lists is not None:
            yield from _cnc_readings(browser, lists, parts=parts, namespace=index)
    if MACHINE_TOOL in namespaces:
        yield from _monitored(browser, namespaces.index(MACHINE_TOOL), parts)


def _chosen(candidates: Mapping[str, Any], name: str | None, option: str) -> Any:
    """Return the candidate that the user names, or the only one; None if there is none.

    UserError if the name is unknown, or more than one could be meant.
    """
    listed = ", ".join(candidates)
    if name is not None and candidates:
        if name not in candidates:
            raise UserError(f"{option} is {name!r}, but the server has {listed}")
        return candidates[name]
    if len(candidates) > 1:
        raise UserError(
            f"the server has {listed}: say which one, {option} {next(iter(candidates))}"
        )
    return next(iter(candidates.values()), None)


def _cnc_readings(
    browser: Browser, lists: Sequence[Child], parts: Parts, namespace: int
) -> Iterator[NodeReading]:
    """Yield the readings of the spindle, the axes and the channel of OPC 40502."""
    members = {}
    for item in lists:
        if item.name in LISTS:
            children = browser.children(item.node)
            # A list holds its version beside its members.
            members[item.name] = {
                child.name: child for child in children if child.name != "NodeVersion"
            }
    spindle = _chosen(members["CncSpindleList"], parts.spindle, "--spindle")
    channel = _chosen(members["CncChannelList"], parts.channel, "--channel")
    for part, wanted in ((spindle, SPINDLE), (channel, CHANNEL)):
        if part is not None:
            yield from _wanted(browser, part, wanted=wanted, namespace=namespace)
    for name, axis in members["CncAxisList"].items():
        quantity = f"{name[0].lower()}_load"
        # Names such as X, X1 and "X axis"; a second X axis comes second and does not count.
        if quantity in QUANTITIES:
            load = (Wanted(quantity, ("ActLoad",)),)
            yield from _wanted(browser, axis, wanted=load, namespace=namespace)


def _monitored(browser: Browser, namespace: int, parts: Parts) -> Iterator[NodeReading]:
    """Yield the overrides of channels and spindles of OPC 40501-1."""
    machines = {}
    for machine, children in browser.having(["Monitoring"], namespace):
        monitoring = next(child for child in children if child.name == "Monitoring")
        machines[machine.name] = monitoring
    monitoring = _chosen(machines, parts.machine, "--machine")
    if monitoring is None:
        return
    elements = browser.children(monitoring.node)
    # The override of the whole machine comes last: it counts if no channel has one.
    elements.sort(key=lambda element: element.name == "MachineTool")
    stated = {parts.spindle, parts.channel}
    elements.sort(key=lambda element: element.name not in stated)
    for element in elements:
        yield from _wanted(browser, element, wanted=MONITORED, namespace=namespace)


def _wanted(
    browser: Browser, part: Child, wanted: Sequence[Wanted], namespace: int
) -> Iterator[NodeReading]:
    """Yield the readings of quantities below a part of a machine."""
    for quantity, paths in wanted:
        for path in paths:
            chain = _follow(browser, part.node, path, namespace=namespace)
            if chain:
                size = CNC_UNITS.get(quantity, 1.0)
                where = f"{part.name}/{path}"
                yield _reading(browser, quantity, chain, where=where, size=size)
                break


def _follow(browser: Browser, start: Any, path: str, namespace: int) -> list[Any]:
    """Return the nodes along a path of browse names, the last first; none if it leads nowhere."""
    chain: list[Any] = []
    node = start
    for name in path.split("/"):
        node = browser.child(node, name, namespace)
        if node is None:
            return []
        chain.insert(0, node)
    return chain


def _reading(
    browser: Browser, quantity: str, chain: Sequence[Any], where: str, size: float
) -> NodeReading:
    """Return the reading of the first node of a chain.

    Its unit is that of the node, or else of the node above it, or else ``size``.
    """
    for node in chain:
        for child in browser.children(node):
            if child.name == "EngineeringUnits":
                name, unit_id = _unit(child.node.read_value())
                if name:
                    known = _size(quantity, unit_id, name)
                    return NodeReading(quantity, chain[0], where=where, factor=known, unit=name)
    return NodeReading(quantity, chain[0], where=where, factor=size, unit="")


def _unit(stated: Any) -> tuple[str, int]:
    """Return the displayed name and the id of EngineeringUnits; no name if they are empty."""
    unit_id = getattr(stated, "UnitId", 0)
    name = getattr(getattr(stated, "DisplayName", None), "Text", None)
    if not name and unit_id <= 0:
        return "", 0
    return printable(name or str(unit_id)), unit_id


def _size(quantity: str, unit_id: int, name: str) -> float:
    """Return the size of a unit in the record's; NaN if it is not known."""
    if quantity not in QUANTITIES:
        return 1.0
    record_unit = QUANTITIES[quantity].metadata["unit"]
    for code, size in UNITS[record_unit].items():
        if int.from_bytes(code.encode(), "big") == unit_id:
            return size
    return NAMED_UNITS[record_unit].get(name.casefold().strip(), math.nan)


def _describe(reading: NodeReading) -> str:
    """Return where a quantity comes from, for people."""
    text = f"{header_of(reading.quantity)} from {reading.where}"
    if math.isnan(reading.factor):
        return f"{text}: NOT READ, its unit {reading.unit!r} is not known"
    if reading.unit:
        return f"{text} in {reading.unit}"
    if reading.quantity in ("running", "tool"):
        return text
    unit = "as W" if reading.factor == CNC_UNITS["spindle_power"] else "as it is"
    return f"{text}, which states no unit: taken {unit}"


def _sample(readings: Sequence[NodeReading], received: Sequence[Any], state: Sample) -> Sample:
    """Return a state with the values that were received; those of bad quality are left out."""
    values: dict[str, Any] = {}
    for reading, data in zip(readings, received, strict=True):
        if data.StatusCode.is_good() and data.Value is not None:
            values[reading.quantity] = _value(reading, data.Value.Value)
    return replace(state, **values)


def _value(reading: NodeReading, value: Any) -> Any:
    """Return a node's value in the record's unit; NaN if it is none."""
    if reading.quantity == "tool":
        return "" if value is None else str(value)
    if isinstance(value, bool) or reading.quantity == "running":
        return float(value == RUNNING)
    try:
        return float(value) * reading.factor
    except (TypeError, ValueError):
        return math.nan


class Change(NamedTuple):
    """A value that a node has had from a time on."""

    time: datetime
    reading: NodeReading
    data: Any


def _history(
    client: Any, readings: Sequence[NodeReading], last: Sample, now: datetime
) -> tuple[list[Sample], str]:
    """Return the samples that the server's history holds since the last one, and what it lacks."""
    start_node = client.get_node(SERVER_STARTED)
    started = start_node.read_value().replace(tzinfo=UTC)
    if started > last.time:
        return [], f"the server started at {started:%H:%M:%S} UTC"
    lacking = []
    changes = []
    for reading in readings:
        history = _node_history(reading.node, last.time, now)
        if history is None:
            lacking.append(reading.quantity)
        for data in history or ():
            if data.SourceTimestamp is not None:
                moment = data.SourceTimestamp.replace(tzinfo=UTC)
                changes.append(Change(moment, reading, data))

    unknown: dict[str, Any] = {}
    for name in lacking:
        unknown[name] = "" if name == "tool" else math.nan
    start = replace(last, gap="", **unknown)
    samples = _replayed(changes, start, now)
    lack = ""
    if lacking:
        lack = f"the server keeps no history of {', '.join(lacking)}"
    return samples, lack


def _node_history(node: Any, start: datetime, end: datetime) -> list[Any] | None:
    """Return the values that a node has had between two times; None if the server keeps none."""
    from asyncua.ua.attribute_ids import AttributeIds
    from asyncua.ua.uaerrors import UaError

    try:
        if not node.read_attribute(AttributeIds.Historizing).Value.Value:
            return None
        return list(node.read_raw_history(start, end))
    except UaError:
        return None


def _replayed(changes: Sequence[Change], state: Sample, now: datetime) -> list[Sample]:
    """Return a sample for each time after that of ``state`` at which a value has changed."""
    start = state.time
    samples: list[Sample] = []
    for change in sorted(changes, key=lambda change: change.time):
        if change.time >= now:
            break
        state = _sample([change.reading], [change.data], replace(state, time=change.time))
        if samples and samples[-1].time == state.time:
            samples.pop()
        if state.time > start:
            samples.append(state)
    return samples
