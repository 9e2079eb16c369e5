"""What a thread of the accelerator does: for one lane, what ``turning_env/lathes.py`` does for the lanes of a block.

The transition is the one of ``turning_env/lathe.py``, compiled once more by Numba for the accelerator; nothing of it stands here.
"""

from typing import Any

import numpy as np

from turning_env.accelerator.layout import aligned, lane_of
from turning_env.accelerator.target import Kernel, cuda
from turning_env.lathe import run_interval, start_episode
from turning_env.observation import observe
from turning_env.records import LANES, PARAMETERS, REPORT, WIDTH, WORK, narrowed
from turning_env.report import write_state
from turning_env.sections import MOST_PASSES

LANE, LANE_REPORT, NOTES, ALIGNED_PARAMETERS = lane_of(LANES), lane_of(REPORT), narrowed(WORK), aligned(PARAMETERS)
_MOST_ACTIONS = 2 + 2 * MOST_PASSES + 1
_ONE = np.uint64(1)


def _start(blocks: Any, parameters: Any, reports: Any, seeds: Any, observations: Any, rewards: Any, ends: Any) -> None:
    """Start the first episode of a lane's seed."""
    lane = cuda.grid(1)
    if lane < rewards.shape[0]:
        work = cuda.local.array(1, NOTES)[0]
        lanes, report, p = blocks[lane // WIDTH, lane % WIDTH], reports[lane // WIDTH, lane % WIDTH], parameters[0]
        lanes.seed[0] = seeds[lane]
        lanes.episode[0] = 0
        start_episode(lanes, work, report, 0, p)
        observe(lanes, work, 0, 1, p)
        for k in range(observations.shape[1]):
            observations[lane, k] = work.observation[k, 0]
        rewards[lane] = 0.0
        ends[0, lane] = False
        ends[1, lane] = False


def _step(
    blocks: Any, parameters: Any, reports: Any, actions: Any, observations: Any, rewards: Any, ends: Any, unfit: Any
) -> None:
    """Run one interval in a lane, or start its next episode where one has ended.

    What of an action is not finite counts as 0, and lowers ``unfit``, shape (1,), to the lane.
    """
    lane = cuda.grid(1)
    if lane < rewards.shape[0]:
        work = cuda.local.array(1, NOTES)[0]
        given = cuda.local.array((1, _MOST_ACTIONS), np.float64)
        lanes, report, p = blocks[lane // WIDTH, lane % WIDTH], reports[lane // WIDTH, lane % WIDTH], parameters[0]
        if lanes.ended[0] > 0:
            lanes.episode[0] += _ONE
            start_episode(lanes, work, report, 0, p)
            work.reward[0] = 0.0
            work.terminated[0] = 0
            work.truncated[0] = 0
        else:
            for k in range(actions.shape[1]):
                finite = abs(actions[lane, k]) < np.inf
                given[0, k] = actions[lane, k] if finite else 0.0
                if not finite:
                    cuda.atomic.min(unfit, 0, lane)
            run_interval(lanes, work, report, given, 1, p)
        observe(lanes, work, 0, 1, p)
        for k in range(observations.shape[1]):
            observations[lane, k] = work.observation[k, 0]
        rewards[lane] = work.reward[0]
        ends[0, lane] = work.terminated[0] > 0
        ends[1, lane] = work.truncated[0] > 0


def _tell(blocks: Any, parameters: Any, reports: Any, rewards: Any) -> None:
    """Put a lane's true state into its report, beside the interval's sums."""
    lane = cuda.grid(1)
    if lane < rewards.shape[0]:
        write_state(blocks[lane // WIDTH, lane % WIDTH], reports[lane // WIDTH, lane % WIDTH], 0, 1, parameters[0])


start, step, tell = Kernel(_start), Kernel(_step), Kernel(_tell)
