"""Records of a server of OPC 40502: what is found by its names, and what a silence loses."""

import itertools
import os
import socket
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from turning_control.machine_log.opcua import CNC, OpcUaSource, Parts
from turning_control.machine_log.record import Sample
from turning_control.opcua_security import Security

from turning_env.console import UserError

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]  # asyncua's own warnings

# Values of nodes by their browse paths, as the specification names them.
NODES: dict[str, float] = {
    "CncSpindleList/S1/ActSpeed": 900.0,
    "CncSpindleList/S1/ActPower": 4321.0,
    "CncSpindleList/S1/ActLoad": 33.0,
    "CncSpindleList/S1/CmdOverride": 95.0,
    "CncAxisList/X/ActLoad": 11.0,
    "CncAxisList/Z/ActLoad": 22.0,
    "CncChannelList/Channel 1/ActFeedrate": 3.75,
    "CncChannelList/Channel 1/CmdOverride": 80.0,
    "CncChannelList/Channel 1/PosTcpWcsX/ActPos": 40.5,
    "CncChannelList/Channel 1/ActProgramStatus": 1,
    "CncChannelList/Channel 1/ToolId": 3,
}
MILLIMETRES_PER_SECOND = int.from_bytes(b"C16", "big")


class Server(NamedTuple):
    """A server of two lathes: "Lathe" keeps a history, "Twin" has two spindles and keeps none."""

    url: str
    nodes: dict[str, Any]  # by the machine and the browse path
    requests: list[Any]  # to write or to subscribe, by clients
    started: float  # time.monotonic() [s]


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    """Yield a server with the structure of OPC 40502 below a folder of its maker."""
    asyncua = pytest.importorskip("asyncua.sync")
    from asyncua import ua
    from asyncua.common.callback import CallbackType

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"opc.tcp://127.0.0.1:{free.getsockname()[1]}"
    server = asyncua.Server()
    server.set_endpoint(url)
    maker = server.register_namespace("urn:maker")
    cnc = server.register_namespace(CNC)
    folder = server.nodes.objects.add_folder(maker, "Plant")
    nodes: dict[str, Any] = {}

    def add(path: str, value: float) -> None:
        node = folder
        *objects, name = path.split("/")
        for depth, part in enumerate(objects):
            inner = "/".join(objects[: depth + 1])
            if inner not in nodes:
                nodes[inner] = node.add_object(cnc if depth else maker, part)
            node = nodes[inner]
        nodes[path] = node.add_variable(cnc, name, value)
        nodes[path].set_writable()

    for machine in ("Lathe", "Twin"):
        for path, value in NODES.items():
            add(f"{machine}/{path}", value)
    add("Twin/CncSpindleList/S2/ActSpeed", 200.0)
    unit = ua.EUInformation(
        UnitId=MILLIMETRES_PER_SECOND, DisplayName=ua.LocalizedText("mm/s"), NamespaceUri=""
    )
    nodes["Lathe/CncChannelList/Channel 1/ActFeedrate"].add_property(0, "EngineeringUnits", unit)

    requests: list[Any] = []

    def record_request(event: Any, _: Any) -> None:
        if event.is_external:
            requests.append(event.request_params)

    with server:
        for path in NODES:
            node = nodes[f"Lathe/{path}"].aio_obj
            server.tloop.post(server.aio_obj.historize_node_data_change(node))
        for kind in (CallbackType.PreWrite, CallbackType.ItemSubscriptionCreated):
            server.aio_obj.subscribe_server_callback(kind, record_request)
        yield Server(url, nodes, requests, started=time.monotonic())


def source(
    server: Server, machine: str = "Lathe", nodes: Path | None = None, **parts: str
) -> OpcUaSource:
    chosen = Parts(machine=machine, **parts)
    return OpcUaSource(
        server.url,
        0.02,
        parts=chosen,
        security=Security(),
        nodes=nodes,
    )


def times(count: int) -> Callable[[], bool]:
    """Return what says yes a number of times."""
    answers = iter([True] * count)
    return lambda: next(answers, False)


def test_quantities_are_found_by_browse_names_and_nothing_is_written(server: Server) -> None:
    before = len(server.requests)
    sample, *_ = source(server).samples(None, times(4))
    lines = source(server).found()
    assert sample.spindle_power == pytest.approx(4.321)  # W, where no unit is stated
    assert sample.feed_rate == pytest.approx(225.0)  # stated in mm/s
    assert sample.spindle_speed == 900.0
    assert sample.spindle_load == 33.0
    assert sample.x_load == 11.0
    assert sample.z_load == 22.0
    assert sample.x == 40.5
    assert sample.feed_override == 80.0
    assert sample.spindle_override == 95.0
    assert sample.running == 1.0
    assert sample.tool == "3"
    assert any("S1/ActPower" in line and "W" in line for line in lines)
    assert len(server.requests) == before


def test_of_several_machines_and_spindles_the_user_names_one(server: Server) -> None:
    with pytest.raises(UserError, match="Lathe, Twin"):
        OpcUaSource(
            server.url,
            0.02,
            parts=Parts(),
            security=Security(),
        ).found()
    with pytest.raises(UserError, match="S1, S2"):
        source(server, "Twin").found()
    sample = next(source(server, "Twin", spindle="S2").samples(None, times(4)))
    assert sample.spindle_speed == 200.0


def test_a_file_names_nodes_that_no_specification_does(server: Server, tmp_path: Path) -> None:
    plan = tmp_path / "nodes.toml"
    load = server.nodes["Lathe/CncAxisList/X/ActLoad"].nodeid.to_string()
    plan.write_text(f'spindle_load = "{load}"')
    sample = next(source(server, nodes=plan).samples(None, times(4)))
    assert sample.spindle_load == 11.0
    assert sample.spindle_speed == 900.0
    plan.write_text('spindle_load = "ns=2;s=Nowhere"')
    with pytest.raises(UserError, match="no such node"):
        source(server, nodes=plan).found()
    plan.write_text('spindle_torc = "i=1"')
    with pytest.raises(UserError, match="spindle_torque"):
        source(server, nodes=plan)


def test_a_file_of_nodes_that_has_no_end_is_refused(tmp_path: Path) -> None:
    plan = tmp_path / "nodes.toml"
    os.mkfifo(plan)
    with pytest.raises(OSError, match="must be a regular file"):
        OpcUaSource("opc.tcp://lathe", 0.02, parts=Parts(), security=Security(), nodes=plan)


def test_what_passed_in_a_silence_comes_from_the_history(server: Server) -> None:
    before = next(source(server).samples(None, times(4)))
    load = server.nodes["Lathe/CncSpindleList/S1/ActLoad"]
    for value in (44.0, 55.0, 33.0):
        load.write_value(value)
        time.sleep(0.4)  # more than a second in all, which is a silence
    samples = list(source(server).samples(before, times(4)))
    loads = [sample.spindle_load for sample in samples]
    assert [value for value, _ in itertools.groupby(loads)] == [44.0, 55.0, 33.0]
    assert not any(sample.gap for sample in samples)


def test_a_silence_without_history_is_a_gap_that_says_what_is_missing(server: Server) -> None:
    twin = source(server, "Twin", spindle="S1")
    # The server must have been there all the while: its start would be another gap.
    time.sleep(max(0.0, server.started + 2.5 - time.monotonic()))
    earlier = Sample(time=datetime.now(UTC) - timedelta(seconds=1.5))
    first, *others = twin.samples(earlier, times(4))
    assert "without a reading" in first.gap
    assert "history of spindle_speed" in first.gap
    assert not any(sample.gap for sample in others)


def test_a_server_that_has_started_meanwhile_is_a_gap(server: Server) -> None:
    earlier = Sample(time=datetime.now(UTC) - timedelta(days=1))
    first = next(source(server).samples(earlier, times(4)))
    assert "server started" in first.gap
