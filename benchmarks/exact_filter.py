"""A planner with the exact filter of the bars: how far a policy can go that sees observations only.

The filter of ``predictive`` models depth and hardness along a bar as a process with a slope. The simulator blends independent
normal nodes, one correlation length apart. Given the tool's position, the fields are linear in the nodes, so a Kalman filter of
the nodes is exact but for the logarithm of depth. The planner is ``predictive`` on these beliefs, and can be told hidden states.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.models.kalman import DEPTH, DEPTH_SLOPE, HARDNESS, HARDNESS_SLOPE, WEAR, Array, LoadFilter
from baselines.oracles.perfect_state import DOUBT, true_states
from baselines.predictive import Predictive
from turning_env import Reading, Scenario

HIDDEN = {"depth": DEPTH, "hardness": HARDNESS, "wear": WEAR}
"""States that can be told, by name, in the order of ``true_states``."""
_STATES = 9
_FIELDS = ((DEPTH, DEPTH_SLOPE, 5, 6), (HARDNESS, HARDNESS_SLOPE, 7, 8))
"""States of depth and of hardness: the value here, the node behind, the bar's offset and the node ahead."""


class NodeFilter(LoadFilter):
    """A load filter of the nodes on either side of the tool and of each bar's offsets, all standard normal."""

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        super().__init__(scenario, num_envs)
        work = scenario.workpiece
        self._spreads = (
            (work.depth_bar_spread / work.depth_of_cut, work.depth_along_spread / work.depth_of_cut),
            (work.hardness_bar_spread, work.hardness_along_spread),
        )
        self._lengths = work.depth_correlation_length, work.hardness_correlation_length
        self._prior = np.concatenate([self._prior, np.ones(_STATES - WEAR - 1)])
        self._prior[[DEPTH_SLOPE, HARDNESS_SLOPE]] = 1.0  # here the nodes behind
        self._mean = np.zeros((num_envs, _STATES))
        self._covariance = np.zeros((num_envs, _STATES, _STATES))

    def _transition(self, distance: Array) -> tuple[Array, Array]:
        metal = np.maximum(self.along - self._scenario.workpiece.approach, 0.0)
        # One distance leads to the tool's place, several lead on from there.
        start = metal - distance if distance.ndim == 1 else metal[:, np.newaxis] + np.zeros_like(distance)
        transition = np.zeros((*distance.shape, _STATES, _STATES))
        growth = np.zeros_like(transition)
        transition[..., WEAR, WEAR] = 1.0
        for (here, behind, offset, ahead), (bar, along), length in zip(_FIELDS, self._spreads, self._lengths, strict=True):
            place = (start + distance) / length + 1e-12
            passed = np.floor(place) > np.floor(start / length + 1e-12)
            share = place - np.floor(place)
            weights = along * (1.0 - share**2) / (1.0 + share**2), along * 2.0 * share / (1.0 + share**2)
            transition[..., offset, offset] = 1.0
            transition[..., behind, behind] = transition[..., ahead, ahead] = ~passed
            transition[..., behind, ahead] = passed
            transition[..., here, offset] = bar
            transition[..., here, behind] = np.where(passed, 0.0, weights[0])
            transition[..., here, ahead] = np.where(passed, *weights)
            growth[..., ahead, ahead] = passed
            growth[..., here, here] = np.where(passed, weights[1] ** 2, 0.0)
            growth[..., here, ahead] = growth[..., ahead, here] = np.where(passed, weights[1], 0.0)
        return transition, growth

    def _loads(self, mean: Array) -> tuple[Array, Array]:
        loads, derivatives = super()._loads(mean[..., : WEAR + 1])
        return loads, np.concatenate([derivatives, np.zeros((*derivatives.shape[:-1], _STATES - WEAR - 1))], axis=-1)

    def _enter_bars(self, mask: NDArray[np.bool_]) -> None:
        super()._enter_bars(mask)
        self._mean[mask, WEAR + 1 :] = 0.0


class ToldFilter(NodeFilter):
    """A filter of nodes that is told some of the hidden states at the tool after every step."""

    truth: Mapping[str, Any]
    """``info`` of the vector environment that came with the next observations."""

    def __init__(self, scenario: Scenario, num_envs: int, told: Sequence[str]) -> None:
        """``told``: names in ``HIDDEN``."""
        super().__init__(scenario, num_envs)
        self._told = [name for name in HIDDEN if name in told]

    def observe(self, reading: Reading) -> None:
        """Predict up to a reading, and correct the estimate by it and by what is told."""
        super().observe(reading)
        if not self._told:
            return
        known, states = true_states(self.truth, reading, self._scenario)
        rows = np.eye(_STATES)[[HIDDEN[name] for name in self._told]]
        surprise = states[:, [list(HIDDEN).index(name) for name in self._told]] - self._mean @ rows.T
        surprise = np.where(known[:, np.newaxis], surprise, 0.0)
        self._correct(rows * known[:, np.newaxis, np.newaxis], surprise, np.full(surprise.shape, DOUBT**2))
        self.measured |= known


class Planner(Predictive):
    """``Predictive`` on the exact filter; an oracle if it is told anything."""

    def __init__(self, scenario: Scenario, num_envs: int, told: Sequence[str] = ()) -> None:
        super().__init__(scenario, num_envs, severity=1.0, caution=1.0)
        self._filter: ToldFilter = ToldFilter(scenario, num_envs, told)

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Take the ``infos`` that came with the next observations."""
        self._filter.truth = infos
