"""Predict the hidden forms of lathes from the history of their first two edges.

A rule that explores cuts with two edges: ``self_tuning``, slowly with the first and as fast as it
likes with the second, keeps edges until they end, and takes the lowest feed of the chip breaker in
every third minute. Numbers of the history that observations give, and nothing else, go into a ridge
regression for each form. Its area under the ROC curve (AUC) on jobs that were left out says whether
the information is there: 0.5 is chance, 1 tells every lathe apart. ``unmodelled_draw`` prints it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from baselines.reactive import MAX_BROKEN_WEAR, START_SHARE
from baselines.rule import Array, Mask
from baselines.self_tuning import RULES, SelfTuning
from turning_env import Family, FamilyVectorEnv, Reading, Scenario, read
from turning_env.action import towards
from turning_env.numerics.functions import log
from turning_env.policy import Actions, Observations
from turning_env.scenario.scenario_batch import ScenarioBatch

EDGES = 2  # edges of the history
FEED_SCALE = 0.25  # feed at which the heat counts from the start speed alone [mm/rev]
SLOW_SHARES = (0.5, 0.65, 0.8)
"""Highest speeds over the start speed with the first edge [-], a minute each, in turns."""
FAST_SHARES = (1.0, 1.2, 1.6)  # likewise with the edges after it
STAGE = 1.0  # cutting time for which a highest speed holds [min]
LOW_FEED = 1.03  # low feed over the lowest of the chip breaker's window [-]
BATCH = 64  # jobs that are played together
SPEED_BINS = np.array([-0.8, -0.55, -0.4, -0.25, -0.1, 0.05, 0.2])  # of log(speed / start speed)
MIN_STEPS = 20  # steps in a bin of speed, with fewer it says nothing
MIN_RATIO = 0.1  # lower bound of measured over predicted loads, likewise [-]
MIN_WEAR = 1e-3  # lower bound of wear over the criterion, before its logarithm is taken [-]
FOLDS = 8
MIN_DEVIATION = 1e-9
MAX_STANDARD = 4.0  # of a standardised number
RIDGE = 30.0  # penalty over the squares of the slopes
RESAMPLES = 1000
KEY = 58  # of the resamples

HISTORY = np.dtype(
    [
        ("edge", np.int64),
        ("log_speed", np.float64),  # over the start speed
        ("log_feed", np.float64),  # over the lowest of the chip breaker's window
        ("low_feed", np.bool_),  # the low feed is commanded
        ("heat", np.float64),  # see ``heat_of``
        ("nominal_wear", np.float64),  # over the criterion
        ("force_over_power", np.float64),  # log of measured over predicted force, less power's
        ("cutting", np.bool_),
        ("tangles", np.float64),
    ]
)
"""A step of an environment, as its observations tell."""

ENDED = np.dtype([("wear", np.float64), ("nominal_wear", np.float64), ("ended", np.bool_)])
"""The end of an edge: measured and predicted wear over the criterion."""


class Explorer(SelfTuning):
    """``self_tuning`` that tries speeds and feeds, and keeps edges until they end.

    Arguments as ``SelfTuning``.

    Attributes:
        low_feed: where the low feed is commanded, shape (num_envs,).
    """

    def __init__(self, scenario: Sequence[Scenario], num_envs: int) -> None:
        parameters: Any = RULES["self_tuning"].fixed
        super().__init__(scenario, num_envs, **parameters)
        self._edge = np.zeros(num_envs, np.int64)
        self._cutting_time = np.zeros(num_envs)
        self.low_feed = np.zeros(num_envs, np.bool_)

    def reset(self, mask: Mask) -> None:
        super().reset(mask)
        self._edge[mask] = 0
        self._cutting_time[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        reading = read(observations, self._scenario)
        edge_is_fresh = reading.cutting_time < self._cutting_time
        self._edge += edge_is_fresh
        self._cutting_time = reading.cutting_time

        # The stages follow one another for as long as the edge cuts.
        stages_begun = (reading.cutting_time / STAGE).astype(np.int64)
        stage = stages_begun % len(SLOW_SHARES)
        slow = np.array(SLOW_SHARES)[stage]
        fast = np.array(FAST_SHARES)[stage]
        is_first_edge = self._edge == 0
        self.top_speed[:] = START_SHARE * np.where(is_first_edge, slow, fast)

        actions = super().act(observations)
        self.low_feed = stage == len(SLOW_SHARES) - 1
        lowest_feed = self._scenario.feed_range[0]
        feed = LOW_FEED * lowest_feed * np.ones(len(actions))
        speed = reading.commanded_cutting_speed
        slowly = towards(reading, self._scenario, speed, feed)
        actions[:, 1] = np.where(self.low_feed, slowly[:, 1], actions[:, 1])
        return actions

    def _edge_is_spent(self, reading: Reading, used_life: Array, price: Array) -> Mask:
        return super()._edge_is_spent(reading, used_life, np.full_like(price, np.inf))


def heat_of(reading: Reading, scenario: Any, start_speed: Array) -> Array:
    """Return the log speed over the start speed at which a worn-out edge is as hot [-].

    By the law of temperature that all scenarios have by default, at ``FEED_SCALE``.
    """
    law = scenario.edge_failure.temperature
    wear = np.maximum(reading.nominal_wear / scenario.tool.wear_criterion, MIN_WEAR)
    log_speed = log(reading.cutting_speed / start_speed)
    by_feed = law.feed * log(reading.feed / FEED_SCALE)
    by_wear = law.wear * log(wear)
    return np.asarray(log_speed + (by_feed + by_wear) / law.cutting_speed)


@dataclass(frozen=True)
class Histories:
    """The histories of some jobs."""

    steps: Any  # records of ``HISTORY``, shape (steps, jobs)
    ends: Any  # records of ``ENDED``, shape (EDGES, jobs)


class Recorder:
    """Keeps what the observations of some jobs tell.

    Args:
        models: nominal model of each job.

    Attributes:
        steps: records of ``HISTORY``, one array of shape (jobs,) for each step.
        ends: records of ``ENDED``, shape (EDGES, jobs).
    """

    def __init__(self, models: Sequence[Scenario]) -> None:
        jobs = len(models)
        batch: Any = ScenarioBatch.of(models)
        self._batch = batch
        self._start_speed = START_SHARE * batch.machine.cutting_speed_max
        self._lowest_feed = batch.feed_range[0]
        self._edge = np.zeros(jobs, np.int64)
        self._over = np.zeros(jobs, np.bool_)
        self._cutting_time = np.zeros(jobs)
        self._nominal_wear = np.zeros(jobs)
        self.steps: list[Any] = []
        self.ends = np.zeros((EDGES, jobs), ENDED)

    @property
    def done(self) -> bool:
        """Whether all jobs have used ``EDGES`` edges, or have run out of time."""
        ended = self._over | (self._edge >= EDGES)
        return bool(ended.all())

    def note(self, observations: Observations, low_feed: Mask, ended: Mask) -> None:
        """Note a step.

        Args:
            observations: after the step, shape (jobs, entries).
            low_feed: where the low feed was commanded, shape (jobs,).
            ended: which episodes have ended, shape (jobs,).
        """
        reading = read(observations, self._batch)
        self._over |= ended
        criterion = self._batch.tool.wear_criterion
        nominal_wear = reading.nominal_wear / criterion
        step = np.zeros(len(ended), HISTORY)
        step["edge"] = np.where(self._over, EDGES, self._edge)
        step["log_speed"] = log(reading.cutting_speed / self._start_speed)
        step["log_feed"] = log(reading.feed / self._lowest_feed)
        step["low_feed"] = low_feed
        step["heat"] = heat_of(reading, self._batch, self._start_speed)
        step["nominal_wear"] = nominal_wear
        force_ratio = np.maximum(reading.force_ratio, MIN_RATIO)
        power_ratio = np.maximum(reading.power_ratio, MIN_RATIO)
        step["force_over_power"] = log(force_ratio / power_ratio)
        step["cutting"] = reading.cutting & (nominal_wear > 0.0)
        step["tangles"] = reading.tangles
        self.steps.append(step)

        fresh = reading.cutting_time < self._cutting_time
        replaced = fresh & ~self._over & (self._edge < EDGES)
        removed_wear = reading.removed_wear / criterion
        for job in np.flatnonzero(replaced):
            end = self.ends[self._edge[job], job]
            end["wear"] = removed_wear[job]
            end["nominal_wear"] = self._nominal_wear[job]
            end["ended"] = True
        self._edge += replaced
        self._cutting_time = reading.cutting_time
        self._nominal_wear = nominal_wear


def explore(family: Family, split: str, jobs: Sequence[int]) -> Histories:
    """Play jobs until all have used ``EDGES`` edges, or have run out of time."""
    models = [family.job(job, split).scenario.nominal() for job in jobs]
    count = len(jobs)
    env = FamilyVectorEnv(count, family, split, "hidden", AutoresetMode.SAME_STEP)
    observations, _ = env.reset(seed=list(jobs))
    policy = Explorer(models, count)
    policy.reset(np.ones(count, np.bool_))
    recorder = Recorder(models)
    while not recorder.done:
        actions = policy.act(observations)
        observations, _, terminated, truncated, _ = env.step(actions)
        recorder.note(observations, policy.low_feed, terminated | truncated)
    env.close()
    return Histories(np.array(recorder.steps), recorder.ends)


def numbers_of(histories: Histories) -> Array:
    """Return the numbers that describe each history, shape (jobs, numbers)."""
    jobs = histories.steps.shape[1]
    rows = []
    for job in range(jobs):
        steps = histories.steps[:, job]
        counts = steps["cutting"] & (steps["edge"] < EDGES)
        cutting = steps[counts]
        row = tangling(cutting)
        for edge in range(EDGES):
            with_edge = cutting[cutting["edge"] == edge]
            row += of_edge(with_edge, histories.ends[edge, job])
        row += by_speed(cutting)
        rows.append(row)
    return np.array(rows)


def tangling(steps: Any) -> list[float]:
    """Return stops for tangled chips per step, at low and at other feeds [-]."""
    rates = []
    for low in (True, False):
        chosen = steps[steps["low_feed"] == low]
        # A fifth of a stop in two minutes is added, so that few steps say little.
        stops = chosen["tangles"].sum() + 0.2
        seconds = len(chosen) + 120.0
        rates.append(float(log(stops / seconds)))
    low_rate, other_rate = rates
    return [low_rate, other_rate, low_rate - other_rate]


def of_edge(steps: Any, end: Any) -> list[float]:
    """Return the numbers that describe an edge: how it ended, and what it has borne."""
    if not len(steps):
        return [0.0] * 9
    ended = float(end["ended"])
    wear = max(float(end["wear"]), MIN_WEAR)
    nominal_wear = max(float(end["nominal_wear"]), MIN_WEAR)
    surprise = float(log(wear / nominal_wear))
    broke = ended * float(wear < MAX_BROKEN_WEAR)
    last_heat = float(steps["heat"][-1])
    max_heat = float(steps["heat"].max())
    return [
        ended,
        broke,
        broke * wear,
        broke * last_heat,
        broke * (max_heat - last_heat),
        (1.0 - broke) * max_heat,
        ended * surprise,
        float(steps["log_speed"].mean()),
        float(log(len(steps) / 600.0)),
    ]


def by_speed(steps: Any) -> list[float]:
    """Return the mean force over power in each range of speed, less what laws explain.

    The last three numbers are the highest mean, its distance from the lowest, and the spread.

    Chatter adds to the force, but not to the mean power.
    """
    log_ratio = steps["force_over_power"]
    wear = np.maximum(steps["nominal_wear"], MIN_WEAR)
    factors = np.column_stack(
        [
            np.ones(len(steps)),
            steps["log_feed"],
            steps["log_speed"],
            log(wear),
        ]
    )
    # A slight ridge, as a history may not vary in a factor.
    normal = factors.T @ factors + 1e-3 * np.eye(4)
    solution = np.linalg.solve(normal, factors.T @ log_ratio)
    residuals = log_ratio - factors @ solution

    ranges = np.digitize(steps["log_speed"], SPEED_BINS)
    means = []
    for number in range(len(SPEED_BINS) + 1):
        chosen = residuals[ranges == number]
        mean = 0.0
        if len(chosen) >= MIN_STEPS:
            mean = float(chosen.mean())
        means.append(mean)
    highest = max(means)
    lowest = min(means)
    spread = float(residuals.std())
    return [*means, highest, highest - lowest, spread]


def chunks_of_similar_length(limits: Sequence[float], size: int) -> Iterator[list[int]]:
    """Yield the indices of jobs that are played together, by their time limits.

    Jobs of a chunk last about as long, so that few environments wait for the others.
    """
    order = np.argsort(limits, kind="stable").tolist()
    for first in range(0, len(order), size):
        yield order[first : first + size]


def explored(family: Family, split: str, num_jobs: int) -> Array:
    """Return the numbers of the histories of the first jobs, shape (jobs, numbers)."""
    limits = []
    for number in range(num_jobs):
        job = family.job(number, split)
        limits.append(job.scenario.control.time_limit)
    numbers: Any = None
    for chunk in chunks_of_similar_length(limits, BATCH):
        histories = explore(family, split, chunk)
        of_chunk = numbers_of(histories)
        if numbers is None:
            numbers = np.empty((num_jobs, of_chunk.shape[1]))
        numbers[chunk] = of_chunk
    return np.asarray(numbers)


def left_out_scores(numbers: Array, present: NDArray[np.bool_]) -> Array:
    """Return the score of each job by a ridge regression on the other folds, shape (jobs,).

    Args:
        numbers: numbers of the histories, shape (jobs, numbers).
        present: whether a job has the form, shape (jobs,).
    """
    scores = np.empty(len(numbers))
    folds = np.arange(len(numbers)) % FOLDS
    for fold in range(FOLDS):
        left_out = folds == fold
        others = numbers[~left_out]
        mean = others.mean(axis=0)
        spread = np.maximum(others.std(axis=0), MIN_DEVIATION)
        deviations = (numbers - mean) / spread
        standard = np.clip(deviations, -MAX_STANDARD, MAX_STANDARD)
        squares = standard**2 - 1.0
        features = np.column_stack([standard, squares])

        train = features[~left_out]
        target = present[~left_out].astype(np.float64)
        target -= target.mean()
        ridge = RIDGE * np.eye(features.shape[1])
        normal = train.T @ train + ridge
        slopes = np.linalg.solve(normal, train.T @ target)
        scores[left_out] = features[left_out] @ slopes
    return scores


def area_under_curve(scores: Array, present: NDArray[np.bool_]) -> float:
    """Return the chance that a job with the form scores higher than one without it."""
    with_form = scores[present][:, np.newaxis]
    without = scores[~present]
    higher = (with_form > without).mean()
    # Of equal scores, either may be the higher one.
    equal = (with_form == without).mean()
    return float(higher + 0.5 * equal)


def area_with_interval(scores: Array, present: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return the area under the curve with its 95 % bootstrap interval over jobs."""
    generator = np.random.default_rng(KEY)
    jobs = len(scores)
    areas = []
    for _ in range(RESAMPLES):
        picks = generator.integers(jobs, size=jobs)
        area = area_under_curve(scores[picks], present[picks])
        areas.append(area)
    low, high = np.quantile(areas, [0.025, 0.975])
    area = area_under_curve(scores, present)
    return area, float(low), float(high)
