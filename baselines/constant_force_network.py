"""Constant force around a feed that a neural network recommends for the roughness (roughness control paper, steps 2 to 9).

Before the cut, a network gives the recommended feed for the desired Ra (step 2). The paper does not print its network. This one
is fitted to the nominal model when the controller is built. The tool enters the metal with the recommended feed, and the override
of 0 to 150 % acts on it. The law is that of ``constant_force``. Its feed is restricted to those of an allowed chip thickness

    h = f sin(kappa)

with kappa the entering angle. The paper names this restriction without numbers; they are assumptions.

It needs of the nominal model: the roughness of a force and the law of thrust force.
"""

import math

import numpy as np
from numpy.typing import NDArray

from baselines.constant_force import ConstantForce, feed_of_roughness, plays_by_model
from baselines.models.network import Network
from baselines.models.part_program import PartProgram, on_program
from baselines.rule import Rule
from turning_env import Scenario, read
from turning_env.numerics.functions import exp, log, sine_and_cosine
from turning_env.scoring.policy import Actions, Observations

SAMPLES, UNITS, WIDTH = 64, 6, 0.3
"""Samples of the model between the task's lowest and highest reference of Ra; hidden units, and their width over that range."""


class RecommendedFeed:
    """The network of the recommended feed.

    Args:
        scenario: task, whose nominal model gives the samples.

    Raises:
        ValueError: the force does not grow with the feed, or the roughness does not depend on the force.
    """

    def __init__(self, scenario: Scenario) -> None:
        surface, self._machine = scenario.surface, scenario.machine
        roughness = exp(np.linspace(log(surface.reference_min), log(surface.reference_max), SAMPLES))
        self._network = Network(roughness[:, np.newaxis], feed_of_roughness(scenario, roughness), UNITS, WIDTH)

    def __call__(self, roughness: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the recommended feed [mm/rev] for a desired Ra [um]."""
        return np.clip(self._network(roughness[:, np.newaxis]), self._machine.feed_min, self._machine.feed_max)


class ConstantForceNetwork(ConstantForce):
    """The paper's control law around the recommended feed, within the chip thickness.

    Args:
        program: part program.
        num_envs: number of environments.
        chip_thickness_min: lowest chip thickness h [mm].
        chip_thickness_max: highest chip thickness h [mm].
        entering_angle: angle kappa between the edge and the feed's direction [deg].

    Raises:
        ValueError: the force does not grow with the feed, or the roughness does not depend on the force.
    """

    def __init__(
        self,
        program: PartProgram,
        num_envs: int,
        chip_thickness_min: float = 0.0,
        chip_thickness_max: float = math.inf,
        entering_angle: float = 90.0,
    ) -> None:
        super().__init__(program, num_envs)
        self._recommended = RecommendedFeed(program.scenario)
        over_feed, _ = sine_and_cosine(entering_angle / 360.0)
        self._feed_range = chip_thickness_min / over_feed, chip_thickness_max / over_feed

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        reading = read(observations, self._program.scenario)
        recommended = self._recommended(reading.roughness_reference)
        feed, engaged = self._next_feed(reading)
        feed = np.where(engaged, np.minimum(feed, self._program.override_max * recommended), recommended)
        return self._program.act(reading, np.clip(feed, *self._feed_range) / self._program.feed)


RULES = {
    "constant_force_network": Rule(
        "constant_force around a feed that a neural network recommends, within a chip thickness (roughness control paper)",
        on_program(ConstantForceNetwork),
        plays_by_model,
        {"chip_thickness_min": 0.05, "chip_thickness_max": 0.3, "entering_angle": 75.0},
    )
}
