"""Read a machine's MTConnect agent by HTTP GET: ``probe``, ``current`` and ``sample``.

An agent numbers observations and keeps the last of them in a buffer. Reading goes on at the number
after the last one recorded, also on a new connection, so that a lost connection loses nothing while
the buffer holds. There is a gap in two cases: the buffer has dropped observations in the meantime
(the agent answers OUT_OF_RANGE), or the agent has started anew (another ``instanceId``).

Data items are recognised by component, type and subtype (MTConnect part 2), never by id or name.
Documents with a DOCTYPE are refused: MTConnect has none, and entities could fill the memory.
"""

import base64
import http.client
import math
import ssl
import time
import urllib.error
import urllib.parse
import urllib.request
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element
from xml.parsers import expat

from turning_control.machine_log.record import Announcer, Runs, Sample, header_of, pause_until
from turning_control.opcua_security import Security

from turning_env.console import UserError, printable

COUNT = 1000  # observations per request; agents answer at most their buffer
TIMEOUT = 10.0  # [s]
MAX_PAUSE = 60.0  # time without a sample after which the state is recorded again [s]
MAX_TRIES = 5  # of reading the start of a buffer that moves on
MAX_BYTES = 50_000_000  # of an answer
UNAVAILABLE = "UNAVAILABLE"

SPINDLES = ("Rotary", "Spindle")  # components; Spindle until version 1.1
UNITS = {
    "PERCENT": 1.0,
    "WATT": 1e-3,
    "KILOWATT": 1.0,
    "NEWTON_METER": 1.0,
    "REVOLUTION/MINUTE": 1.0,
    "REVOLUTION/SECOND": 60.0,
    "DEGREE/SECOND": 1.0 / 6.0,
    "MILLIMETER": 1.0,
    "MILLIMETER_3D": 1.0,
    "MILLIMETER/SECOND": 60.0,
    "INCH": 25.4,
    "INCH/MINUTE": 25.4,
}
"""Sizes of units in those of the record (MTConnect part 2, units; native ones of old agents)."""


class Wanted(NamedTuple):
    """A data item that gives a quantity; the first of a table that a machine has counts."""

    quantity: str
    type: str
    subtypes: tuple[str, ...]  # the preferred one first
    unit: str = ""  # without a unit of its own; empty for items that are no numbers


ACTUAL = ("ACTUAL", "", "OVERRIDE")
PROGRAMMED = ("PROGRAMMED", "", "ACTUAL", "OVERRIDE")

SPINDLE = (
    Wanted("spindle_speed", "ROTARY_VELOCITY", ACTUAL, "REVOLUTION/MINUTE"),
    Wanted("spindle_speed", "SPINDLE_SPEED", ACTUAL, "REVOLUTION/MINUTE"),  # until version 1.1
    Wanted("spindle_power", "WATTAGE", ("ACTUAL", ""), "WATT"),
    Wanted("spindle_load", "LOAD", ("ACTUAL", ""), "PERCENT"),
    Wanted("spindle_torque", "TORQUE", ("ACTUAL", ""), "NEWTON_METER"),
    Wanted("spindle_override", "ROTARY_VELOCITY_OVERRIDE", PROGRAMMED, "PERCENT"),
)
PATH = (
    Wanted("feed_rate", "PATH_FEEDRATE", ("ACTUAL", ""), "MILLIMETER/SECOND"),
    Wanted("feed_override", "PATH_FEEDRATE_OVERRIDE", PROGRAMMED[:2], "PERCENT"),
    Wanted("rapid_override", "PATH_FEEDRATE_OVERRIDE", ("RAPID",), "PERCENT"),
    Wanted("spindle_override", "ROTARY_VELOCITY_OVERRIDE", PROGRAMMED, "PERCENT"),
    Wanted("position", "PATH_POSITION", ("ACTUAL", ""), "MILLIMETER_3D"),
    Wanted("running", "EXECUTION", ("",)),
    Wanted("tool", "TOOL_NUMBER", ("",)),
    Wanted("tool", "TOOL_ASSET_ID", ("",)),
    Wanted("tool", "TOOL_ID", ("",)),
)


def _axis(name: str) -> tuple[Wanted, ...]:
    """Return the data items of a linear axis."""
    return (
        Wanted(name, "POSITION", ("ACTUAL", ""), "MILLIMETER"),
        Wanted(f"{name}_load", "LOAD", ("ACTUAL", ""), "PERCENT"),
    )


@dataclass(frozen=True)
class Parts:
    """The parts of a machine to read, where there is more than one; names as in the probe."""

    machine: str | None = None
    spindle: str | None = None
    channel: str | None = None  # a Path


@dataclass(frozen=True)
class Item:
    """A data item to read."""

    quantity: str  # of the record, or ``position`` for a path's X, Y and Z
    id: str
    where: str  # for people
    factor: float  # size of the item's unit in the record's; NaN if the unit is not known
    unit: str


@dataclass(frozen=True)
class Mark:
    """The next observation to ask for."""

    instance: str  # of the agent, which numbers anew when it starts
    sequence: int

    def __str__(self) -> str:
        """Return the mark as in the record."""
        return f"{self.instance}:{self.sequence}"

    @classmethod
    def read(cls, text: str) -> "Mark | None":
        """Return the mark in a record; None if there is none."""
        instance, _, sequence = text.rpartition(":")
        return cls(instance, int(sequence)) if instance and sequence.isdigit() else None


class OutOfRangeError(Exception):
    """The agent no longer has the observation that was asked for."""


class MTConnectSource:
    """A machine with an MTConnect agent, asked for new observations once per interval."""

    def __init__(self, url: str, interval: float, parts: Parts, security: Security) -> None:
        """Keep the settings; nothing is connected yet.

        Args:
            url: of the agent, such as ``http://192.0.2.1:5000``.
            interval: time between two requests [s].
            parts: which device, spindle and path to read.
            security: user, certificates; modes and policies are those of OPC UA, except None.

        Raises:
            UserError: A password would be sent unencrypted.
        """
        self._url = url.rstrip("/")
        self._interval = interval
        self._parts = parts
        self._headers = _headers(url, security)
        self._opener = _opener(security)
        self._announcer = Announcer()

    def found(self) -> list[str]:
        _, items = self._probe()
        return [_describe(item) for item in items]

    def samples(self, last: Sample | None, runs: Runs) -> Iterator[Sample]:
        device, items = self._probe()
        self._announcer.say([_describe(item) for item in items])
        by_id = {item.id: item for item in items}
        mark = Mark.read(last.mark) if last else None
        if last is None or mark is None:
            answer = self._get(f"{device}/current")
            header = _header(answer)
            mark = Mark(header.instance, header.next)
            last = replace(_state(answer, by_id), time=header.created, mark=str(mark))
            yield last
        recorded_at = time.monotonic()
        while runs():
            try:
                answer = self._get(f"{device}/sample", **{"from": mark.sequence, "count": COUNT})
                header = _header(answer)
                is_lost = header.instance != mark.instance
            except OutOfRangeError:
                is_lost = True
            if is_lost:
                regained = self._after_loss(device, by_id, mark=mark, last=last)
                if regained is None:
                    pause_until(time.monotonic() + self._interval, runs)
                    continue
                last = regained
                mark = Mark.read(last.mark) or mark
                yield last
                continue
            changes = list(_changes(answer, by_id, last, instance=header.instance))
            yield from changes
            is_idle = not changes and header.next != mark.sequence
            if is_idle and time.monotonic() - recorded_at > MAX_PAUSE:
                # Other items have moved the buffer on, and the record must know.
                moment = max(last.time, header.created)
                still = Mark(header.instance, header.next)
                changes = [replace(last, time=moment, mark=str(still), gap="")]
                yield changes[0]
            if changes:
                last = changes[-1]
                recorded_at = time.monotonic()
            is_up_to_date = header.next > header.last or header.next == mark.sequence
            mark = Mark(header.instance, header.next)
            if is_up_to_date:
                pause_until(time.monotonic() + self._interval, runs)

    def _after_loss(
        self, device: str, by_id: Mapping[str, Item], mark: Mark, last: Sample
    ) -> Sample | None:
        """Return the first state that the agent still knows, with the gap before it.

        None if nothing is lost: some agents call the next observation out of range until it comes.
        """
        for _ in range(MAX_TRIES):
            header = _header(self._get(f"{device}/current"))
            is_same = header.instance == mark.instance
            if is_same and header.first <= mark.sequence <= header.next:
                return None
            try:
                answer = self._get(f"{device}/current", at=header.first)
            except OutOfRangeError:
                continue  # the buffer has moved on meanwhile
            if not is_same:
                gap = f"the agent has started anew: what followed {mark} until then is lost"
            else:
                gap = f"observations {mark.sequence} to {header.first - 1} have left the buffer"
            state = _state(answer, by_id)
            moment = max(last.time, state.time)
            next_mark = Mark(header.instance, header.first + 1)
            return replace(state, time=moment, mark=str(next_mark), gap=gap)
        raise ConnectionError(f"{self._url}: the buffer moves on faster than it can be read")

    def _probe(self) -> tuple[str, list[Item]]:
        """Return the device's name, quoted for addresses, and the data items to read."""
        root = self._get("probe")
        devices = {}
        for device in _named(root, "Device"):
            name = device.get("name") or device.get("uuid") or device.get("id") or ""
            devices[name] = device
        if not devices:
            raise UserError(f"{self._url}: the probe lists no device")
        name = _chosen(devices, self._parts.machine, option="--machine", plural="devices")
        items = _items(devices[name], self._parts)
        if not items:
            raise UserError(f"{self._url}: {name} has no load, speed, override or position")
        return urllib.parse.quote(name, safe=""), items

    def _get(self, path: str, **query: object) -> Element:
        """Return the document at a path.

        Raises:
            OutOfRangeError: The agent no longer has the observation.
            OSError: The agent cannot be reached, or answers something else.
        """
        address = f"{self._url}/{path}"
        if query:
            address += f"?{urllib.parse.urlencode(query)}"
        request = urllib.request.Request(address, headers=self._headers)
        try:
            with self._opener.open(request, timeout=TIMEOUT) as answer:
                data = answer.read(MAX_BYTES + 1)
        except urllib.error.HTTPError as error:
            if error.code in (401, 403):
                raise PermissionError(f"{address}: {error.reason}; is --user right?") from error
            data = error.read(MAX_BYTES + 1)  # an agent's errors are documents, too
        except OSError as error:
            reason = error.reason if isinstance(error, urllib.error.URLError) else error
            raise ConnectionError(f"{address} does not answer: {reason}") from error
        except http.client.HTTPException as error:
            raise ConnectionError(f"{address}: {type(error).__name__} {error}") from error
        root = parsed(data, address)
        if _local(root) == "MTConnectError":
            codes = [element.get("errorCode") for element in root.iter()]
            if "OUT_OF_RANGE" in codes:
                raise OutOfRangeError
            raise ConnectionError(f"{address}: {', '.join(code for code in codes if code)}")
        return root


def _headers(url: str, security: Security) -> dict[str, str]:
    """Return the headers of requests; UserError if the address or the security is wrong."""
    scheme = urllib.parse.urlsplit(url).scheme
    if scheme not in ("http", "https"):
        raise UserError(f"{url} must begin with http:// or https://")
    if security.policy not in (None, "None") or security.mode not in (None, "None"):
        raise UserError("--security-policy and --security-mode are of OPC UA; MTConnect has https")
    headers = {"Accept": "text/xml, application/xml"}
    if security.user is not None:
        if scheme == "http" and "None" not in (security.policy, security.mode):
            raise UserError(
                f"{url} would get the password unencrypted; give --security-policy None to accept "
                "this"
            )
        credentials = f"{security.user}:{security.password or ''}".encode()
        headers["Authorization"] = f"Basic {base64.b64encode(credentials).decode()}"
    return headers


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Follows nothing: a password must not go to another machine."""

    def redirect_request(self, *_: object) -> None:
        return None


def _opener(security: Security) -> urllib.request.OpenerDirector:
    """Return what opens addresses: without proxies and redirects, with the certificates given."""
    try:
        context = ssl.create_default_context(cafile=security.server_certificate)
        if security.certificate is not None:
            context.load_cert_chain(
                security.certificate, security.key, password=security.key_password or ""
            )
    except ssl.SSLError as error:
        raise UserError(f"a certificate or its key cannot be read: {error}") from error
    return urllib.request.build_opener(
        urllib.request.ProxyHandler({}),
        urllib.request.HTTPSHandler(context=context),
        _NoRedirect,
    )


def parsed(data: bytes, address: str) -> Element:
    """Return the root of an MTConnect document.

    ConnectionError if it is too long, is no XML or has a DOCTYPE, which could define entities.
    """
    if len(data) > MAX_BYTES:
        raise ConnectionError(f"{address}: more than {MAX_BYTES // 10**6} MB")

    def refuse(*_: object) -> None:
        raise ConnectionError(f"{address}: the document has a DOCTYPE, which MTConnect has not")

    checker = expat.ParserCreate()
    checker.StartDoctypeDeclHandler = refuse
    try:
        checker.Parse(data, True)
        root = ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError) as error:
        raise ConnectionError(f"{address}: this is no MTConnect document: {error}") from error
    if not _local(root).startswith("MTConnect"):
        raise ConnectionError(f"{address}: {_local(root)} is no MTConnect document")
    return root


def _local(element: Element) -> str:
    """Return the name of an element without its namespace, which holds the version."""
    return str(element.tag).rpartition("}")[2]


def _named(element: Element, name: str) -> Iterator[Element]:
    """Yield an element and those in it that have a name."""
    for inner in element.iter():
        if _local(inner) == name:
            yield inner


def _chosen(candidates: Mapping[str, object], name: str | None, option: str, plural: str) -> str:
    """Return the candidate that the user names, or the only one; UserError if there is no such.

    Args:
        candidates: the candidates by name.
        name: name that the user states, if any.
        option: option that states it.
        plural: word for candidates, for messages.
    """
    names = list(candidates)
    listed = ", ".join(names)
    if name is not None:
        if name not in candidates:
            raise UserError(f"{option} is {name!r}, but the {plural} are {listed or 'none'}")
        return name
    if len(names) != 1:
        example = names[0] if names else "NAME"
        raise UserError(f"the {plural} are {listed}: say which one, {option} {example}")
    return names[0]


@dataclass(frozen=True)
class Component:
    """A component of a device, with its data items and those of its own components."""

    kind: str
    name: str
    items: list[Element]


def _components(device: Element) -> list[Component]:
    """Return all components of a device."""
    components = []
    for holder in _named(device, "Components"):
        for element in holder:
            name = element.get("name") or element.get("nativeName") or element.get("id") or ""
            items = list(_named(element, "DataItem"))
            components.append(Component(_local(element), name, items))
    return components


def _items(device: Element, parts: Parts) -> list[Item]:
    """Return the data items of a device to read; the first of a quantity counts."""
    components = _components(device)
    spindles = {}
    paths = {}
    for component in components:
        types = {item.get("type") for item in component.items}
        if component.kind in SPINDLES and types & {"ROTARY_VELOCITY", "SPINDLE_SPEED"}:
            spindles[component.name] = component
        if component.kind == "Path":
            paths[component.name] = component

    items: dict[str, Item] = {}
    for part, name, wanted, option in (
        (spindles, parts.spindle, SPINDLE, "--spindle"),
        (paths, parts.channel, PATH, "--channel"),
    ):
        if part or name:
            word = option.removeprefix("--")
            chosen = _chosen(part, name, option=option, plural=f"{word}s")
            _add(items, part[chosen], wanted)
    for component in components:
        letter = component.name[:1].lower()
        if component.kind == "Linear" and letter in ("x", "z"):
            _add(items, component, _axis(letter))
        if component.kind == "Controller" and len(paths) <= 1:
            _add(items, component, PATH)
    if "position" in items:
        # The path's position is that of the tool's tip; an axis may count from elsewhere.
        items.pop("x", None)
        items.pop("z", None)
    return list(items.values())


def _add(found: dict[str, Item], component: Component, wanted: Sequence[Wanted]) -> None:
    """Add the data items of a component that are wanted and not found yet."""
    for quantity, kind, subtypes, unit in wanted:
        if quantity in found:
            continue
        fitting = []
        for item in component.items:
            is_wanted = item.get("type") == kind
            is_value = item.get("representation", "VALUE") == "VALUE"
            is_reading = item.get("category") != "CONDITION"
            subtype = item.get("subType") or ""
            if is_wanted and subtype in subtypes and is_value and is_reading:
                fitting.append(item)
        # Work coordinates count from the program's zero, machine coordinates from anywhere.
        fitting.sort(key=lambda item: item.get("coordinateSystem") != "WORK")
        fitting.sort(key=lambda item: subtypes.index(item.get("subType") or ""))
        if fitting:
            best = fitting[0]
            found[quantity] = _item(quantity, component, best, default_unit=unit)


def _item(quantity: str, component: Component, item: Element, default_unit: str) -> Item:
    """Return what to read of a data item; without a default, its quantity has no unit."""
    unit = ""
    factor = 1.0
    if default_unit:
        unit = item.get("units") or default_unit
        factor = UNITS.get(unit, math.nan)
    subtype = item.get("subType")
    kind = f"{item.get('type')} {subtype}" if subtype else item.get("type")
    return Item(
        quantity=quantity,
        id=item.get("id") or "",
        where=printable(f"{component.kind} {component.name}, {kind}"),
        factor=factor,
        unit=printable(unit),
    )


def _describe(item: Item) -> str:
    """Return where a quantity comes from, for people."""
    name = "x [mm] and z [mm]" if item.quantity == "position" else header_of(item.quantity)
    text = f"{name} from {item.where}"
    if math.isnan(item.factor):
        return f"{text}: NOT READ, its unit {item.unit!r} is not known"
    return f"{text} in {item.unit}" if item.unit else text


class _Header(NamedTuple):
    """The header of an answer."""

    instance: str
    first: int  # number of the oldest observation in the buffer
    last: int  # of the newest
    next: int  # to ask for next
    created: datetime


def _header(root: Element) -> _Header:
    """Return the header of an answer; ConnectionError if it lacks numbers."""
    header = next(_named(root, "Header"))
    try:
        return _Header(
            instance=header.attrib["instanceId"],
            first=int(header.attrib["firstSequence"]),
            last=int(header.attrib["lastSequence"]),
            next=int(header.attrib["nextSequence"]),
            created=_moment(header.attrib["creationTime"]),
        )
    except (KeyError, ValueError) as error:
        raise ConnectionError(f"the agent's header has no sequence numbers: {error}") from error


def _moment(text: str) -> datetime:
    """Return a time in UTC; statistics append a duration behind an "@"."""
    moment = datetime.fromisoformat(text.partition("@")[0])
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


class _Observation(NamedTuple):
    """A value of a data item from a time on."""

    sequence: int
    time: datetime
    item: Item
    text: str


def _observations(root: Element, by_id: Mapping[str, Item]) -> list[_Observation]:
    """Return the observations of the items that are read, by their numbers."""
    observations = []
    for element in root.iter():
        item = by_id.get(element.get("dataItemId", ""))
        if item is None:
            continue
        try:
            sequence = int(element.attrib["sequence"])
            moment = _moment(element.attrib["timestamp"])
        except (KeyError, ValueError) as error:
            raise ConnectionError(f"an observation of {item.id} is not valid: {error}") from error
        observations.append(_Observation(sequence, moment, item, text=(element.text or "").strip()))
    return sorted(observations, key=lambda observation: observation.sequence)


def _state(root: Element, by_id: Mapping[str, Item]) -> Sample:
    """Return the state that an answer to ``current`` holds."""
    state = Sample(time=datetime.min.replace(tzinfo=UTC))
    for observation in _observations(root, by_id):
        moment = max(state.time, observation.time)
        state = replace(state, time=moment, **_values(observation))
    return state


def _changes(
    root: Element, by_id: Mapping[str, Item], state: Sample, instance: str
) -> Iterator[Sample]:
    """Yield a sample for each time at which observations of ``sample`` have changed the state."""
    pending: Sample | None = None
    for observation in _observations(root, by_id):
        # Adapters' clocks may differ by a little: time never runs backwards in a record.
        moment = max(state.time, observation.time)
        if pending is not None and moment > pending.time:
            yield pending
        mark = Mark(instance, observation.sequence + 1)
        state = replace(state, time=moment, mark=str(mark), gap="", **_values(observation))
        pending = state
    if pending is not None:
        yield pending


def _values(observation: _Observation) -> dict[str, Any]:
    """Return the fields of a sample that an observation sets."""
    item = observation.item
    text = "" if observation.text == UNAVAILABLE else observation.text
    if item.quantity == "tool":
        return {"tool": text}
    if item.quantity == "running":
        running = math.nan
        if text:
            running = float(text == "ACTIVE")
        return {"running": running}
    if item.quantity == "position":
        numbers = [_number(part) * item.factor for part in text.split()]
        if len(numbers) != 3:
            return {"x": math.nan, "z": math.nan}
        x, _, z = numbers
        return {"x": x, "z": z}
    return {item.quantity: _number(text) * item.factor}


def _number(text: str) -> float:
    """Return a number; NaN if the text is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
