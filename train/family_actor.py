"""The network of the agent for all lathes of a family: the GRU of ``train/analytic_actor.py``, beside a filter.

Gradients reach over a rollout only, and a GRU must learn to average. The extended Kalman filter is given: that of
``baselines/models/kalman_steps.py``, which estimates depth and hardness of the bar, the wear of the insert, and errors of the
laws of wear, force and power. Their prior is the mean and covariance of the errors of training jobs (``train/law_errors.py``).
Beside the insert's factor, the filter follows the mean depth and hardness that its edge has cut. By the estimates,
``train/job_optimum.py`` gives the expected gain of commands, and ``train/newton_search.py`` finds the best ones. The network adds
to them.

The agent's file must play alone, so here the filter consists of tensors, and takes the nominal model from the context in the
observation. It computes in double precision, so that agent and file differ by no more than the network does. But the exporter
rounds a network's numbers to single precision, so those here are rounded before (``single``).

Lengths are shares of the bar, loads are ratios to the nominal model, and states are divided by their prior standard deviations.
Errors of laws are their mean plus the Cholesky factor of their covariance times the states. Then the prior has the mean 0 and the
covariance I, so an empty memory holds the prior.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch

from baselines.models.kalman_steps import DEPTH, HARDNESS, INSERT, INSPECTION_DEVIATION, MIN_DEPTH
from baselines.models.load_filter import READING_DEVIATION, SLOPE
from train.analytic_actor import MAX_TIME, GruActor
from train.job_optimum import MIN_EXPONENT, SET_POINT, Ahead, JobOptimum, LifeRate, Load, Nominal, log_over_half
from train.law_errors import ERRORS, LOADS
from train.newton_search import Pair, search, single
from turning_env import Scenario
from turning_env.physics.quantities import DEVIATION_SCALE, OBS, layout
from turning_env.scenario.plan import MIDDLE, USED_LIVES

Tensor = torch.Tensor

SEVERITY = single(0.9), single(0.4)
"""Factor on the price of overload, and its increase at full assumed model error [-] (found on training jobs and tuning seeds)."""
WEAR_CAUTION = single(1.1)
"""Factor on the standard deviation of the used life at which an edge may soon be worn out [-] (found on training jobs)."""
LEAD = 2.0
"""Steps before its end at which an edge is changed [-]."""
POINTS = 8
"""Number of future points in time at which cutting conditions are predicted."""
SETTLING = 3.0
"""Reach of these points beyond a step, over the feed servo's time constant [-]: the feed must fall before the next bar."""
EARLY = 0.1
"""Time by which the tool may enter a bar earlier than expected [s] (assumption)."""
MIN_RATIO = single(0.3)
"""Measured over expected load below which a reading is ignored [-]: the tool was partly in air."""
MIN_SEEN = 0.5
"""Share of the load behind the sensor's lag below which a reading is ignored [-]: the tool has just entered."""
MISFIT = single(0.02)
"""Standard deviation of log loads about the corrected laws, at full assumed model error [-] (found on training jobs)."""
TIMING_DEVIATION = 0.05
"""Standard deviation of the time at which the tool entered the bar [s] (assumption)."""
HISTORY = INSERT + 1
"""The state after the insert's log wear factor: that of the depth and hardness that its edge has met."""
LAWS = HISTORY + 1
"""The first state of the errors of laws: the error of the rate of wear."""
TAYLOR = LAWS + 1
"""The state of the error of the wear's exponent of speed."""
STATES = LAWS + ERRORS
PLACE = 8
"""Columns of the state that follow the tool: whether there was an observation, its position from the start of the bar over the
bar's length, logarithms of speed and feed over the plan's at half a life, nominal wear over the criterion, the edge's mean
logarithms of speed and feed, by the life that it used, and how far ahead the tool may be."""
_ACTUAL, _COMMANDED = (OBS.cutting_speed, OBS.feed), (OBS.commanded_cutting_speed, OBS.commanded_feed)
_LAWS = ("thrust_force", "power")
_ENDS = single(0.9999)  # of the range -1..1, from which targets keep away: tanh reaches 1 only at infinity
_MIN_VARIANCE = single(1e-6)
_MEASURED = -0.5  # reduction of the depth's variance, as a share, in a bar that has been measured
_INSIDE = single(1e-4)  # distance of log feed from the ends of the chip breaker's window
_LOG_HALF = single(math.log(USED_LIVES[MIDDLE]))
_SMALL = single(1e-3)  # below which wear over the criterion, or a share, is not distinguished from 0


class Linear(NamedTuple):
    """A quantity that is linear in the states."""

    row: Tensor
    """Derivatives by the states, shape (num_envs, STATES)."""
    prior: Tensor
    """Value at the prior's mean, shape (num_envs,)."""

    def at(self, mean: Tensor) -> Tensor:
        """Return the values, shape (num_envs,), at means of the states, shape (num_envs, STATES)."""
        return (self.row * mean).sum(dim=-1) + self.prior


class Place(NamedTuple):
    """Speed, feed and wear of an edge: logarithms over the plan's at half a life, each of shape (num_envs,)."""

    speed: Tensor
    feed: Tensor
    wear: Tensor
    """Nominal wear."""
    wear_factor: Linear
    """Logarithm of wear over the nominal wear."""


class Estimate(NamedTuple):
    """The filter's states and the nominal model of the job in each environment."""

    nominal: Nominal
    scales: Tensor
    """See ``JobFilter._scales``."""
    mean: Tensor
    """Shape (num_envs, STATES)."""
    excess: Tensor
    """The covariance less I, shape (num_envs, STATES, STATES)."""

    def covariances(self, row: Tensor) -> Tensor:
        """Return the covariances of the states with a quantity; ``row`` holds its derivatives by them."""
        return (self.excess @ row.unsqueeze(-1)).squeeze(-1) + row

    def corrected(self, row: Tensor, surprise: Tensor, seen: Tensor, variance: float | Tensor) -> "Estimate":
        """Return the estimate after a measurement where it is ``seen``; ``row`` holds its derivatives by the states."""
        gain = self.covariances(row)
        share = seen.to(gain.dtype) / ((row * gain).sum(dim=-1) + variance)
        mean = self.mean + gain * (share * surprise).unsqueeze(-1)
        return self._replace(mean=mean, excess=self.excess - share[:, None, None] * gain.unsqueeze(-1) * gain.unsqueeze(-2))


class JobFilter(torch.nn.Module):
    """A filter of bar, insert, wear factor and laws, beside a tracker of the tool's position along the bar.

    Observations have a last entry, the assumed model error: 0 for a true nominal model, 1 for one as wrong as the family's.

    The state, shape (num_envs, STATES), is 0 before an episode's first observation. Its columns are those of ``PLACE``, the
    mean, and the covariance less I.

    Args:
        scenario: a job of the family; see ``ALIKE``.
        context: ``names`` of the context's numbers, ``mean`` and ``spread`` by which they are standardised, and mean and Cholesky
            factor of the laws' errors, ``error_mean`` and ``error_factor``.
    """

    READINGS = 8 + STATES + 5 + 2 + 2 + 2 + 2 + 2
    STATES = PLACE + STATES + STATES * STATES
    ALIKE = (
        *("control.interval", "control.sub_steps", "control.cutting_speed_step", "control.feed_step", "workpiece.approach"),
        *("economics.breakage_downtime", "tool.edge_strength_spread"),
        *("economics.overload_price", "sensors.force_noise", "sensors.power_noise"),
        *("sensors.force_time_constant", "sensors.power_time_constant"),
        *(f"material.{law}.hardness" for law in (*_LAWS, "wear")),
    )
    """Fields of the scenario that all jobs must share, beside the ratios of the ranges of speed and feed."""

    _told_mean: Tensor
    _told_spread: Tensor
    _error_mean: Tensor
    _error_factor: Tensor
    _fields: Tensor
    _one: Tensor
    _bar: Tensor
    _edge: Tensor
    _history: Tensor

    def __init__(self, scenario: Scenario, context: dict[str, Any]) -> None:
        super().__init__()
        control, machine, material, sensors = scenario.control, scenario.machine, scenario.material, scenario.sensors
        ends = (machine.cutting_speed_min, machine.cutting_speed_max), (machine.feed_min, machine.feed_max)
        entries = layout(scenario)
        self._first, self._names = len(entries), list(context["names"])
        self._removed = entries.index("removed_wear") if "removed_wear" in entries else None
        self._spans = [single(math.log(high / low)) for low, high in ends]
        self._interval, self._sub_step = single(control.interval), single(control.interval / control.sub_steps)
        self._sub_steps, self._approach = control.sub_steps, single(scenario.workpiece.approach)
        self._steps = single(control.cutting_speed_step), single(control.feed_step)
        self._hardness = [single(law.hardness) for law in (material.thrust_force, material.power, material.wear)]
        self._overload_price = single(scenario.economics.overload_price)
        self._downtime = single(scenario.economics.breakage_downtime)
        self._strength_variance = single(scenario.tool.edge_strength_spread**2)
        self._noise = [single(noise**2 + READING_DEVIATION**2) for noise in (sensors.force_noise, sensors.power_noise)]
        self._lags = [single(lag) for lag in (sensors.force_time_constant, sensors.power_time_constant)]
        usual = dict(zip(self._names, context["mean"], strict=True))
        self._pivot = [single(usual[name]) for name in SET_POINT]
        one = torch.eye(STATES)
        fields = [torch.outer(one[start + row], one[start + k]) for start in (DEPTH, HARDNESS) for row in (0, 1) for k in (0, 1)]
        constants = {
            "told_mean": torch.tensor(context["mean"]),
            "told_spread": torch.tensor(context["spread"]),
            "error_mean": torch.tensor(context["error_mean"]),
            "error_factor": torch.tensor(context["error_factor"]),
            "fields": torch.stack(fields).flatten(1),
            "one": one,
            "bar": one[DEPTH:INSERT].sum(dim=0),
            "edge": one[INSERT] + one[HISTORY],
            "history": one[HISTORY],
        }
        for name, value in constants.items():
            self.register_buffer(f"_{name}", value.double(), persistent=False)

    def forward(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Return readings, shape (num_envs, READINGS), from -5 to 5, and the next state.

        The first two propose targets: the speed and the feed with the greatest expected gain of the coming second. Then follow
        the least and the greatest targets, the change of that feed with the speed, a score that is above 0 if the edge should be
        changed, the means, the variances of depth, hardness, insert, lot and the wear's exponent of speed, used life and its
        doubt, the logarithms of force and power over their limits at those targets, their standard deviations, the prices of
        time and life,
        and the readings of ``DistanceTracker``.
        """
        observation, state = observation.double(), state.double()
        context = observation[:, self._first : -1] * self._told_spread + self._told_mean
        nominal = dict(zip(self._names, context.unbind(dim=-1), strict=True)) | {"doubt": observation[:, -1]}
        begun, along, last_speed, last_feed, worn, *pace, slack = state[:, :PLACE].unbind(dim=-1)
        mean, excess = state[:, PLACE : PLACE + STATES], state[:, PLACE + STATES :].reshape(-1, STATES, STATES)
        estimate = Estimate(nominal, self._scales(nominal), mean, excess)

        wear = observation[:, OBS.nominal_wear]
        fresh_edge = wear < worn
        if self._removed is not None:
            removed = observation[:, self._removed]
            factor = self._wear_factor(estimate, pace)
            surprise = torch.log(removed.clamp(min=_SMALL) / worn.clamp(min=_SMALL)) - factor.at(estimate.mean)
            seen = fresh_edge & (removed > 0.0) & (worn > 0.0)
            estimate = estimate.corrected(factor.row, surprise, seen, single(INSPECTION_DEVIATION**2))

        speed, feed = self._set_point(observation, _ACTUAL, nominal)
        known = (torch.where(fresh_edge, 0.0, worn) / wear.clamp(min=_SMALL)).clamp(min=_SMALL, max=1.0)
        fresh_share = 1.0 - torch.exp(torch.log(known) / nominal["wear_time_exponent"].clamp(min=MIN_EXPONENT))
        fresh_share = torch.where(wear > 0.0, fresh_share, 0.0)
        pace = [was + fresh_share * (now - was) for was, now in zip(pace, (speed, feed), strict=True)]
        pace = [torch.where(wear > 0.0, each, 0.0) for each in pace]
        rate = torch.exp(speed + feed - nominal["log_bar_time"])
        commanded = self._set_point(observation, _COMMANDED, nominal)
        travel = begun * self._travel(nominal, (last_speed, last_feed), commanded)
        failed = fresh_edge & (wear <= 0.0)  # an edge that is found worn or broken ends the step early, somewhere
        travel = torch.where(failed, 0.5 * travel, travel)
        approach, cutting = self._approach_share(nominal), observation[:, OBS.cutting] > 0.5
        along = torch.where(begun > 0.0, along + travel, -approach)
        passed = along >= 1.0
        along = torch.where(passed, along - 1.0 - approach, along)
        # The reading on whether the tool cuts corrects the position.
        slack = torch.where(failed, torch.maximum(slack, travel), slack)
        slack = torch.where(cutting, slack, torch.minimum(slack, approach))
        left_late, left_early = cutting & (along < -0.5 * approach), ~cutting & (along > 0.5)
        along = torch.where(cutting, along.clamp(min=_SMALL), along.clamp(max=0.0))
        along = torch.where(left_late, 1.0, torch.where(left_early, -approach, along))
        fresh_bar, unused = left_early | (passed & ~left_late), (fresh_edge | (wear <= 0.0)).unsqueeze(-1)
        keeps = 1.0 - torch.where(fresh_bar.unsqueeze(-1), self._bar, 0.0) - torch.where(unused, self._edge, 0.0)
        excess = keeps.unsqueeze(-1) * estimate.excess * keeps.unsqueeze(-2)
        excess = excess - torch.where(unused, self._history, 0.0).diag_embed()  # an edge that has cut nothing has no history
        estimate = estimate._replace(mean=keeps * estimate.mean, excess=excess)
        estimate = self._worn(self._moved(estimate, torch.minimum(travel, along.clamp(min=0.0))), fresh_share)

        log_wear = torch.log(wear.clamp(min=_SMALL)) - nominal["wear_time_exponent"] * _LOG_HALF
        place = Place(speed, feed, log_wear, self._wear_factor(estimate, pace))
        idle = 0.0, self._idle_share(nominal, place)
        in_metal = (along / rate).clamp(min=0.0, max=self._interval)
        before = estimate
        for law, entry in enumerate((OBS.force_ratio, OBS.power_ratio)):
            row, expected = self._load(law, before, place)
            deviation = observation[:, entry] / DEVIATION_SCALE
            ratio = 1.0 + deviation * (1.0 + idle[law])
            shown = (1.0 - torch.exp(-in_metal / self._lags[law])).clamp(min=_SMALL)
            surprise = torch.log(ratio.clamp(min=_SMALL) / shown) - expected - (row * (estimate.mean - before.mean)).sum(dim=-1)
            seen = cutting & ~left_late & (shown > MIN_SEEN) & (ratio > MIN_RATIO) & (wear > 0.0)
            timing = single(TIMING_DEVIATION / self._lags[law]) * (1.0 / shown - 1.0)
            noise = self._noise[law] + timing.square() + (MISFIT * nominal["doubt"]).square()
            estimate = estimate.corrected(row, surprise, seen, noise)

        time_left = ((1.0 - along).clamp(min=0.0) / rate).clamp(max=MAX_TIME)
        position = 2.0 * along - 1.0, 2.0 * time_left / MAX_TIME - 1.0
        others = self._readings(estimate, wear, place, commanded, along, slack)
        readings = torch.stack([each.float() for each in (*others, *position)], dim=-1)
        followed = torch.stack([torch.ones_like(wear), along, speed, feed, wear, *pace, slack], dim=-1)
        return readings.clamp(-5.0, 5.0), torch.cat([followed, estimate.mean, estimate.excess.flatten(1)], dim=-1).float()

    def _scales(self, nominal: Nominal) -> Tensor:
        """Return the prior standard deviations of the states before ``LAWS``; the history's is 0, but its unit is 1."""
        depth, one = _spread(nominal, "depth"), torch.ones_like(nominal["doubt"])
        hardness, wear = _spread(nominal, "hardness"), torch.exp(nominal["log_wear_factor_spread"])
        return torch.stack([depth, one, hardness, one, wear, one], dim=-1)

    def _errors(self, estimate: Estimate) -> Tensor:
        """Return the expected errors of the laws, see ``train/law_errors.py``; shape (num_envs, ERRORS)."""
        return estimate.nominal["doubt"].unsqueeze(-1) * (self._error_mean + estimate.mean[:, LAWS:] @ self._error_factor.T)

    def _wear_factor(self, estimate: Estimate, pace: Sequence[Tensor]) -> Linear:
        """Return the log ratio of wear to the nominal model.

        ``pace``: the edge's mean logarithms of speed and feed over the plan's at half a life.
        """
        nominal, scales = estimate.nominal, estimate.scales
        speed, feed = (each + offset for each, offset in zip(pace, self._over_pivot(nominal), strict=True))
        time, by_speed = nominal["wear_time_exponent"], nominal["wear_cutting_speed_exponent"]
        by_error = torch.stack([time, by_speed * speed, time * feed], dim=-1)
        own = slice(by_error.shape[-1])
        zero, insert = torch.zeros_like(speed), scales[:, INSERT]
        by_state = torch.stack([zero] * INSERT + [insert, torch.ones_like(zero)], dim=-1)
        of_errors = by_error @ self._error_factor[own]
        row = torch.cat([by_state, nominal["doubt"].unsqueeze(-1) * of_errors], dim=-1)
        return Linear(row, nominal["doubt"] * (by_error @ self._error_mean[own]))

    def _over_pivot(self, nominal: Nominal) -> list[Tensor]:
        """Return the logarithms of the plan's speed and feed at half a life over those from which errors count."""
        return [middle - pivot for middle, pivot in zip(_middle(nominal), self._pivot, strict=True)]

    def _set_point(self, observation: Tensor, entries: Sequence[int], nominal: Nominal) -> list[Tensor]:
        """Return logarithms of speed and feed over the plan's at half a life."""
        best = _middle(nominal)
        return [0.5 * (observation[:, entries[k]] + 1.0) * self._spans[k] - best[k] for k in range(2)]

    def _travel(self, nominal: Nominal, last: Sequence[Tensor], commanded: Sequence[Tensor]) -> Tensor:
        """Return the distance since the last observation."""
        decays = [self._sub_step * torch.exp(-nominal[f"log_{drive}_time_constant"]) for drive in ("spindle", "feed")]
        decays.append(decays[0] + decays[1])
        numbers = range(1, self._sub_steps + 1)
        slow, late, both = (torch.stack([torch.exp(-k * decay) for k in numbers]).mean(dim=0) for decay in decays)
        (speed, feed), (over_speed, over_feed) = (
            [torch.exp(each) for each in commanded],
            [torch.exp(was) - torch.exp(now) for was, now in zip(last, commanded, strict=True)],
        )
        mean = speed * feed + over_speed * feed * slow + speed * over_feed * late + over_speed * over_feed * both
        return self._interval * mean * torch.exp(-nominal["log_bar_time"])

    def _approach_share(self, nominal: Nominal) -> Tensor:
        """Return the length of the approach over the bar's, which follows from the sustained removal rate."""
        edge = torch.exp(nominal["log_edge_change_time"]) + torch.exp(nominal["log_edge_price"])
        cutting = 1.0 + edge * torch.exp(-nominal["log_life"])
        log_rate = nominal["log_removal_rate"] - nominal["log_depth_of_cut"] - nominal["log_diameter"]
        bar = torch.exp(log_rate + nominal["log_bar_time"]) * cutting * single(1000.0 / (60.0 * math.pi))
        return self._approach / bar

    def _moved(self, estimate: Estimate, cut: Tensor) -> Estimate:
        """Return the estimate after a distance in metal, in which depth, hardness and their slopes change.

        The fields are stationary: with a transition T, the covariance P becomes T P T' + I - T T', so P - I becomes T (P - I) T'.
        """
        changes = []
        for rate in self._rates(estimate):
            step = cut * rate
            stays = torch.exp(-step)
            changes += [(1.0 + step) * stays - 1.0, step * stays, -step * stays, (1.0 - step) * stays - 1.0]
        change = (torch.stack(changes, dim=-1) @ self._fields).reshape(-1, STATES, STATES)
        transition = self._one + change
        mean = (transition @ estimate.mean.unsqueeze(-1)).squeeze(-1)
        return estimate._replace(mean=mean, excess=transition @ estimate.excess @ transition.transpose(-1, -2))

    def _worn(self, estimate: Estimate, fresh_share: Tensor) -> Estimate:
        """Return the estimate after cutting: the present depth and hardness enter the means over the edge's life."""
        zero, scales = torch.zeros_like(fresh_share), estimate.scales
        by_state = [zero] * STATES
        by_state[DEPTH] = estimate.nominal["wear_depth_of_cut_exponent"] * scales[:, DEPTH]
        by_state[HARDNESS] = self._hardness[2] * scales[:, HARDNESS]
        by_state[HISTORY] = -torch.ones_like(zero)
        change = fresh_share.unsqueeze(-1) * torch.stack(by_state, dim=-1)
        grown = estimate.covariances(change)
        cross = self._history.unsqueeze(-1) * grown.unsqueeze(-2)
        variance = (change * grown).sum(dim=-1)[:, None, None] * self._history.diag()
        mean = estimate.mean + (change * estimate.mean).sum(dim=-1, keepdim=True) * self._history
        return estimate._replace(mean=mean, excess=estimate.excess + cross + cross.transpose(-1, -2) + variance)

    def _rates(self, estimate: Estimate) -> list[Tensor]:
        """Return the rates of depth and hardness along the bar [1/bar]."""
        nominal, scales, rates = estimate.nominal, estimate.scales, []
        for name, k in (("depth", DEPTH), ("hardness", HARDNESS)):
            share = single(SLOPE) * torch.exp(nominal[f"log_{name}_along_spread"]) / scales[:, k]
            rates.append(share * torch.exp(nominal["log_bar_time"] - nominal[f"log_{name}_correlation_time"]))
        return rates

    def _load(self, law: int, estimate: Estimate, place: Place) -> tuple[Tensor, Tensor]:
        """Return the derivatives by the states of the log ratio of a law's load to the nominal model, and that ratio."""
        nominal, scales, mean = estimate.nominal, estimate.scales, estimate.mean
        factor = place.wear_factor.at(mean)
        speed, feed = (each + offset for each, offset in zip(place[:2], self._over_pivot(nominal), strict=True))
        by_error = torch.stack([torch.ones_like(speed), speed, feed, place.wear + factor], dim=-1)
        own = slice(LOADS[law], LOADS[law] + by_error.shape[-1])
        errors, of_hardness = self._errors(estimate)[:, own], self._hardness[law]
        of_depth = nominal[f"{_LAWS[law]}_depth_of_cut_exponent"]
        exponent = nominal[f"{_LAWS[law]}_wear_exponent"] + errors[:, -1]
        share = (1.0 + scales[:, DEPTH] * mean[:, DEPTH]).clamp(min=single(MIN_DEPTH))
        by_state = [torch.zeros_like(speed)] * LAWS
        by_state[DEPTH], by_state[HARDNESS] = of_depth / share * scales[:, DEPTH], of_hardness * scales[:, HARDNESS]
        of_errors = nominal["doubt"].unsqueeze(-1) * (by_error @ self._error_factor[own])
        row = torch.cat([torch.stack(by_state, dim=-1), of_errors], dim=-1) + exponent.unsqueeze(-1) * place.wear_factor.row
        ratio = of_depth * torch.log(share) + of_hardness * scales[:, HARDNESS] * mean[:, HARDNESS]
        return row, ratio + nominal[f"{_LAWS[law]}_wear_exponent"] * factor + (by_error * errors).sum(dim=-1)

    def _idle_share(self, nominal: Nominal, place: Place) -> Tensor:
        """Return the idle power over that of the cut by the nominal model.

        Measured and predicted power contain both, but the law of power is that of the cut.
        """
        log_cut = nominal["log_power_load"]
        for name, value in zip(("cutting_speed", "feed", "wear"), place[:3], strict=True):
            log_cut = log_cut + nominal[f"power_{name}_exponent"] * value
        return torch.exp(nominal["log_idle_power"] + place.speed - log_cut)

    def _readings(
        self, estimate: Estimate, wear: Tensor, place: Place, commanded: Sequence[Tensor], along: Tensor, slack: Tensor
    ) -> list[Tensor]:
        """Return all readings but those of the position.

        ``commanded``: commanded speed and feed as in ``Place``; ``along``, ``slack``: see ``PLACE``.
        """
        nominal, mean, excess = estimate.nominal, estimate.mean, estimate.excess
        exponent = nominal["wear_time_exponent"].clamp(min=MIN_EXPONENT)
        of_wear, log_factor = place.wear_factor.row, place.wear_factor.at(mean)
        used = torch.exp((torch.log(wear.clamp(min=single(1e-6))) + log_factor) / exponent)
        wear_deviation = (of_wear * estimate.covariances(of_wear)).sum(dim=-1).clamp(min=0.0).sqrt() / exponent

        life_rate, laws = self._estimated(estimate)
        overload_price = self._overload_price * (SEVERITY[0] + SEVERITY[1] * nominal["doubt"])
        job = JobOptimum(nominal, laws, life_rate, overload_price)
        time_price, life_price = job.prices(used)
        life = torch.exp(nominal["log_edge_price"]) + time_price * torch.exp(nominal["log_edge_change_time"])
        lost = (1.0 - used).clamp(min=0.0) * life + self._downtime
        ahead = self._ahead(estimate, place, laws, log_over_half(used), lost, commanded, along, slack)

        middle = _middle(nominal)
        slowest, fastest = -middle[0], -nominal["log_speed_over_fastest"]
        lowest = nominal["log_lowest_feed"] - middle[1] + _INSIDE
        highest = nominal["log_highest_feed"] - middle[1] - _INSIDE

        def reach(sign: float) -> Pair:
            """Return the range that the next action can command."""
            speed, feed = (now + sign * step for now, step in zip(commanded, self._steps, strict=True))
            return speed.clamp(slowest, fastest), feed.clamp(lowest, highest)

        gain = job.gain(ahead, life_price)
        best = search(gain, gain.start(), reach(-1.0), reach(1.0))

        life_price = life_price / life
        soon = used + job.life_rate(place.speed, place.feed) * single(LEAD * self._interval / 60.0)
        spent = torch.log(soon.clamp(min=_SMALL)) + WEAR_CAUTION * wear_deviation
        return [
            self._position(0, best.x + middle[0]),
            2.0 * (best.free_y + middle[1]) / self._spans[1] - 1.0,
            torch.full_like(used, -_ENDS),
            self._position(1, lowest + middle[1]),
            self._position(0, fastest + middle[0]),
            self._position(1, highest + middle[1]),
            best.slope * single(self._spans[0] / self._spans[1]),
            10.0 * torch.maximum(spent, torch.minimum(single(1e-3) - life_price, used - 0.5)),
            *mean.unbind(dim=-1),
            *(excess[:, k, k] + 1.0 for k in (DEPTH, HARDNESS, INSERT, LAWS, TAYLOR)),
            2.0 * used.clamp(max=1.5) - 1.0,
            wear_deviation,
            *(4.0 * gain.log_loads(best.x, best.y)).unbind(dim=-1),
            *(8.0 * ahead.spreads.mean(dim=-1)).unbind(dim=-1),
            2.0 * (time_price - 1.0),
            life_price - 1.0,
        ]

    def _ahead(
        self,
        estimate: Estimate,
        place: Place,
        laws: Sequence[Load],
        log_used: Tensor,
        lost: Tensor,
        commanded: Sequence[Tensor],
        along: Tensor,
        slack: Tensor,
    ) -> Ahead:
        """Return the cutting conditions in the next step and shortly after; see ``_readings``.

        ``laws``: estimated ones; ``log_used``: see ``log_over_half``; ``lost``: price of breaking the edge [min].
        """
        nominal, scales, mean, excess = estimate
        lags = [torch.exp(nominal[f"log_{drive}_time_constant"]).unsqueeze(-1) for drive in ("spindle", "feed")]
        number = torch.arange(1, POINTS + 1, dtype=along.dtype, device=along.device)
        times = (self._interval + SETTLING * lags[1]) * number / single(POINTS)
        velocity, approach = torch.exp(commanded[0] + commanded[1] - nominal["log_bar_time"]), self._approach_share(nominal)
        reached = along.unsqueeze(-1) + velocity.unsqueeze(-1) * times
        early, entry = reached + (slack + velocity * single(EARLY)).unsqueeze(-1), 1.0 + approach.unsqueeze(-1)
        enters = (reached >= 1.0) | (early >= entry)
        metal = (early >= entry) | (~enters & (early > 0.0))
        cut, stays = reached.clamp(min=0.0) - along.clamp(min=0.0).unsqueeze(-1), []
        for rate in self._rates(estimate):
            step = cut * rate.unsqueeze(-1)
            left = torch.where(enters, 0.0, torch.exp(-step))
            stays += [(1.0 + step) * left, step * left]
        of_fields = torch.stack(stays, dim=-1)  # depth, hardness and their slopes
        fields = of_fields * mean[:, None, DEPTH:INSERT]
        share = 1.0 + scales[:, DEPTH, None] * fields[..., :HARDNESS].sum(dim=-1)
        share = share.clamp(min=single(MIN_DEPTH))
        log_depth, hardness = torch.log(share), scales[:, HARDNESS, None] * fields[..., HARDNESS:].sum(dim=-1)

        loads, variances = [], []
        for law, load in enumerate(laws):
            row = self._load(law, estimate, place)[0] * (1.0 - self._bar)
            with_row = estimate.covariances(row)
            exponent = nominal[f"{_LAWS[law]}_depth_of_cut_exponent"].unsqueeze(-1)
            of_depth = exponent * scales[:, DEPTH, None] / share
            of_hardness = (self._hardness[law] * scales[:, HARDNESS, None]).expand_as(share)
            rows = of_fields * torch.stack([of_depth, of_depth, of_hardness, of_hardness], dim=-1)
            twice = rows @ excess[:, DEPTH:INSERT, DEPTH:INSERT] + 2.0 * with_row[:, None, DEPTH:INSERT]
            variance = (rows * twice).sum(dim=-1) + of_depth.square() + of_hardness.square()
            variance = variance + (row * with_row).sum(dim=-1, keepdim=True)
            variances.append(variance.clamp(min=_MIN_VARIANCE))
            here = load.log_load + load.used_life * log_used
            loads.append(here.unsqueeze(-1) + exponent * log_depth + self._hardness[law] * hardness)
        unmeasured = metal & (enters | (excess[:, DEPTH, DEPTH, None] > _MEASURED))
        growth = nominal["wear_depth_of_cut_exponent"].unsqueeze(-1) * log_depth + self._hardness[2] * hardness
        return Ahead(
            place.speed.unsqueeze(-1),
            place.feed.unsqueeze(-1),
            torch.exp(-times / lags[0]),
            torch.exp(-times / lags[1]),
            metal.to(times.dtype),
            torch.where(metal, log_depth, 0.0),
            growth / nominal["wear_time_exponent"].clamp(min=MIN_EXPONENT).unsqueeze(-1),
            torch.stack(loads, dim=1),
            torch.stack(variances, dim=1).sqrt(),
            (variances[0] + self._strength_variance).sqrt(),
            torch.where(unmeasured, lost.unsqueeze(-1) * single(60.0 / self._interval), 0.0),
        )

    def _position(self, drive: int, log_value: Tensor) -> Tensor:
        """Return the position of a speed (0) or feed (1) in its range, from -1 to 1, for logarithms over the lowest one."""
        return (2.0 * log_value / self._spans[drive] - 1.0).clamp(-_ENDS, _ENDS)

    def _estimated(self, estimate: Estimate) -> tuple[LifeRate, tuple[Load, Load]]:
        """Return the laws of wear, force and power for the expected bar, and for a usual insert."""
        nominal, errors = estimate.nominal, self._errors(estimate).unbind(dim=-1)
        over_speed, over_feed = self._over_pivot(nominal)
        time = nominal["wear_time_exponent"].clamp(min=MIN_EXPONENT)
        by_speed, by_feed = (nominal[f"wear_{name}_exponent"] / time for name in ("cutting_speed", "feed"))
        more = by_speed * errors[1], errors[2]
        log_rate = errors[0] + more[0] * over_speed + more[1] * over_feed - nominal["log_life"]
        found = []
        for name, first in zip(_LAWS, LOADS, strict=True):
            bias, speed, feed, wear = errors[first : first + 4]
            used_life = (nominal[f"{name}_wear_exponent"] + wear) * nominal["wear_time_exponent"]
            exponents = nominal[f"{name}_cutting_speed_exponent"] + speed, nominal[f"{name}_feed_exponent"] + feed
            log_load = nominal[f"log_{name}_load"] + bias + speed * over_speed + feed * over_feed
            found.append(Load(log_load, *exponents, used_life))
        return LifeRate(log_rate, by_speed + more[0], by_feed + more[1]), (found[0], found[1])


def _spread(nominal: Nominal, name: str) -> Tensor:
    """Return the standard deviation of depth over the nominal depth, or of log hardness, over all bars."""
    squares = (torch.exp(2.0 * nominal[f"log_{name}_{part}_spread"]) for part in ("bar", "along"))
    return torch.stack(list(squares)).sum(dim=0).sqrt()


def _middle(nominal: Nominal) -> list[Tensor]:
    """Return the plan's speed and feed at half a life, logarithms over the lowest ones."""
    return [nominal[name] for name in SET_POINT]


class FamilyActor(GruActor):
    """A ``GruActor`` beside a ``JobFilter``.

    The filter computes with the context as it is. The GRU sees it within the range that training jobs had: beyond, it could mean
    anything to the GRU.

    Args:
        scenario: a job of the family.
        context: see ``JobFilter``; also the least and greatest values that training jobs had, ``low`` and ``high``.
        cells: size of the memory.
        width: size of the layers around it.
    """

    tracker: JobFilter
    least: Tensor
    greatest: Tensor
    see_weight: Tensor
    see_bias: Tensor

    def __init__(self, scenario: Scenario, context: dict[str, Any], cells: int, width: int) -> None:
        tracker = JobFilter(scenario, context)
        others = len(layout(scenario))
        entries = others + len(context["names"])
        super().__init__(scenario, entries + 1, cells, width, tracker)
        torch.nn.init.zeros_(self.head.bias)
        for name, values, free in (("least", context["low"], -math.inf), ("greatest", context["high"], math.inf)):
            bounds = torch.tensor([free] * others + values + [free] * (1 + tracker.READINGS))
            self.register_buffer(name, bounds, persistent=False)
        self.register_buffer("see_weight", torch.eye(entries, entries + 1), persistent=False)
        self.register_buffer("see_bias", torch.eye(entries + 1)[entries], persistent=False)

    def forward(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Act on observations without the assumed model error, which is then that of the family."""
        return super().forward(observation @ self.see_weight + self.see_bias, memory)

    def see(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Return the GRU's input, and the memory with the filter's next state; see ``GruActor``."""
        seen, memory = super().see(observation, memory)
        return torch.minimum(torch.maximum(seen, self.least), self.greatest), memory

    def held(self, target: Tensor, seen: Tensor) -> Tensor:
        """Return unbounded targets of speed and feed, kept within the ranges of machine and chip breaker."""
        positions = _target(self._proposals(seen))
        return torch.minimum(torch.maximum(target[..., :2], positions[..., 2:4]), positions[..., 4:6])

    def _unbounded(self, cells: Tensor, seen: Tensor) -> Tensor:
        """Return the proposed targets with the network's correction; the feed is proposed for the corrected speed.

        Corrections of speed and feed are scaled by the assumed model error: proposals by a true nominal model need no correction.
        """
        correction, proposals = super()._unbounded(cells, seen), self._proposals(seen)
        speed, feed, slowest, lowest, fastest, highest, slope, change = proposals.unbind(dim=-1)
        doubt = seen[..., -self.tracker.READINGS - 1]
        first = (_target(speed) + doubt * correction[..., 0]).tanh()
        first = torch.minimum(torch.maximum(first, slowest), fastest)
        second = torch.minimum(torch.maximum(feed + slope * (first - speed), lowest), highest)
        targets = _target(first), _target(second) + doubt * correction[..., 1], change + correction[..., 2]
        return torch.stack(targets, dim=-1)

    def _proposals(self, seen: Tensor) -> Tensor:
        """Return the readings that propose targets, shape (..., 8), see ``JobFilter.forward``."""
        first = seen.shape[-1] - self.tracker.READINGS
        return seen[..., first : first + 8]


def _target(position: Tensor) -> Tensor:
    """Return the target that ``tanh`` squashes to a position."""
    return 0.5 * torch.log((1.0 + position) / (1.0 - position))
