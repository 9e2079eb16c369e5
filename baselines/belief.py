"""The belief of the optimisers' filter as an observation, so that an agent without memory knows what it has measured.

    env = BeliefObservation(gymnasium.make("RoughTurning-Family-v0"))
    envs = VectorBeliefObservation(gymnasium.make_vec("RoughTurning-Family-v0", 512))
    venv = RoughTurningVecEnv("shop", 512, wrapper=VectorBeliefObservation)  # Stable-Baselines3

The filter (``models/load_filter.py``) knows the nominal model and sees the observations alone, so a policy that plays with a
``Belief`` of its own has all that these wrappers show.
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
from baselines.models.load_filter import LoadFilter, model_of
from baselines.optimiser import plays
from baselines.rule import Mask
from turning_env import FamilyEnv, FamilyVectorEnv, Scenario
from turning_env.numerics.functions import log
from turning_env.observation import read
from turning_env.physics.quantities import layout
from turning_env.scenario.scenario import flat
from turning_env.scenario.scenario_batch import ScenarioBatch
from turning_env.scoring.policy import Actions, Observations, Policy

LIMIT = 10.0  # highest absolute value of an entry
MIN_DEVIATION = 1e-9
MIN_WEAR = 1e-3  # least nominal wear over the criterion at which loads are expected [-]

_STATES = (
    *(
        "depth",
        "depth_slope",
        "hardness",
        "hardness_slope",
        "insert",
        "edge_history",
        "wear",
        "wear_speed",
        "wear_feed",
    ),
    *(f"{law}{error}" for law in ("force", "power") for error in ("", "_speed", "_feed", "_wear")),
)
ENTRIES = (
    *(f"{name}_mean" for name in _STATES),  # over the standard deviation before the first reading
    *(f"{name}_deviation" for name in _STATES),  # likewise
    "log_wear_factor",  # of wear, true over nominal
    "log_wear_factor_deviation",
    "log_used_life",  # share of the edge's life
    "bar_measured",  # 0 or 1
    "log_time_to_bar",  # 1 + time [s] until the next bar's approach, at the present speed and feed
    # Over the limit, a step later at the present wear:
    *(f"{bar}_log_{law}" for bar in ("this", "next") for law in ("force", "power")),
    *(f"{bar}_log_{law}_deviation" for bar in ("this", "next") for law in ("force", "power")),
)
"""Names of the entries [-], each limited to -10..10."""

_CHOICE = "spindle.short_time_load"  # it decides which entries an observation has, so it is the same in all environments


def _values(scenario: Scenario) -> dict[str, Any]:
    """Return the values of a nominal model by dotted names."""
    return flat(scenario.model_dump(exclude={"name", "nominal_model"}))


class Belief:
    """Estimates in many environments with a nominal model each, as numbers of order one.

    ``learns_laws``: whether the laws are expected to have the errors that training jobs of the family ``shop`` have; else the
    nominal model is taken for true. ValueError if actions do not set speed and feed, or force is not measured.
    """

    def __init__(self, scenarios: Sequence[Scenario], learns_laws: bool) -> None:
        for scenario in scenarios:
            if not plays(scenario):
                raise ValueError(
                    f"a belief needs actions that set speed and feed, and a dynamometer, but scenario {scenario.name!r} has "
                    f"control.action {scenario.control.action!r} and sensors.force {scenario.sensors.force!r}"
                )
        self._errors = law_errors.read() if learns_laws else None
        self.filter = LoadFilter(scenarios, len(scenarios), self._errors)
        self._models: dict[int, tuple[dict[str, Any], Any]] = {}
        self.entries = len(layout(scenarios[0]))  # of an observation without a belief
        values = [*map(_values, scenarios)]
        numbers = [
            name
            for name, value in values[0].items()
            if isinstance(value, float) and name != _CHOICE
        ]
        self._numbers = {
            name: np.array([each[name] for each in values]) for name in numbers
        }  # of each environment
        self._scenario = ScenarioBatch(values[0] | self._numbers, len(scenarios))

    def assign(self, env_index: int, number: int, scenario: Callable[[int], Scenario]) -> None:
        """Give an environment another nominal model and forget its estimates; models are kept by their number."""
        if number not in self._models:
            found = scenario(number)
            self._models[number] = _values(found), model_of([found], self._errors)
        values, model = self._models[number]
        for name, column in self._numbers.items():
            column[env_index] = values[name]  # and so in the scenario
        self.filter.assign(env_index, model)

    def observe(self, observations: Observations, mask: Mask | None = None) -> Observations:
        """Learn from observations that begin with the environment's, of a mask or of all; return ``ENTRIES`` of each."""
        believed, scenario = self.filter, self._scenario
        reading = read(observations[:, : self.entries], scenario)
        believed.observe(reading, mask)
        deviations = np.sqrt(np.maximum(np.diagonal(believed.covariance, axis1=1, axis2=2), 0.0))
        prior = np.maximum(believed.prior_deviations, MIN_DEVIATION)
        wear = np.maximum(reading.nominal_wear / scenario.tool.wear_criterion, MIN_WEAR)
        used = (log(wear) + believed.log_wear_factor) / scenario.material.wear.time
        velocity = reading.cutting_speed * reading.feed * believed.parameters["velocity"]
        distance = np.repeat((velocity * scenario.control.interval)[:, np.newaxis], 2, axis=1)
        outlook = believed.outlook(distance, np.broadcast_to([False, True], distance.shape))
        place = np.stack([log(reading.cutting_speed), log(reading.feed), log(wear)], axis=1)
        laws, criterion = believed.parameters["log_laws"], believed.parameters["wear_criterion"]
        laws = laws[:, :, 0] + laws[:, :, 3] * log(criterion)[:, np.newaxis]
        laws = laws - log(np.stack([scenario.limits.thrust_force, scenario.limits.power], axis=1))
        laws = laws + (believed.exponents * place[:, np.newaxis, :]).sum(axis=2)
        expected = np.stack([outlook.log_force, outlook.log_power], axis=2) + laws[:, np.newaxis, :]
        spreads = np.stack([outlook.force_spread, outlook.power_spread], axis=2)
        columns = (
            *(believed.mean / prior, deviations / prior),
            *(believed.log_wear_factor, believed.wear_deviation, used, believed.memory["measured"]),
            log(1.0 + (believed.parameters["pitch"] - believed.along) / velocity),
            *(expected.reshape(len(wear), -1), spreads.reshape(len(wear), -1)),
        )
        joined = np.concatenate([np.reshape(column, (len(wear), -1)) for column in columns], axis=1)
        return np.asarray(np.clip(joined, -LIMIT, LIMIT), np.float32)


def _belief_of(env: Any, num_envs: int) -> Belief:
    scenario = getattr(env.unwrapped, "scenario", None)
    if not isinstance(scenario, Scenario):
        raise ValueError(f"a belief needs a RoughTurning environment, but this is {env.unwrapped}")
    return Belief([scenario.nominal()] * num_envs, bool(scenario.nominal_model))


def _begin(belief: Belief, env: Any, mask: Mask, infos: dict[str, Any]) -> None:
    """Forget the estimates of the environments in a mask, shape (num_envs,), which have begun an episode, perhaps another job."""
    belief.filter.reset(mask)
    if isinstance(env, FamilyEnv | FamilyVectorEnv):
        for index in np.flatnonzero(mask).tolist():
            number = int(np.atleast_1d(infos["job"])[index])
            belief.assign(
                index, number, lambda number: env.family.job(number, env.split).scenario.nominal()
            )


def with_belief(space: Any) -> Any:
    """Return an observation space with the entries of a belief behind its own."""
    limit = np.full(len(ENTRIES), LIMIT, np.float32)
    return Box(
        np.concatenate([space.low, -limit]), np.concatenate([space.high, limit]), dtype=np.float32
    )


def at_end(observations: Observations, infos: dict[str, Any], ended: Mask) -> Observations:
    """Return observations, where an episode has ended its last one."""
    last = observations.copy()
    last[ended] = np.stack(infos["final_obs"][ended])
    return last


def with_final(infos: dict[str, Any], ended: Mask, seen: Observations) -> dict[str, Any]:
    """Return infos in which the last observations of ended episodes are those of ``seen``, shape (num_envs, entries)."""
    final = infos["final_obs"].copy()
    for index in np.flatnonzero(ended):
        final[index] = seen[index]
    return infos | {"final_obs": final}


class BeliefPolicy(Policy):
    """A policy that is shown a belief behind the observations."""

    def __init__(self, policy: Policy, belief: Belief) -> None:
        self._policy, self._belief = policy, belief

    def reset(self, mask: Mask) -> None:
        self._belief.filter.reset(mask)
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        return self._policy.act(
            np.concatenate([observations, self._belief.observe(observations)], axis=1)
        )


class BeliefObservation(
    gymnasium.Wrapper[Observations, Observations, Observations, Observations], RecordConstructorArgs
):
    """A wrapper that appends ``ENTRIES`` of a belief to observations. ValueError if ``Belief`` refuses the environment."""

    def __init__(self, env: gymnasium.Env[Observations, Observations]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self._belief = _belief_of(env, 1)
        self.observation_space = with_belief(env.observation_space)

    def reset(self, **options: Any) -> tuple[Observations, dict[str, Any]]:
        observation, info = self.env.reset(**options)
        _begin(self._belief, self.env.unwrapped, np.ones(1, np.bool_), info)
        return self._seen(observation), info

    def step(self, action: Observations) -> tuple[Observations, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._seen(observation), reward, terminated, truncated, info

    def _seen(self, observation: Observations) -> Observations:
        return np.concatenate([observation, self._belief.observe(observation[np.newaxis])[0]])


class VectorBeliefObservation(
    VectorWrapper
):  # not subscripted: it is generic only from Gymnasium 1.4 on
    """``BeliefObservation`` for a vector environment, in every mode of autoreset."""

    def __init__(self, env: VectorEnv[Observations, Observations, NDArray[Any]]) -> None:
        super().__init__(env)
        self._belief = _belief_of(env, env.num_envs)
        self._all, self._ended = np.ones(env.num_envs, np.bool_), np.zeros(env.num_envs, np.bool_)
        self.single_observation_space = with_belief(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask", self._all)
        self._ended = self._ended & ~mask
        _begin(self._belief, self.env.unwrapped, mask, infos)
        return self._seen(observations, mask), infos

    def step(self, actions: Observations) -> tuple[Observations, Any, Any, Any, dict[str, Any]]:
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended, env = terminated | truncated, self.env.unwrapped
        if env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP:
            _begin(self._belief, env, self._ended, infos)
            self._ended = ended
        elif "final_obs" in infos:
            infos = with_final(
                infos, ended, self._seen(at_end(observations, infos, ended), self._all)
            )
            _begin(self._belief, env, ended, infos)
            return self._seen(observations, ended), rewards, terminated, truncated, infos
        return self._seen(observations, self._all), rewards, terminated, truncated, infos

    def _seen(self, observations: Observations, mask: Mask) -> Observations:
        return np.concatenate([observations, self._belief.observe(observations, mask)], axis=1)
