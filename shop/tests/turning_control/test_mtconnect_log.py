"""Records of an MTConnect agent: what is read, and what a lost connection loses."""

import math
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from turning_control.__main__ import main
from turning_control.machine_log.mtconnect import MTConnectSource, Parts
from turning_control.machine_log.record import Sample, read_samples, reconnecting
from turning_control.opcua_security import Security

from shop.tests.turning_control.mtconnect_agent import Agent, serving
from tests.walking import until
from turning_env.console import UserError

INTERVAL = 0.01
# Observations of the data items of ``mtconnect_agent.py``, by their ids.
AT_REST = {
    "sa": 0,  # actual spindle speed
    "sc": 900,  # commanded spindle speed
    "sw": 0,  # spindle power
    "sl": 0,  # spindle load
    "pf": 0,  # path feed rate
    "ex": "READY",  # execution
    "tn": 3,  # tool number
    "fo": 100,  # feed override
}


@pytest.fixture
def agent() -> Agent:
    """Return an agent of a lathe at rest."""
    agent = Agent()
    agent.observe(
        0.0,
        AT_REST
        | {
            "xp": "40.5",
            "xpm": "-200",
            "xl": "UNAVAILABLE",
            "zl": 5,
        },
    )
    return agent


def source(url: str, **parts: str) -> MTConnectSource:
    return MTConnectSource(
        url,
        INTERVAL,
        parts=Parts(**parts),
        security=Security(),
    )


def times(count: int) -> Callable[[], bool]:
    """Return a function that is true a number of times."""
    answers = iter([True] * count)
    return lambda: next(answers, False)


def read(url: str, last: Sample | None = None, cycles: int = 3) -> list[Sample]:
    """Return the samples of some requests."""
    return list(source(url).samples(last, times(cycles)))


def test_items_are_found_by_their_types_and_read_in_the_units_of_the_record(agent: Agent) -> None:
    with serving(agent) as url:
        (at_rest,) = read(url)
        agent.observe(
            2.0,
            {
                "sa": 900,
                "sw": 4321,
                "sl": 33,
                "pf": 3.75,
                "ex": "ACTIVE",
            },
        )
        (cutting,) = read(url, at_rest)
    assert at_rest.x == 40.5
    assert at_rest.z_load == 5.0
    assert at_rest.running == 0.0
    assert math.isnan(at_rest.x_load)  # it is unavailable
    assert math.isnan(at_rest.rapid_override)  # the machine has none
    assert cutting.spindle_speed == 900.0
    assert cutting.spindle_power == pytest.approx(4.321)
    assert cutting.feed_rate == pytest.approx(225.0)
    assert cutting.running == 1.0
    assert cutting.tool == "3"
    assert cutting.x == 40.5
    assert (cutting.time - at_rest.time).total_seconds() == 2.0


def test_an_agent_is_only_ever_asked_by_get(agent: Agent) -> None:
    with serving(agent) as url:
        read(url)
    assert {request.split()[0] for request in agent.requests} == {"GET"}


def test_a_lost_connection_loses_nothing_while_the_buffer_holds(
    agent: Agent,
) -> None:
    samples: list[Sample] = []
    stop = threading.Event()

    def log(url: str) -> None:
        logged = reconnecting(
            source(url),
            None,
            lambda: not stop.is_set(),
            pause=0.02,
        )
        samples.extend(logged)

    def requests_of_samples() -> int:
        return sum("sample" in request for request in agent.requests)

    with serving(agent) as url:
        thread = threading.Thread(target=log, args=(url,))
        thread.start()
        until(lambda: requests_of_samples() > 0)

    # The connection is lost, and the agent's buffer holds what the machine does meanwhile.
    for second in range(1, 6):
        agent.observe(second, {"sl": 10 * second})
    agent.requests.clear()

    # The agent is back at the same address.
    port = urlsplit(url).port
    assert port is not None
    with serving(agent, port):
        until(lambda: requests_of_samples() > 0)
        agent.observe(6.0, {"sl": 60})
        agent.requests.clear()
        # The first request after the observation may have left before it.
        until(lambda: requests_of_samples() > 2)
        stop.set()
        thread.join(10.0)
    assert [sample.spindle_load for sample in samples] == [0, 10, 20, 30, 40, 50, 60]
    assert not any(sample.gap for sample in samples)


def test_what_has_left_the_buffer_is_a_gap_and_reading_goes_on_at_its_start(agent: Agent) -> None:
    with serving(agent) as url:
        (first,) = read(url)
        lost_from = len(agent.observations) + 1
        for second in range(1, 6):
            agent.observe(second, {"sl": 10 * second})
        agent.first = lost_from + 3
        samples = read(url, first)
    assert f"{lost_from} to {lost_from + 2}" in samples[0].gap
    assert [sample.spindle_load for sample in samples] == [40, 50]
    assert [bool(sample.gap) for sample in samples] == [True, False]


def test_an_agent_that_calls_the_next_observation_out_of_range_loses_nothing(agent: Agent) -> None:
    agent.knows_next = False
    with serving(agent) as url:
        (first,) = read(url)
        agent.observe(1.0, {"sl": 10})
        samples = read(url, first)
    assert [sample.spindle_load for sample in samples] == [10]
    assert not samples[0].gap


def test_an_agent_that_has_started_anew_is_a_gap(agent: Agent) -> None:
    with serving(agent) as url:
        (first,) = read(url)
        agent.restart()
        agent.observe(100.0, {"sl": 1})
        agent.observe(101.0, {"sl": 2, "sa": 3})
        samples = read(url, first)
    assert "started anew" in samples[0].gap
    assert [sample.spindle_load for sample in samples] == [1, 2]
    assert math.isnan(samples[0].feed_rate)  # nothing is carried over the gap


@pytest.mark.slow
def test_a_record_is_continued_where_it_ends(agent: Agent, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    with serving(agent) as url:
        words = ["log", url, "--out", str(path), "--interval", "0.01"]
        assert main([*words, "--duration", "0.3"]) == 0
        agent.observe(7.0, {"sl": 70})
        with path.open("a") as file:
            file.write("2026-03-02T08:00:0")  # as after a crash
        assert main([*words, "--duration", "0.3"]) == 2
        assert main([*words, "--duration", "0.3", "--append"]) == 0
    assert [sample.spindle_load for sample in read_samples(path)] == [0, 70]


@pytest.mark.parametrize(
    ("document", "named"),
    [
        pytest.param(
            b'<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><MTConnectDevices>&b;'
            b"</MTConnectDevices>",
            "DOCTYPE",
            id="entities",
        ),
        pytest.param(b"<html><body>hello</body></html>", "no MTConnect", id="another document"),
        pytest.param(b"<MTConnectDevices><Devices>", "no MTConnect", id="half a document"),
        pytest.param(b"", "no MTConnect", id="nothing"),
        pytest.param(
            b'<MTConnectStreams><Header instanceId="1" nextSequence="no"/></MTConnectStreams>',
            "no device",
            id="no probe",
        ),
    ],
)
def test_a_document_that_is_not_valid_is_refused(agent: Agent, document: bytes, named: str) -> None:
    agent.answer = document
    with serving(agent) as url, pytest.raises((OSError, UserError), match=named):
        read(url)


def test_of_several_spindles_the_user_names_one(agent: Agent) -> None:
    agent.spindles = 2
    agent.observe(1.0, {"s2": 111})
    with serving(agent) as url:
        with pytest.raises(UserError, match="C, C2"):
            read(url)
        (sample,) = source(url, spindle="C2").samples(None, times(3))
        with pytest.raises(UserError, match="C3"):
            next(source(url, spindle="C3").samples(None, times(3)))
    assert sample.spindle_speed == 111.0


def test_a_password_goes_over_http_only_if_the_user_says_so() -> None:
    def asked(**values: str) -> MTConnectSource:
        security = Security(user="turner", password="secret", **values)
        return MTConnectSource(
            "http://127.0.0.1:1",
            INTERVAL,
            parts=Parts(),
            security=security,
        )

    with pytest.raises(UserError, match="unencrypted"):
        asked()
    asked(policy="None")


def test_a_wrong_address_is_a_mistake_at_once(tmp_path: Path) -> None:
    out = tmp_path / "log.csv"
    assert main(["log", "http://127.0.0.1:9", "--out", str(out)]) == 2
    assert main(["log", "lathe", "--out", str(out)]) == 2
    assert not out.exists()
