"""Hold a constant cutting force, and so a constant roughness, with the feed.

The law is that of the roughness control paper. The commanded feed is

    f_c = f(t - 1) F_ref / F

with F the measured force, F_ref its reference and f(t - 1) the previous feed. (The paper's equation
(6) is lost; like the text's, this form grows without bound as the force vanishes.) If f(t - 1) is
the actual feed, the feed servo integrates the deviation, and the loop is stable. If it is the
commanded feed, the command runs ahead of the lags of servo and chip, and the feed swings between
its bounds. F_ref is the force at which Ra = a exp(b F), the paper's equation (5), equals the
reference of Ra. Without a reference of Ra, it is a share of the force limit. The law acts only
after the force has been above 100 N for some time; until then it commands the programmed feed, or
the feed that a neural network recommends for the desired Ra (the paper's step 2).

Uses from the nominal model: the roughness of a force and the law of thrust force. Roughness must
depend on the force, and, if the model gives the feed, the force must grow with the feed.
"""

import math
from collections.abc import Callable

import numpy as np

from baselines.models.part_program import (
    PROGRAM,
    PartProgram,
    on_override,
    on_program,
    on_speed_and_feed,
)
from baselines.rule import Array, Mask, Rule, TuningRange
from turning_env import Reading, Scenario, read
from turning_env.action import towards
from turning_env.numerics.functions import exp, log, sine_and_cosine
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.sections import Surface

THRESHOLD = 100.0
"""Force below which the tool counts as out of the metal [N] (roughness control paper)."""
ENGAGED_TIME = 0.1
"""Time above the threshold after which the law acts [s].

It is one turn of the paper's spindle, in which a chip reaches its thickness (assumption; the paper
says "a specified time").
"""
MIN_WEAR = 1e-3  # flank wear over the criterion in place of 0, before the first cut [-]
# The network of the recommended feed (assumptions).
SAMPLES = 64  # of the model between the task's lowest and highest reference of Ra
UNITS = 6  # hidden units
WIDTH = 0.3  # width of the hidden units over the range of samples
DECAY = 1e-3
"""Weight decay: the fit minimises the squares of errors plus those of DECAY times weights."""


def force_of_roughness(surface: Surface, roughness: Array) -> Array:
    """Return the thrust force [N], at least 1 N, for a roughness Ra [um].

    It is the inverse of the paper's equation (5).
    """
    log_ratio = log(roughness / surface.roughness_at_no_force)
    return np.asarray(np.maximum(log_ratio / surface.roughness_rate, 1.0))


def feed_of_roughness(scenario: Scenario, roughness: Array, wear: Array | float = 0.0) -> Array:
    """Return the feed [mm/rev] at which the nominal model has the force for a roughness Ra [um].

    ``wear``: flank wear [mm].
    """
    law = scenario.material.thrust_force
    machine = scenario.machine
    at_unit_feed = law(
        scenario.control.initial_cutting_speed,
        1.0,
        scenario.workpiece.depth_of_cut,
        wear=np.maximum(wear, MIN_WEAR * scenario.tool.wear_criterion),
    )
    log_ratio = log(force_of_roughness(scenario.surface, roughness) / at_unit_feed)
    feed = exp(log_ratio / law.feed)
    return np.asarray(np.clip(feed, machine.feed_min, machine.feed_max))


class ConstantForce(Policy):
    """The paper's control law.

    Args:
        program: the part program, whose feed is overridden.
        num_envs: number of environments.
        force_share: reference of force over the force limit [-], unless a roughness is to be held.
        on_command: whether f(t - 1) is the commanded feed, not the actual one.
    """

    def __init__(
        self,
        program: PartProgram,
        num_envs: int,
        force_share: float = 1.0,
        on_command: bool = False,
    ) -> None:
        self._program = program
        self._on_command = on_command
        self._force_reference = force_share * program.scenario.limits.thrust_force
        self._steps_needed = max(1, round(ENGAGED_TIME / program.scenario.control.interval))
        self._steps_engaged = np.zeros(num_envs, np.int64)

    def reset(self, mask: Mask) -> None:
        self._steps_engaged[mask] = 0

    def act(self, observations: Observations) -> Actions:
        scenario = self._program.scenario
        reading = read(observations, scenario)
        above = reading.thrust_force > THRESHOLD
        self._steps_engaged = np.where(above, self._steps_engaged + 1, 0)
        engaged = self._steps_engaged >= self._steps_needed

        reference: Array | float = self._force_reference
        if scenario.control.aim == "roughness":
            reference = force_of_roughness(scenario.surface, reading.roughness_reference)
        feed_before = reading.commanded_feed if self._on_command else reading.feed
        force = np.maximum(reading.thrust_force, THRESHOLD)
        feed = feed_before * reference / force
        override = self._override(reading, feed, engaged)
        return self._program.act(reading, override)

    def _override(self, reading: Reading, feed: Array, engaged: Mask) -> Array:
        """Return the override [-] for the law's feed [mm/rev], which acts where engaged."""
        return np.where(engaged, feed / self._program.feed, 1.0)


def recommended_feed(scenario: Scenario) -> Callable[[Array], Array]:
    """Return the recommended feed [mm/rev] as a function of the desired Ra [um].

    It is a radial basis network, w_0 + sum of w_j exp(-(x - centre j)^2 / (2 width^2)), with Ra
    scaled to x of 0..1. The paper does not print its own. This one is fitted to the nominal model:
    its centres are samples, its weights minimise the sum of squares.
    """
    surface = scenario.surface
    machine = scenario.machine
    log_samples = np.linspace(log(surface.reference_min), log(surface.reference_max), SAMPLES)
    samples = exp(log_samples)
    low = samples.min()
    span = np.ptp(samples) or 1.0
    scaled_samples = (samples - low) / span
    places = np.linspace(0, SAMPLES - 1, UNITS).round().astype(np.int64)
    centres = scaled_samples[places]

    def hidden(roughness: Array) -> Array:
        """Return the outputs of the hidden units, 1 first, shape (samples, 1 + UNITS)."""
        x = (roughness - low) / span
        square_distance = (x[:, np.newaxis] - centres) ** 2
        bells = exp(-0.5 * square_distance / WIDTH**2)
        return np.column_stack([np.ones(len(roughness)), bells])

    # Normal equations of the decayed least squares: (U' U + DECAY^2 I) w = U' feeds.
    units = hidden(samples)
    feeds = feed_of_roughness(scenario, samples)
    products = units[:, :, np.newaxis] * units[:, np.newaxis]
    decay = DECAY**2 * np.eye(UNITS + 1)
    matrix = products.sum(axis=0) + decay
    weighted_units = units * feeds[:, np.newaxis]
    weights = _solve(matrix, weighted_units.sum(axis=0))

    def recommend(roughness: Array) -> Array:
        contributions = hidden(roughness) * weights
        feed = contributions.sum(axis=1)
        return np.asarray(np.clip(feed, machine.feed_min, machine.feed_max))

    return recommend


def _solve(matrix: Array, values: Array) -> Array:
    """Solve a system of linear equations by Gauss-Jordan elimination.

    The bits of NumPy's solver differ between processors.
    """
    rows = np.column_stack([matrix, values])
    numbers = np.arange(len(rows))
    for k in numbers:
        rows[k] /= rows[k, k]
        others = numbers != k
        factors = rows[others, k, np.newaxis]
        rows[others] -= factors * rows[k]
    return rows[:, -1]


class ConstantForceNetwork(ConstantForce):
    """The paper's control law around the recommended feed (steps 2 to 9).

    The tool enters the metal with the recommended feed, and the override acts on it. The feed is
    restricted to those of an allowed chip thickness h = f sin(kappa). The paper names this
    restriction without numbers; they are assumptions.

    Args:
        program: the part program, whose feed is overridden.
        num_envs: number of environments.
        chip_thickness_min: lowest h [mm].
        chip_thickness_max: highest h [mm].
        entering_angle: kappa, the angle between the edge and the feed's direction [deg].
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
        self._recommended = recommended_feed(program.scenario)
        thickness_per_feed, _ = sine_and_cosine(entering_angle / 360.0)
        self._feed_min = chip_thickness_min / thickness_per_feed
        self._feed_max = chip_thickness_max / thickness_per_feed

    def _override(self, reading: Reading, feed: Array, engaged: Mask) -> Array:
        recommended = self._recommended(reading.roughness_reference)
        highest = self._program.override_max * recommended
        limited = np.minimum(feed, highest)
        feed = np.where(engaged, limited, recommended)
        feed = np.clip(feed, self._feed_min, self._feed_max)
        return feed / self._program.feed


class ModelFeed(Policy):
    """Open-loop control by the nominal model: its feed for the reference of Ra."""

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        self._scenario = scenario

    def act(self, observations: Observations) -> Actions:
        scenario = self._scenario
        reading = read(observations, scenario)
        speed = np.full(len(observations), scenario.control.initial_cutting_speed)
        feed = feed_of_roughness(scenario, reading.roughness_reference, wear=reading.nominal_wear)
        return towards(reading, scenario, speed, feed)


def holds_roughness(scenario: Scenario) -> bool:
    """Return whether an action sets the override, to hold a roughness that depends on the force."""
    return on_override(scenario, "roughness") and scenario.surface.roughness_rate > 0.0


def holds_roughness_by_feed(scenario: Scenario) -> bool:
    """Return ``holds_roughness``, for rules whose force must grow with the feed."""
    return holds_roughness(scenario) and scenario.material.thrust_force.feed > 0.0


FORCE_SHARE = TuningRange(0.2, 1.1, logarithmic=True)

RULES = {
    "constant_force": Rule(
        "constant cutting force for constant roughness (roughness control paper)",
        on_program(ConstantForce),
        plays=holds_roughness,
        parameters={},
        published=True,
    ),
    "constant_force_limit": Rule(
        "constant cutting force at a share of the force limit, by override "
        "(roughness control paper)",
        on_program(ConstantForce),
        plays=on_override,
        parameters={"force_share": FORCE_SHARE},
        published=True,
    ),
    "constant_force_with_speed": Rule(
        "constant cutting force at a share of the force limit (roughness control paper), "
        "with the program's speed and feed tuned",
        on_program(ConstantForce),
        plays=on_speed_and_feed,
        parameters={"force_share": FORCE_SHARE, **PROGRAM},
        published=True,
    ),
    "model_feed": Rule(
        "the feed of the nominal model for the reference of roughness, without measuring "
        "(to compare with constant_force)",
        ModelFeed,
        plays=holds_roughness_by_feed,
        parameters={},
    ),
    "constant_force_network": Rule(
        "constant_force around a feed that a neural network recommends, within a chip thickness "
        "(roughness control paper)",
        on_program(ConstantForceNetwork),
        plays=holds_roughness_by_feed,
        parameters={
            "chip_thickness_min": 0.05,
            "chip_thickness_max": 0.3,
            "entering_angle": 75.0,
        },
        published=True,
    ),
}
