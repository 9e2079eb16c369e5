"""Lathes whose states, observations and rewards stay in the accelerator's memory."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env import observation
from turning_env.accelerator.layout import fields_in, lanes_in, put
from turning_env.accelerator.target import cuda, need_accelerator, simulated
from turning_env.lathes import checked_seed
from turning_env.records import LANES, REPORT, REPORT_FIELDS, WIDTH, action_size, new_records, parameter_records
from turning_env.scenario import Scenario

_NONE = np.iinfo(np.int64).max


class AcceleratedLathes:
    """``count`` lathes on an NVIDIA GPU: lane i is the single environment of its seed, across autoresets.

    Specification: see ``RoughTurningEnv``; a step after an episode's end ignores its action and starts the next episode, with
    reward 0 (NEXT_STEP of ``RoughTurningVectorEnv``). ``step`` returns before the accelerator has finished; whatever reads the
    arrays on the same stream, the default one, comes after it.

    Args:
        count: number of lanes, at least 1.
        scenario: the name of a preset, the path of a TOML file, or a ``Scenario``.

    Attributes:
        observations: float32, shape (count, entries): see ``turning_env.observation``.
        rewards: float64, shape (count,), in s of machine time.
        ends: bool, shape (2, count): terminated and truncated.
        reports: float64, shape (blocks, fields, 32): what ``info`` tells, field by field of ``records.REPORT_FIELDS``; the sums
            over the last interval, and after ``tell`` the true state.

    All four are Numba's device arrays, written to again by every step: each has ``__cuda_array_interface__``, so that
    ``torch.as_tensor(lathes.observations, device="cuda")`` is the same memory.

    Raises:
        NoAcceleratorError: there is no GPU, or what drives it is missing; the message says what.
        ScenarioError: the scenario cannot be loaded.
        ValueError: ``count`` is below 1.
    """

    def __init__(self, count: int, scenario: str | os.PathLike[str] | Scenario = "rough_turning") -> None:
        if count < 1:
            raise ValueError(f"count is {count}, but must be at least 1")
        need_accelerator()
        from turning_env.accelerator import kernels  # compiles

        self._kernels = kernels
        self.count = count
        self.scenario = Scenario.load(scenario)
        self.action_size = action_size(self.scenario)
        parameters = new_records(kernels.ALIGNED_PARAMETERS, 1).view(np.ndarray)
        put(parameters[0], parameter_records(self.scenario)[0])
        blocks = -(-count // WIDTH)
        self._parameters = cuda.to_device(parameters)
        # Zeros, since what no scenario's spread asks for is never drawn, but multiplied by 0.
        self._blocks = cuda.to_device(np.zeros(blocks, LANES))
        self._reports = cuda.to_device(np.zeros(blocks, REPORT))
        self._lanes, self._lane_reports = lanes_in(self._blocks, kernels.LANE), lanes_in(self._reports, kernels.LANE_REPORT)
        self._unfit = cuda.to_device(np.array([_NONE]))
        self.reports = fields_in(self._reports)
        self.observations = cuda.device_array((count, len(observation.bounds(self.scenario)[0])), np.float32)
        self.rewards = cuda.device_array(count, np.float64)
        self.ends = cuda.device_array((2, count), np.bool_)
        self._seeded = False

    def reset(self, seed: int | Sequence[int] | NDArray[np.uint64] = 0) -> None:
        """Start episode 0 of ``seed + i``, or of ``seed[i]``, in every lane i.

        Raises:
            ValueError: a seed is not a whole number of 0 to 2**64 - 1, or there are not as many as lanes.
        """
        if isinstance(seed, Sequence | np.ndarray):
            if len(seed) != self.count:
                raise ValueError(f"there are {len(seed)} seeds, but must be one for each of {self.count} lanes")
            seeds = np.array([checked_seed(number, lane) for lane, number in enumerate(seed)], np.uint64)
        else:
            first = checked_seed(seed, 0)
            checked_seed(first + self.count - 1, self.count - 1)
            seeds = np.uint64(first) + np.arange(self.count, dtype=np.uint64)
        answers = self.observations, self.rewards, self.ends
        self._kernels.start(self.count, self._lanes, self._parameters, self._lane_reports, cuda.to_device(seeds), *answers)
        self._seeded = True

    def step(self, actions: Any) -> None:
        """Run one interval in every lane, or start the next episode where one has ended.

        Args:
            actions: float32 or float64 of shape (count, action_size) in the accelerator's memory: whatever has
                ``__cuda_array_interface__``, such as a torch tensor. What is not finite counts as 0; ``check`` tells.

        Raises:
            TypeError: the actions are not in the accelerator's memory.
            ValueError: they are of another shape or type; or ``reset`` has not been called.
        """
        if not self._seeded:
            raise ValueError("call reset() first: no episode is under way")
        given = self._taken(actions)
        shape = self.count, self.action_size
        if given.shape != shape or given.dtype not in (np.float32, np.float64):
            raise ValueError(f"actions must be float32 or float64 of shape {shape}, got {given.dtype} of {given.shape}")
        answers = self.observations, self.rewards, self.ends, self._unfit
        self._kernels.step(self.count, self._lanes, self._parameters, self._lane_reports, given, *answers)

    def check(self) -> None:
        """Wait for the accelerator, and see whether all actions since the last check were finite.

        Raises:
            ValueError: one was not; names the first lane.
        """
        lane = int(self._unfit.copy_to_host()[0])
        if lane < _NONE:
            self._unfit.copy_to_device(np.array([_NONE]))
            raise ValueError(f"an action of lane {lane} was not finite, and counted as 0")

    def tell(self) -> None:
        """Put the true state into ``reports``."""
        self._kernels.tell(self.count, self._lanes, self._parameters, self._lane_reports, self.rewards)

    def info(self) -> dict[str, NDArray[np.float64]]:
        """The true state and the last interval's sums, in the main memory: an array of shape (count,) for every field."""
        self.tell()
        told = self._reports.copy_to_host()
        return {name: told[name].reshape(-1)[: self.count] for name in REPORT_FIELDS}

    def _taken(self, actions: Any) -> Any:
        if hasattr(actions, "__cuda_ndarray__"):  # Numba's own
            return actions
        if simulated() and isinstance(actions, np.ndarray):
            return cuda.to_device(actions)
        if not hasattr(actions, "__cuda_array_interface__"):
            raise TypeError(
                f"actions must be in the accelerator's memory (__cuda_array_interface__), got {type(actions).__name__}"
            )
        return cuda.as_cuda_array(actions)
