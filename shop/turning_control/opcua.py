"""OPC UA: an adapter for controls with nodes for their readings and an override (extra ``opcua``).

A TOML file names the nodes (``docs/connect_a_lathe.md``). Readings are the fields of
``core.Readings`` except ``engaged_time``. In place of ``new_edge`` there may be ``edge``, a counter
of edge changes. ``alive`` counts this program's cycles. The control must fall back to the safe feed
by itself when the counter stops: nothing else tells it that this program has died or hangs.

``opcua_security.py`` opens the connection; ``core.py`` decides.
"""

import math
import time
import tomllib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from turning_control.core import Commands, Controller, Readings, Status
from turning_control.opcua_security import Security, connected
from turning_control.shield import LOG

NEEDED = ("spindle_speed", "feed_velocity", "in_feed", "cutting")
READINGS = {field.name for field in fields(Readings)} - {"engaged_time", "new_edge"} | {"edge"}
COMMANDS = {"adaptive_feed", "spindle_override", "status", "alive"}
NOT_NUMBERS = ("in_feed", "cutting", "edge")  # readings that are switches or a counter
ALIVE_WRAP = 2**15  # at which ``alive`` wraps to 0, so that it fits a signed 16-bit node


def load_nodes(path: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Return the node ids of readings and of commands by name.

    ValueError if a name is unknown or missing.
    """
    plan = tomllib.loads(path.read_text())
    readings = plan.get("readings", {})
    commands = plan.get("commands", {})
    _check_names(path, "readings", names=readings, allowed=READINGS)
    _check_names(path, "commands", names=commands, allowed=COMMANDS)
    named = {**readings, **commands}
    for name in (*NEEDED, "adaptive_feed"):
        if name not in named:
            raise ValueError(f"{path}: {name!r} is missing")
    return readings, commands


def _check_names(path: Path, section: str, names: dict[str, str], allowed: set[str]) -> None:
    """Raise ValueError if a section of the file has a name that is not allowed."""
    unknown = sorted(set(names) - allowed)
    if unknown:
        raise ValueError(
            f"{path}: {section} has {unknown[0]!r}, but must be one of {', '.join(sorted(allowed))}"
        )


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

    reading_ids, command_ids = load_nodes(nodes)
    safe = Commands(
        adaptive_feed=controller.safe_feed,
        spindle_override=1.0,
        status=Status.SAFE,
        reason="stopped",
    )
    with connected(url, max(10.0 * interval, 1.0), security) as client:
        sources = [client.get_node(node_id) for node_id in reading_ids.values()]
        targets = {name: client.get_node(node_id) for name, node_id in command_ids.items()}
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
        try:
            while runs():
                now = time.monotonic()
                received = client.read_attributes(sources, AttributeIds.Value)
                good: dict[str, Any] = {}
                for name, data in zip(reading_ids, received, strict=True):
                    if data.StatusCode.is_good():
                        good[name] = data.Value.Value
                readings = _readings(good, now - before, edge_before=edge)
                before = now
                edge = good.get("edge", edge)
                alive = (alive + 1) % ALIVE_WRAP
                # Without the readings that a decision needs, the controller is not asked.
                decidable = set(NEEDED) <= set(good)
                send(controller.decide(readings) if decidable else safe, alive)
                # After a late cycle, the next ones keep the interval instead of catching up.
                due = max(due + interval, time.monotonic())
                time.sleep(max(due - time.monotonic(), 0.0))
        finally:
            LOG.warning("stopped: the safe feed holds")
            send(safe, alive)


def _readings(values: dict[str, Any], seconds: float, edge_before: Any) -> Readings:
    """Return readings of the values that are good; others count as lost."""
    in_feed = bool(values.get("in_feed"))
    cutting = bool(values.get("cutting"))
    numbers = {
        "spindle_speed": math.nan,
        "feed_velocity": math.nan,
        "engaged_time": seconds * (in_feed and cutting),
    }
    for name, value in values.items():
        if name not in NOT_NUMBERS:
            numbers[name] = float(value)
    new_edge = edge_before is not None and values.get("edge", edge_before) != edge_before
    return Readings(**numbers, in_feed=in_feed, cutting=cutting, new_edge=new_edge)
