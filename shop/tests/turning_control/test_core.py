"""The controller core with readings of the simulator and with faults; no machine is needed."""

import itertools
import math
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from turning_control.core import Commands, Controller, Readings, Status, highest_feed, on_control
from turning_control.shield import Shield

from turning_env import Scenario
from turning_env.physics.quantities import action_size
from turning_env.scoring.policy import Actions, Observations, Policy

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

    def __init__(self, answers: list[Any]) -> None:
        self.answers = answers

    def act(self, observations: Observations) -> Actions:
        return self.answers.pop(0) if self.answers else np.zeros((1, 2), np.float32)


def readings_of(info: dict[str, Any], scenario: Scenario) -> Readings:
    sensed = "servo_current" if scenario.sensors.force == "servo_current" else "thrust_force"
    told = ("spindle_speed", "feed_velocity", "engaged_time", "spindle_heat", "roughness_reference")
    values = {name: info[name] for name in told} | {
        name: info[f"measured_{name}"] for name in ("power", sensed)
    }
    return Readings(in_feed=True, cutting=bool(info["cutting"]), **values)


@pytest.mark.slow
@pytest.mark.parametrize(
    "preset",
    ["rough_turning", "override", "surface", "rough_turning_current", "override_torque", "paper"],
)
def test_readings_of_the_simulator_give_its_observations(preset: str) -> None:
    scenario = Scenario.load(preset)
    env = gymnasium.make("RoughTurning-v0", scenario=scenario, disable_env_checker=True)
    size = env.action_space.shape or (0,)
    answers = list(np.random.default_rng(7).uniform(-0.3, 0.3, (200, 1, *size)).astype(np.float32))
    shield = Shield(Scripted(answers.copy()), scenario, 1)
    controller = Controller(scenario, lambda num_envs: Scripted(answers.copy()))
    expected, info = env.reset(seed=7)
    shield.reset(np.ones(1, np.bool_))
    ended = False
    for _ in range(200):
        if not ended:
            controller.decide(readings_of(info, scenario))
            np.testing.assert_allclose(controller.observation[0], expected, rtol=2e-6, atol=2e-6)
            expected, _, terminated, truncated, info = env.step(shield.act(expected[None])[0])
            ended = terminated or truncated


def decided(answers: list[Any], *readings: Readings) -> list[Commands]:
    controller = Controller(Scenario.load("rough_turning"), lambda num_envs: Scripted(answers))
    return [controller.decide(each) for each in readings]


def noisy(count: int, **changed: Any) -> list[Readings]:
    return [
        replace(
            STEADY, **({"power": 4.0 + 0.01 * (i % 2), "thrust_force": 700.0 + i % 2} | changed)
        )
        for i in range(count)
    ]


def test_wrong_answers_give_the_safe_feed_at_once_and_hold_the_feed_in_the_end() -> None:
    good, bad, *others, last = decided([np.zeros((1, 2)), *[np.zeros(0)] * 20], *noisy(13))
    assert good.status == Status.POLICY
    assert {each.status for each in (bad, *others[:8])} == {Status.SAFE}
    assert bad.adaptive_feed == pytest.approx(0.5 * 0.25 / 0.6, rel=0.5)
    assert (last.status, last.adaptive_feed) == (Status.OPERATOR, 0.0)


@pytest.mark.parametrize(
    ("readings", "first", "last"),
    [
        ([STEADY, replace(STEADY, power=math.nan)], Status.POLICY, Status.SAFE),
        ([STEADY, replace(STEADY, thrust_force=math.nan)], Status.POLICY, Status.SAFE),
        (noisy(8, power=4.0), Status.POLICY, Status.SAFE),  # stuck
        ([STEADY, replace(STEADY, spindle_speed=0.0)], Status.POLICY, Status.OPERATOR),
    ],
)
def test_faults_of_sensors_and_spindle(
    readings: list[Readings], first: Status, last: Status
) -> None:
    commands = decided([], *readings)
    assert (commands[0].status, commands[-1].status) == (first, last)
    assert commands[-1].adaptive_feed == (
        0.0 if last == Status.OPERATOR else pytest.approx(0.5 * 0.25 / 0.6)
    )


@pytest.mark.parametrize("preset", ["rough_turning", "override"])
@pytest.mark.parametrize("jumps", [("power",), ("thrust_force",), ("power", "thrust_force")])
def test_a_load_that_jumps_lowers_the_feed_at_once_and_never_raises_it(
    preset: str, jumps: tuple[str, ...]
) -> None:
    scenario = on_control(Scenario.load(preset))
    loads = {"power": 20.0, "thrust_force": 5.0 * scenario.limits.thrust_force}
    controller = Controller(scenario, lambda num_envs: Highest(action_size(scenario)))
    random, feeds = np.random.default_rng(0), []
    for k in range(60):
        noise = 1.0 + 0.01 * random.standard_normal(2)
        cut = replace(
            STEADY, spindle_speed=500.0, feed_velocity=125.0, engaged_time=scenario.control.interval
        )
        cut = replace(cut, power=2.5 * noise[0], thrust_force=500.0 * noise[1])
        if k >= 50:
            cut = replace(cut, **{name: loads[name] * noise[0] for name in jumps})
        feeds.append(controller.decide(cut).adaptive_feed)
    lowest = scenario.machine.feed_min / highest_feed(scenario)
    assert feeds[50] < feeds[49]
    assert all(after <= before for before, after in itertools.pairwise(feeds[49:]))
    assert feeds[-1] <= max(lowest, 0.3 * feeds[49])


class Highest(Policy):
    """Asks for the highest speed and feed."""

    def __init__(self, size: int) -> None:
        self._size = size

    def act(self, observations: Observations) -> Actions:
        return np.ones((len(observations), self._size), np.float32)


def test_without_feed_motion_the_controller_idles_and_it_lists_readings_that_it_lacks() -> None:
    assert decided([], replace(STEADY, in_feed=False))[0].status == Status.IDLE
    controller = Controller(Scenario.load("surface"), lambda num_envs: Scripted([]))
    assert controller.lacks(STEADY) == ["roughness_reference"]


def test_a_control_has_its_stated_delay_or_that_of_linuxcnc() -> None:
    scenario = Scenario.load("override")
    delayed = on_control(scenario)
    assert delayed.machine.command_delay == pytest.approx(0.5 * scenario.control.interval)
    assert on_control(delayed) == delayed
