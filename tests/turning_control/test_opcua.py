"""The OPC UA adapter with a server on this machine."""

import math
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.walking import until
from turning_control import opcua
from turning_control.core import Controller, Status
from turning_env import Scenario
from turning_env.scoring.adapt import as_factory

STEADY = {
    "spindle_speed": 400.0,
    "feed_velocity": 100.0,
    "in_feed": True,
    "cutting": True,
    "power": 4.0,
    "thrust_force": 700.0,
    "edge": 0,
}
COMMANDS = {"adaptive_feed": 0.1, "spindle_override": 0.1, "status": 0, "alive": 0}
INTERVAL = 0.05


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[str, Path, dict[str, Any]]]:
    """Yield the URL of a server, the file that names its nodes, and the nodes."""
    asyncua = pytest.importorskip("asyncua.sync")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"opc.tcp://127.0.0.1:{free.getsockname()[1]}"
    server = asyncua.Server()
    server.set_endpoint(url)
    index = server.register_namespace("lathe")
    nodes = {name: server.nodes.objects.add_variable(index, name, value) for name, value in {**STEADY, **COMMANDS}.items()}
    for name in COMMANDS:
        nodes[name].set_writable()
    path = tmp_path / "nodes.toml"
    ids = {name: f'{name} = "{node.nodeid.to_string()}"' for name, node in nodes.items()}
    parts = "[readings]", *map(ids.get, STEADY), "[commands]", *map(ids.get, COMMANDS)
    path.write_text("\n".join(map(str, parts)))
    with server:
        yield url, path, nodes


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # asyncua's own
def test_the_policy_commands_a_server_and_falls_back_to_the_safe_feed(served: tuple[str, Path, dict[str, Any]]) -> None:
    url, path, nodes = served
    policy = as_factory(lambda observations: np.full((len(observations), 2), -0.1, np.float32))
    controller, stop = Controller(Scenario.load("rough_turning"), policy), threading.Event()
    thread = threading.Thread(target=opcua.drive, args=(controller, url, path, INTERVAL, lambda: not stop.is_set()))

    def status() -> int:
        nodes["power"].write_value(4.0 + 0.1 * np.random.default_rng(time.time_ns()).random())
        nodes["thrust_force"].write_value(700.0 + np.random.default_rng(time.time_ns()).random())
        return int(nodes["status"].read_value())

    thread.start()
    try:
        until(lambda: status() in (Status.POLICY, Status.SHIELD))
        assert nodes["adaptive_feed"].read_value() > 0.1
        alive = nodes["alive"].read_value()
        until(lambda: nodes["alive"].read_value() != alive)
        nodes["spindle_speed"].write_value(0.0)
        until(lambda: nodes["status"].read_value() == Status.OPERATOR and nodes["adaptive_feed"].read_value() == 0.0)
        nodes["spindle_speed"].write_value(400.0)
        nodes["power"].write_value(math.nan)
        until(lambda: nodes["status"].read_value() == Status.SAFE)
    finally:
        stop.set()
        thread.join(30.0)
    assert not thread.is_alive()
    assert nodes["adaptive_feed"].read_value() == pytest.approx(controller.safe_feed)
    assert nodes["status"].read_value() == Status.SAFE


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[readings]\nload = 'i=1'", "load"),
        ("[readings]\nspindle_speed = 'i=1'", "feed_velocity"),
        ("\n".join(["[readings]", *(f"{name} = 'i=1'" for name in opcua.NEEDED), "[commands]", "feed = 'i=2'"]), "feed"),
    ],
)
def test_a_file_of_nodes_that_does_not_fit_is_refused(text: str, named: str, tmp_path: Path) -> None:
    path = tmp_path / "nodes.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=named):
        opcua.load_nodes(path)
