"""The belief of the optimisers' filter as an observation, for agents without memory.

    env = BeliefObservation(gymnasium.make("RoughTurning-Family-v1"))
    envs = VectorBeliefObservation(gymnasium.make_vec("RoughTurning-Family-v1", 512))
    venv = RoughTurningVecEnv("shop", 512, wrapper=VectorBeliefObservation)  # Stable-Baselines3

The filter (``models/load_filter.py``) knows the nominal model and sees the observations alone, so a
policy that plays with a ``Belief`` of its own has all that these wrappers show.
"""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from baselines import law_errors
from baselines.models.kalman_steps import FORCE, POWER
from baselines.models.load_filter import LoadFilter, Outlook, Prior, model_of
from baselines.models.nominal_models import NominalModels, Values, scenario_of, values_of
from baselines.optimiser import plays
from baselines.rule import Array, Mask
from turning_env import FamilyEnv, FamilyVectorEnv, Reading, Scenario
from turning_env.numerics.functions import exp, log
from turning_env.numerics.wear_term import log_wear_term, term_over_criterion
from turning_env.observation import read
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.laws import capacity_at

LIMIT = 10.0  # highest absolute value of an entry
MIN_DEVIATION = 1e-9
MIN_WEAR = 1e-3
"""Lower bound of the nominal wear over the criterion at which loads are expected [-]."""

_STATES = [
    "depth",
    "depth_slope",
    "hardness",
    "hardness_slope",
    "insert",
    "edge_history",
    "wear",
    "wear_speed",
    "wear_feed",
    "force",
    "force_speed",
    "force_feed",
    "force_wear",
    "power",
    "power_speed",
    "power_feed",
    "power_wear",
]
"""Names of the states of ``models/kalman_steps.py``, in their order."""

_LOADS = ["this_log_force", "this_log_power", "next_log_force", "next_log_power"]
"""Log loads over their limits, a step later at the present wear: in this bar and in the next."""

ENTRIES = (
    *[f"{state}_mean" for state in _STATES],  # over the standard deviation before the first reading
    *[f"{state}_deviation" for state in _STATES],  # likewise
    "log_wear_factor",  # of wear, true over nominal
    "log_wear_factor_deviation",
    "log_used_life",  # share of the edge's life
    "bar_measured",  # 0 or 1
    "log_time_to_bar",  # 1 + time [s] until the next bar's approach, at the present speed and feed
    *_LOADS,
    *[f"{load}_deviation" for load in _LOADS],
)
"""Names of the entries [-], each limited to -10..10."""


class Belief:
    """Estimates in many environments with a nominal model each, as numbers of order one.

    Args:
        scenarios: nominal model of each environment.
        learns_laws: whether the laws are expected to have the errors that training jobs of the
            family ``shop`` have; else the nominal model is taken for true.

    Attributes:
        filter: the filter.
        scenario: the nominal models side by side.
        entries: number of entries of an observation without a context and a belief.

    Raises:
        ValueError: actions do not set speed and feed, or force is not measured.
    """

    def __init__(self, scenarios: Sequence[Scenario], learns_laws: bool) -> None:
        for scenario in scenarios:
            if not plays(scenario):
                raise ValueError(
                    "a belief needs actions that set speed and feed, and a dynamometer, "
                    f"but scenario {scenario.name!r} has "
                    f"control.action {scenario.control.action!r} "
                    f"and sensors.force {scenario.sensors.force!r}"
                )
        num_envs = len(scenarios)
        self._errors = law_errors.read() if learns_laws else None
        self.filter = LoadFilter(scenarios, num_envs, self._errors)
        self._models: dict[int, tuple[Values, Prior]] = {}
        self._nominal = NominalModels(scenarios)
        self.scenario = self._nominal.scenario
        self.entries = self._nominal.entries

    def assign(self, env_index: int, number: int, scenario: Callable[[int], Scenario]) -> None:
        """Give an environment another nominal model and forget its estimates.

        Models are kept by their number.
        """
        if number not in self._models:
            self._models[number] = self._numbers_and_model(scenario(number))
        self._set_model(env_index, self._models[number])

    def replace_model(self, env_index: int, nominal: Scenario) -> None:
        """Give an environment another nominal model, as ``assign``, but do not keep the model."""
        self._set_model(env_index, self._numbers_and_model(nominal))

    def _numbers_and_model(self, nominal: Scenario) -> tuple[Values, Prior]:
        """Return the numbers of one nominal model, for the entries and for the filter."""
        return values_of(nominal), model_of([nominal], self._errors)

    def _set_model(self, env_index: int, numbers_and_model: tuple[Values, Prior]) -> None:
        values, model = numbers_and_model
        self._nominal.set(env_index, values)
        self.filter.assign(env_index, model)

    def observe(self, observations: Observations, mask: Mask | None = None) -> Observations:
        """Learn from observations, and return the entries of the belief.

        Args:
            observations: shape (num_envs, entries); the first entries are the environment's own.
            mask: environments that learn, shape (num_envs,); None: all.

        Returns:
            ``ENTRIES`` of every environment, float32, shape (num_envs, len(ENTRIES)).
        """
        believed = self.filter
        scenario = self.scenario
        reading = read(observations[:, : self.entries], scenario)
        believed.observe(reading, mask)
        variances = np.diagonal(believed.covariance, axis1=1, axis2=2)
        deviations = np.sqrt(np.maximum(variances, 0.0))
        prior = np.maximum(believed.prior_deviations, MIN_DEVIATION)
        wear = np.maximum(reading.nominal_wear / scenario.tool.wear_criterion, MIN_WEAR)
        log_wear = log(wear)
        # Wear grows as W_max D^n, so the log of the used life is log D = log(W / W_max) / n.
        expected_log_wear = log_wear + believed.log_wear_factor
        log_used_life = expected_log_wear / scenario.material.wear.time
        velocity = reading.cutting_speed * reading.feed * believed.parameters["velocity"]
        distance_to_bar = believed.parameters["pitch"] - believed.along
        time_to_bar = distance_to_bar / velocity
        outlook = self._outlook(velocity)
        log_force, log_power = self._log_laws(reading, log_wear)

        # In the order of ``ENTRIES``. The outlook has two points: this bar and the next.
        columns = [
            believed.mean / prior,
            deviations / prior,
            believed.log_wear_factor,
            believed.wear_deviation,
            log_used_life,
            believed.memory["measured"],
            log(1.0 + time_to_bar),
            outlook.log_force[:, 0] + log_force,
            outlook.log_power[:, 0] + log_power,
            outlook.log_force[:, 1] + log_force,
            outlook.log_power[:, 1] + log_power,
            outlook.force_spread[:, 0],
            outlook.power_spread[:, 0],
            outlook.force_spread[:, 1],
            outlook.power_spread[:, 1],
        ]
        rows = [np.reshape(column, (len(wear), -1)) for column in columns]
        entries = np.concatenate(rows, axis=1)
        clipped = np.clip(entries, -LIMIT, LIMIT)
        return np.asarray(clipped, np.float32)

    def _outlook(self, velocity: Array) -> Outlook:
        """Return the outlook after a step, in this bar and in the next; velocities in mm/s."""
        distance = velocity * self.scenario.control.interval
        distances = np.repeat(distance[:, np.newaxis], 2, axis=1)
        entering = np.broadcast_to([False, True], distances.shape)
        return self.filter.outlook(distances, entering)

    def _log_laws(self, reading: Reading, log_wear: Array) -> tuple[Array, Array]:
        """Return log force and log power over their limits at this speed.

        They have the believed exponents. ``log_wear``: nominal, over the wear criterion.
        """
        parameters = self.filter.parameters
        limits = self.scenario.limits
        log_speed = log(reading.cutting_speed)
        log_feed = log(reading.feed)
        exponents = self.filter.exponents
        log_criterion = log(parameters["wear_criterion"])
        loads = []
        power_limit = limits.power * capacity_at(self.scenario, reading.cutting_speed)
        for law, limit in ((FORCE, limits.thrust_force), (POWER, power_limit)):
            log_coefficient = parameters["log_coefficients"][:, law]
            growth = parameters["wear_growths"][:, law]
            term_at_criterion = log_wear_term(growth, log_criterion)
            at_criterion = (
                log_coefficient + parameters["wear_exponents"][:, law] * term_at_criterion
            )
            # The outlook holds the wear factor's effect on a worn-out edge. With U = 1 + b W it is
            # less on this one: the true wear grows the load as the nominal one would with c b.
            true_growth = growth * parameters["wear_criterion"] * exp(self.filter.log_wear_factor)
            term = term_over_criterion(true_growth, log_wear)
            by_place = (
                exponents.speed[law] * log_speed
                + exponents.feed[law] * log_feed
                + exponents.wear[law] * term
            )
            loads.append(at_criterion - log(limit) + by_place)
        return loads[FORCE], loads[POWER]


def _belief_of(env: Any, num_envs: int) -> Belief:
    """Return a belief for the environments of a wrapper."""
    scenario = scenario_of(env, "a belief")
    return Belief([scenario.nominal()] * num_envs, bool(scenario.nominal_model))


def _begin(belief: Belief, env: Any, mask: Mask, infos: dict[str, Any]) -> None:
    """Forget the estimates in a mask, shape (num_envs,), where an episode has begun.

    If the environments play a family, the episode may be another job.
    """
    belief.filter.reset(mask)
    if not isinstance(env, FamilyEnv | FamilyVectorEnv):
        return

    def nominal_model(number: int) -> Scenario:
        job = env.family.job(number, env.split)
        return job.scenario.nominal()

    for index in np.flatnonzero(mask).tolist():
        numbers = np.atleast_1d(infos["job"])
        belief.assign(index, int(numbers[index]), nominal_model)


def with_belief(space: Any) -> Any:
    """Return an observation space with the entries of a belief behind its own."""
    limit = np.full(len(ENTRIES), LIMIT, np.float32)
    return Box(
        np.concatenate([space.low, -limit]), np.concatenate([space.high, limit]), dtype=np.float32
    )


def at_end(observations: Observations, infos: dict[str, Any], ended: Mask) -> Observations:
    """Return observations, with the last one of the episode where it has ended."""
    last = observations.copy()
    last[ended] = np.stack(infos["final_obs"][ended])
    return last


def with_final(infos: dict[str, Any], ended: Mask, seen: Observations) -> dict[str, Any]:
    """Return infos with the last observations of ended episodes from ``seen``.

    ``seen`` has the shape (num_envs, entries).
    """
    final = infos["final_obs"].copy()
    for index in np.flatnonzero(ended):
        final[index] = seen[index]
    return infos | {"final_obs": final}


class BeliefPolicy(Policy):
    """A policy that is shown a belief behind the observations."""

    def __init__(self, policy: Policy, belief: Belief) -> None:
        self._policy = policy
        self._belief = belief

    def reset(self, mask: Mask) -> None:
        self._belief.filter.reset(mask)
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        believed = self._belief.observe(observations)
        return self._policy.act(np.concatenate([observations, believed], axis=1))


class BeliefObservation(
    gymnasium.Wrapper[Observations, Observations, Observations, Observations], RecordConstructorArgs
):
    """A wrapper that appends ``ENTRIES`` of a belief to observations.

    Raises:
        ValueError: ``Belief`` refuses the environment.
    """

    def __init__(self, env: gymnasium.Env[Observations, Observations]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self._belief = _belief_of(env, 1)
        self.observation_space = with_belief(env.observation_space)

    def reset(self, **options: Any) -> tuple[Observations, dict[str, Any]]:
        observation, info = self.env.reset(**options)
        begins = np.ones(1, np.bool_)
        _begin(self._belief, self.env.unwrapped, begins, info)
        return self._with_belief(observation), info

    def step(self, action: Observations) -> tuple[Observations, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._with_belief(observation), reward, terminated, truncated, info

    def _with_belief(self, observation: Observations) -> Observations:
        """Return an observation, shape (entries,), and behind it the entries of the belief."""
        believed = self._belief.observe(observation[np.newaxis])[0]
        return np.concatenate([observation, believed])


# Not subscripted: VectorWrapper is generic only from Gymnasium 1.4 on.
class VectorBeliefObservation(VectorWrapper):
    """``BeliefObservation`` for a vector environment, in every mode of autoreset."""

    def __init__(self, env: VectorEnv[Observations, Observations, NDArray[Any]]) -> None:
        super().__init__(env)
        self._belief = _belief_of(env, env.num_envs)
        self._all = np.ones(env.num_envs, np.bool_)
        self._ended = np.zeros(env.num_envs, np.bool_)
        self.single_observation_space = with_belief(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask", self._all)
        self._ended = self._ended & ~mask
        _begin(self._belief, self.env.unwrapped, mask, infos)
        return self._with_belief(observations, mask), infos

    def step(self, actions: Observations) -> tuple[Observations, Any, Any, Any, dict[str, Any]]:
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = terminated | truncated
        env = self.env.unwrapped
        learns_from = self._all
        if env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP:
            # Episodes that ended a step ago begin with these observations.
            _begin(self._belief, env, self._ended, infos)
            self._ended = ended
        elif "final_obs" in infos:
            # The belief learns from the last observations first, then begins with the new ones.
            last = self._with_belief(at_end(observations, infos, ended), self._all)
            infos = with_final(infos, ended, last)
            _begin(self._belief, env, ended, infos)
            learns_from = ended
        return self._with_belief(observations, learns_from), rewards, terminated, truncated, infos

    def _with_belief(self, observations: Observations, mask: Mask) -> Observations:
        """Return observations and the belief behind them, which learns in environments of a mask.

        The shape is (num_envs, entries).
        """
        return np.concatenate([observations, self._belief.observe(observations, mask)], axis=1)
