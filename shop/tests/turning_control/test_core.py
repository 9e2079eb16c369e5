"""The controller core with readings of the simulator and with faults; no machine is needed."""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import ArrayLike
from turning_control.core import Commands, Controller, Status, highest_feed, on_control
from turning_control.readings import Readings, bar_spindle_speed
from turning_control.shield import PATIENCE, Shield

from turning_env import Scenario
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy

STEADY = Readings(
    spindle_speed=400.0,
    feed_velocity=100.0,
    in_feed=True,
    cutting=True,
    engaged_time=1.0,
    power=4.0,
    thrust_force=700.0,
)


class Scripted(Policy):
    """Gives the answers of a list, then zeros."""

    def __init__(self, answers: Iterable[ArrayLike]) -> None:
        self._answers = iter(answers)

    def act(self, observations: Observations) -> Any:
        return next(self._answers, np.zeros((1, 2), np.float32))


class HighestFeed(Policy):
    """Asks for the highest feed at the present speed."""

    def __init__(self, size: int) -> None:
        self._size = size

    def act(self, observations: Observations) -> Actions:
        actions = np.zeros((len(observations), self._size), np.float32)
        actions[:, -1] = 1.0
        return actions


def decide(readings: Sequence[Readings], answers: Iterable[ArrayLike] = ()) -> list[Commands]:
    """Return a controller's commands for readings, with a policy that gives these answers."""
    scenario = Scenario.load("rough_turning")
    controller = Controller(scenario, lambda num_envs: Scripted(answers))
    return [controller.decide(reading) for reading in readings]


def noisy(count: int) -> list[Readings]:
    """Return steady readings with some noise."""
    readings = []
    for k in range(count):
        readings.append(replace(STEADY, power=4.0 + 0.01 * (k % 2), thrust_force=700.0 + k % 2))
    return readings


def readings_of(info: dict[str, Any], scenario: Scenario) -> Readings:
    """Return the readings that a machine would give in the simulator's state."""
    force = "servo_current" if scenario.sensors.force == "servo_current" else "thrust_force"
    return Readings(
        spindle_speed=info["spindle_speed"],
        feed_velocity=info["feed_velocity"],
        in_feed=True,
        cutting=bool(info["cutting"]),
        engaged_time=info["engaged_time"],
        power=info["measured_power"],
        spindle_heat=info["spindle_heat"],
        roughness_reference=info["roughness_reference"],
        **{force: info[f"measured_{force}"]},
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preset", "steps"),
    [
        ("rough_turning", 160),
        ("override", 80),
        ("surface", 80),
        ("rough_turning_current", 160),
        ("override_torque", 80),
        ("paper", 30),
    ],
)
def test_readings_of_the_simulator_give_its_observations(preset: str, steps: int) -> None:
    """The steps suffice to enter a bar, and where they are long the next one."""
    scenario = Scenario.load(preset)
    env = gymnasium.make("RoughTurning-v0", scenario=scenario, disable_env_checker=True)
    shape = (steps, 1, action_size(scenario))
    answers = np.random.default_rng(7).uniform(-0.3, 0.3, shape).astype(np.float32)
    shield = Shield(Scripted(answers), scenario, 1)
    controller = Controller(scenario, lambda num_envs: Scripted(answers))

    expected, info = env.reset(seed=7)
    shield.reset(np.ones(1, np.bool_))
    for _ in answers:
        controller.decide(readings_of(info, scenario))
        np.testing.assert_allclose(
            controller.observation[0],
            expected,
            rtol=2e-6,
            atol=2e-6,
        )
        expected, _, terminated, truncated, info = env.step(shield.act(expected[None])[0])
        if terminated or truncated:
            break


def test_a_wrong_answer_gives_the_safe_feed_at_once() -> None:
    good, wrong = decide(noisy(2), answers=[np.zeros((1, 2)), np.zeros(0)])
    assert good.status == Status.POLICY
    assert wrong.status == Status.SAFE
    assert wrong.adaptive_feed == pytest.approx(0.5 * 0.25 / 0.6, rel=0.5)


def test_wrong_answers_in_a_row_hold_the_feed_in_the_end() -> None:
    wrong_answers = [np.zeros(0)] * (PATIENCE + 2)
    slow = [replace(reading, feed_velocity=50.0) for reading in noisy(PATIENCE + 2)]
    commands = decide(slow, answers=wrong_answers)
    statuses = [command.status for command in commands]
    assert statuses == [Status.SAFE] * (PATIENCE - 1) + [Status.OPERATOR] * 3
    assert commands[-1].adaptive_feed == 0.0


@pytest.mark.parametrize("sensor", ["power", "thrust_force"])
def test_a_lost_sensor_gives_the_safe_feed(sensor: str) -> None:
    before, lost = decide([STEADY, replace(STEADY, **{sensor: math.nan})])
    assert before.status == Status.POLICY
    assert lost.status == Status.SAFE
    assert lost.adaptive_feed == pytest.approx(0.5 * 0.25 / 0.6)


@pytest.mark.parametrize("sensor", ["power", "thrust_force"])
def test_a_stuck_sensor_gives_the_safe_feed(sensor: str) -> None:
    stuck_value = getattr(STEADY, sensor)
    commands = decide([replace(reading, **{sensor: stuck_value}) for reading in noisy(8)])
    assert commands[0].status == Status.POLICY
    assert commands[-1].status == Status.SAFE
    assert commands[-1].adaptive_feed == pytest.approx(0.5 * 0.25 / 0.6)


def test_a_stopped_spindle_holds_the_feed(caplog: pytest.LogCaptureFixture) -> None:
    # The feed takes longer to stop, which is no fault of a sensor.
    before, stopped = decide([STEADY, replace(STEADY, spindle_speed=0.0)])
    assert before.status == Status.POLICY
    assert stopped.status == Status.OPERATOR
    assert stopped.adaptive_feed == 0.0
    assert not caplog.records


@pytest.mark.parametrize("preset", ["rough_turning", "override"])
@pytest.mark.parametrize("jumping", [("power",), ("thrust_force",), ("power", "thrust_force")])
def test_a_load_that_jumps_lowers_the_feed_at_once_and_never_raises_it(
    preset: str, jumping: tuple[str, ...]
) -> None:
    scenario = on_control(Scenario.load(preset))
    controller = Controller(scenario, lambda num_envs: HighestFeed(action_size(scenario)))
    turns = bar_spindle_speed(scenario, scenario.control.initial_cutting_speed)
    commands = Commands(controller.safe_feed, 1.0, Status.IDLE, reason="")
    random = np.random.default_rng(0)
    feeds = []
    for k in range(60):
        noise = 1.0 + 0.01 * random.standard_normal(2)
        power = 2.5
        force = 500.0
        if k >= 50 and "power" in jumping:
            power = 20.0
        if k >= 50 and "thrust_force" in jumping:
            force = 5.0 * scenario.limits.thrust_force
        # The drives follow at once.
        spindle_speed = turns * commands.spindle_override
        feed = commands.adaptive_feed * highest_feed(scenario)
        reading = replace(
            STEADY,
            spindle_speed=spindle_speed,
            feed_velocity=feed * spindle_speed,
            engaged_time=scenario.control.interval,
            power=power * noise[0],
            thrust_force=force * noise[1],
        )
        commands = controller.decide(reading)
        feeds.append(commands.adaptive_feed)

    assert feeds[50] < feeds[49]
    for before, after in itertools.pairwise(feeds[49:]):
        assert after <= before
    lowest = scenario.machine.feed_min / highest_feed(scenario)
    assert feeds[-1] <= max(lowest, 0.3 * feeds[49])


def test_without_feed_motion_the_controller_idles() -> None:
    (commands,) = decide([replace(STEADY, in_feed=False)])
    assert commands.status == Status.IDLE


def test_the_controller_lists_the_readings_that_it_lacks() -> None:
    controller = Controller(Scenario.load("surface"), lambda num_envs: Scripted([]))
    assert controller.lacks(STEADY) == ["roughness_reference"]


def test_a_control_has_the_delay_of_linuxcnc_if_none_is_stated() -> None:
    scenario = Scenario.load("override")
    delayed = on_control(scenario)
    assert delayed.machine.command_delay == pytest.approx(0.5 * scenario.control.interval)


def test_a_stated_delay_stays() -> None:
    delayed = on_control(Scenario.load("override"))
    assert on_control(delayed) == delayed
