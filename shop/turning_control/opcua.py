"""OPC UA: an adapter for controls that serve their readings, and take an override, as nodes (extra ``opcua``).

A TOML file names the nodes (``docs/connect_a_lathe.md``). Readings are the fields of ``core.Readings`` but ``engaged_time``; in
place of ``new_edge`` there may be ``edge``, a counter of edge changes. ``alive`` counts this program's cycles: the control must
fall back to the safe feed itself when it stops changing, as nothing else tells it that this program has died or hangs.
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

NEEDED = "spindle_speed", "feed_velocity", "in_feed", "cutting"
READINGS = {field.name for field in fields(Readings)} - {"engaged_time", "new_edge"} | {"edge"}
COMMANDS = {"adaptive_feed", "spindle_override", "status", "alive"}


def load_nodes(path: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Return the node ids of readings and of commands by name; ValueError if one is unknown or missing."""
    plan = tomllib.loads(path.read_text())
    readings, commands = plan.get("readings", {}), plan.get("commands", {})
    for kind, names, allowed in (
        ("readings", readings, READINGS),
        ("commands", commands, COMMANDS),
    ):
        if unknown := sorted(set(names) - allowed):
            raise ValueError(
                f"{path}: {kind} has {unknown[0]!r}, but must be one of {', '.join(sorted(allowed))}"
            )
    if missing := [
        name for name in (*NEEDED, "adaptive_feed") if name not in {**readings, **commands}
    ]:
        raise ValueError(f"{path}: {missing[0]!r} is missing")
    return readings, commands


def drive(
    controller: Controller,
    url: str,
    nodes: Path,
    interval: float,
    runs: Callable[[], bool] = lambda: True,
    security: Security = Security(),  # noqa: B008
) -> None:
    """Read, decide and command once per control interval [s] until ``runs`` returns false; then leave the safe feed.

    ``url`` is the server's, such as ``opc.tcp://127.0.0.1:4840``, and ``nodes`` the file that names the nodes. OSError if the
    connection cannot be made, or is lost; UserError if the server offers no connection that fits ``security``.
    """
    from asyncua import ua
    from asyncua.ua.attribute_ids import AttributeIds

    read, commanded = load_nodes(nodes)
    safe = Commands(controller.safe_feed, 1.0, Status.SAFE, "stopped")
    with connected(url, max(10.0 * interval, 1.0), security) as client:
        sources = [client.get_node(each) for each in read.values()]
        targets = {name: client.get_node(each) for name, each in commanded.items()}
        types = {name: node.read_data_type_as_variant_type() for name, node in targets.items()}

        def send(commands: Commands, alive: int) -> None:
            values = {
                "adaptive_feed": commands.adaptive_feed,
                "spindle_override": commands.spindle_override,
            }
            values |= {"status": int(commands.status), "alive": alive}
            client.write_values(
                list(targets.values()), [ua.Variant(values[name], types[name]) for name in targets]
            )

        before, edge, alive, due = time.monotonic(), None, 0, time.monotonic()
        try:
            while runs():
                now = time.monotonic()
                values = dict(
                    zip(read, client.read_attributes(sources, AttributeIds.Value), strict=True)
                )
                good = {
                    name: each.Value.Value
                    for name, each in values.items()
                    if each.StatusCode.is_good()
                }
                readings = _readings(good, now - before, edge)
                before, edge, alive = now, good.get("edge", edge), (alive + 1) % 2**15
                send(controller.decide(readings) if set(NEEDED) <= set(good) else safe, alive)
                due = max(due + interval, time.monotonic())
                time.sleep(max(due - time.monotonic(), 0.0))
        finally:
            LOG.warning("stopped: the safe feed holds")
            send(safe, alive)


def _readings(values: dict[str, Any], seconds: float, edge: Any) -> Readings:
    """Return readings of the values that are good; others count as lost."""
    number = {
        name: float(value)
        for name, value in values.items()
        if name not in ("in_feed", "cutting", "edge")
    }
    in_feed, cutting = bool(values.get("in_feed")), bool(values.get("cutting"))
    number = {
        "spindle_speed": math.nan,
        "feed_velocity": math.nan,
        "engaged_time": seconds * (in_feed and cutting),
    } | number
    new_edge = edge is not None and values.get("edge", edge) != edge
    return Readings(**number, in_feed=in_feed, cutting=cutting, new_edge=new_edge)
