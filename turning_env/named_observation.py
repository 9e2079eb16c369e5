"""Wrappers that give observations by name, as dictionaries.

A network sees the same numbers, and code can name them. The wrappers also let Gymnasium's
``FilterObservation`` hide entries, and learners treat the parts of an observation apart.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from turning_env.physics.quantities import layout

Named = dict[str, NDArray[np.float32]]


def _places(env: Any, space: spaces.Space[Any]) -> dict[str, slice]:
    """Return the place of each named part of the observations of an environment.

    Raise ValueError if a wrapper has changed the observations.
    """
    names = layout(env.unwrapped.scenario)
    plain = getattr(env.unwrapped, "single_observation_space", env.unwrapped.observation_space)
    if space != plain:
        raise ValueError(
            "the names are those of unchanged observations: apply this wrapper before others"
        )
    (size,) = plain.shape
    places = {name: slice(place, place + 1) for place, name in enumerate(names)}
    if size > len(names):
        places["context"] = slice(len(names), size)
    return places


def _named_space(space: Any, places: dict[str, slice]) -> spaces.Space[Any]:
    """Return the space of named observations."""
    boxes: dict[str, spaces.Space[Any]] = {}
    for name, place in places.items():
        boxes[name] = spaces.Box(space.low[place], space.high[place], dtype=np.float32)
    return spaces.Dict(boxes)


class NamedObservation(gymnasium.ObservationWrapper[Named, Any, Any], RecordConstructorArgs):
    """Gives the observations of a single environment as dictionaries.

        env = NamedObservation(gymnasium.make("RoughTurning-v0"))

    A dictionary has a key for each entry of ``turning_env.OBS`` that the scenario has, with an
    array of shape (1,). On a family, ``context`` holds the numbers of the nominal model, shape
    (numbers,). Learn on it with a policy for dictionaries, such as "MultiInputPolicy".

    Raises:
        ValueError: another wrapper has changed the observations already.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        self._places = _places(env, env.observation_space)
        self.observation_space = _named_space(env.observation_space, self._places)

    def observation(self, observation: NDArray[np.float32]) -> Named:
        """Return the named parts of an observation, or of a batch of shape (n, entries)."""
        return {name: observation[..., place] for name, place in self._places.items()}


class NamedVectorObservation(VectorWrapper[Named, Any, Any, Any, Any], RecordConstructorArgs):
    """Gives the observations of a vector environment as dictionaries; see ``NamedObservation``.

        envs = NamedVectorObservation(gymnasium.make_vec("RoughTurning-v0", 64))
        envs = RoughTurningVecEnv("rough_turning", 64, wrapper=NamedVectorObservation)

    Arrays have the shape (num_envs, 1), ``context`` (num_envs, numbers). With SAME_STEP, the last
    observations in ``infos["final_obs"]`` are dictionaries, too.
    """

    def __init__(self, env: Any) -> None:
        RecordConstructorArgs.__init__(self)
        VectorWrapper.__init__(self, env)
        self._places = _places(env, env.single_observation_space)
        self.single_observation_space = _named_space(env.single_observation_space, self._places)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def observation(self, observation: NDArray[np.float32]) -> Named:
        """Return the named parts of observations of shape (num_envs, entries), or of one."""
        return {name: observation[..., place] for name, place in self._places.items()}

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Named, dict[str, Any]]:
        """Reset the environments; see ``RoughTurningVectorEnv.reset``."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return self.observation(observations), infos

    def step(self, actions: Any) -> tuple[Named, Any, Any, Any, dict[str, Any]]:
        """Run one step; see ``RoughTurningVectorEnv.step``."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if "final_obs" in infos:
            finals = np.full(self.num_envs, None, dtype=object)
            for index in np.flatnonzero(infos["_final_obs"]):
                finals[index] = self.observation(infos["final_obs"][index])
            infos = infos | {"final_obs": finals}
        return self.observation(observations), rewards, terminated, truncated, infos
