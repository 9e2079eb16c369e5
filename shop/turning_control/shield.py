"""The shield: a layer that overrides a policy before a limit of the machine is exceeded.

It knows the observations and the nominal model, as the policy does, and works in three stages:

1. **Answers.** The safe feed, a share of the programmed one, replaces an answer that is late,
   raises an error, is not finite or has the wrong shape.
2. **Limits.** Cutting speed and feed are limited so that the expected loads keep their limits
   between the actual and the commanded speed, at the next step of depth, and at the start of the
   next bar. If a nearby speed allows the requested removal rate, the shield takes it. A reading
   that proves an overload by itself lowers the feed at once.
3. **Takeover.** The operator takes over after several refused answers in a row, or if no speed
   and feed keeps the limits now or in the next bar.

The expected loads and the feeds that they allow come from ``observer.py``.
"""

import logging
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from turning_control.observer import Observer, Values

from turning_env.action import commanded, towards
from turning_env.observation import Reading, read
from turning_env.physics.drives import lag_share
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario import Scenario

LOG = logging.getLogger("turning_control")

# Time without any cutting speed that keeps both limits, after which the operator takes over [s].
HOPELESS = 2.0
# Smallest share of a change of feed that the drive completes in a step [-]. Its inverse is the
# highest gain with which the shield leads a slow drive.
MIN_SHARE = 0.2
PATIENCE = 10  # refused answers in a row after which the operator takes over
REFUSALS = ("late", "error", "shape", "not finite")  # reasons for which an answer is refused
# Relative changes of speed or feed up to this are rounding: the policy's own action passes.
ROUNDING = 1e-6


@dataclass(frozen=True)
class ShieldSettings:
    """Settings of the shield that an operator may choose."""

    safe_share: float = 0.5  # safe over programmed feed [-]
    target: float = 1.02  # expected load over its limit that the shield allows [-]
    rise: float = 20.0  # largest rise of the commanded feed over its range [1/s]
    # Time in which a policy must answer [s]; None: not measured, as in simulations.
    deadline: float | None = None


DEFAULT_SETTINGS = ShieldSettings()


class Shield(Policy):
    """A policy behind a shield; it is a policy itself.

        shielded = Shield(policy, scenario, num_envs)

    It uses the nominal model of the scenario that the policy plays. ValueError if the scenario's
    actions command whole parts.

    Attributes:
        takeover: whether the operator has taken over, shape (num_envs,). The safe feed then
            holds until ``reset``.
        reasons: the last decision's reason in each environment: ``passed``, ``power``, ``force``,
            ``rise``, one of ``REFUSALS`` or ``takeover``.
        place: tool position along the bar [mm], below 0 before it, shape (num_envs,); set it before
            ``act`` if it is known. None: the shield integrates the feed.
    """

    place: Values | None = None

    def __init__(
        self,
        policy: Policy,
        scenario: Scenario,
        num_envs: int,
        settings: ShieldSettings = DEFAULT_SETTINGS,
    ) -> None:
        if scenario.control.action == "part":
            raise ValueError(
                f"scenario {scenario.name!r} commands whole parts, "
                "but the shield guards an action per interval"
            )
        self._policy = policy
        self._scenario = scenario.nominal()
        self._settings = settings
        self.takeover = np.zeros(num_envs, np.bool_)
        self.reasons = ["passed"] * num_envs
        self._refused = np.zeros(num_envs, np.int64)  # answers in a row
        self._hopeless = np.zeros(num_envs, np.int64)  # steps in a row
        self._observer = Observer(self._scenario, num_envs)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._policy.reset(mask)
        self.takeover &= ~mask
        self._refused[mask] = 0
        self._hopeless[mask] = 0
        self._observer.reset(mask)

    def miss(self) -> None:
        """Count a step that the shield has not seen, so that its bar is unknown.

        What it knew of the bar's hardness and depth may be far behind the tool.
        """
        self._observer.miss()

    def act(self, observations: Observations) -> Actions:
        reading = read(observations, self._scenario)
        actions, refusals = self._answers(observations)
        refused = refusals != ""
        self._refused = np.where(refused, self._refused + 1, 0)
        self._take_over(self._refused >= PATIENCE, "no valid answers")

        safe = refused | self.takeover
        actions[safe] = self._safe_actions(reading)[safe]
        # The limits hold for the safe feed, too: it may be too high for a hard bar.
        actions, limited_by = self._limited(actions, reading)

        # The first reason that applies is the one that counts.
        self.reasons = np.select(
            [refused, self.takeover, limited_by != ""],
            [refusals, "takeover", limited_by],
            default="passed",
        ).tolist()
        return actions

    def _answers(self, observations: Observations) -> tuple[Actions, NDArray[np.str_]]:
        """Return the policy's actions, and the reasons why they are refused or "".

        Refused actions are 0. The reasons have shape (num_envs,).
        """
        shape = (len(observations), action_size(self._scenario))
        start = time.perf_counter()
        try:
            answer = np.asarray(self._policy.act(observations))
        except Exception as error:  # a policy may fail in any way
            problem = f"it failed: {type(error).__name__}: {error}"
            return _refused(shape, "error", problem=problem)
        seconds = time.perf_counter() - start

        deadline = self._settings.deadline
        if deadline is not None and seconds > deadline:
            milliseconds = 1000.0 * seconds
            problem = f"it answered after {milliseconds:.0f} ms"
            return _refused(shape, "late", problem=problem)
        is_number = answer.dtype.kind in "fiu"
        if answer.shape != shape or not is_number:
            problem = f"its answer has type {answer.dtype} and shape {answer.shape}, not {shape}"
            return _refused(shape, "shape", problem=problem)

        # One environment's bad numbers leave the answers for the others valid.
        finite = np.asarray(np.isfinite(answer).all(axis=1))
        actions = np.where(finite[:, None], answer, 0.0)
        actions = np.clip(actions, -1.0, 1.0).astype(np.float32)
        reasons = np.where(finite, "", "not finite")
        return actions, reasons

    def _take_over(self, where: NDArray[np.bool_], reason: str) -> None:
        for env_index in np.flatnonzero(where & ~self.takeover):
            LOG.warning("environment %d: the operator takes over: %s", env_index, reason)
        self.takeover |= where

    def _safe_actions(self, reading: Reading) -> Actions:
        """Return the actions that command the safe feed at the programmed speed."""
        control = self._scenario.control
        safe_feed = max(
            self._settings.safe_share * control.initial_feed, self._scenario.machine.feed_min
        )
        num_envs = len(reading.feed)
        speed = np.full(num_envs, control.initial_cutting_speed)
        feed = np.full(num_envs, safe_feed)
        return towards(reading, self._scenario, cutting_speed=speed, feed=feed)

    def _limited(self, actions: Actions, reading: Reading) -> tuple[Actions, NDArray[np.str_]]:
        """Return actions that keep the limits, and the limits that changed them or "".

        The limits have shape (num_envs,).
        """
        control = self._scenario.control
        machine = self._scenario.machine
        observer = self._observer
        present_speed = reading.commanded_cutting_speed
        present_feed = reading.commanded_feed
        observer.follow(reading, self.place)
        asked_speed, asked_feed = commanded(
            actions,
            present_speed,
            feed=present_feed,
            scenario=self._scenario,
        )
        observer.expect(self._settings.target, asked_speed, asked_feed=asked_feed)

        free = control.action != "override"
        entry_speed, blocked = observer.entry_speed(asked_speed, present_speed, free=free)
        speed, hopeless = observer.speed(entry_speed, asked_feed, free=free)
        proven_feed, power_is_over = observer.proven_feed(reading)
        not_faster = np.minimum(speed, present_speed)
        speed = np.where(power_is_over, not_faster, speed)
        change_edge = self._find_help(actions, hopeless, blocked=blocked)

        # The spindle passes all speeds between the actual and the commanded one.
        feeds_now = observer.feeds(reading.cutting_speed)
        feeds_soon = observer.feeds(speed)
        by_power = np.minimum(feeds_soon.power, feeds_now.power)
        by_force = np.minimum(feeds_soon.force, feeds_now.force)
        bound = self._lead_of_drive(np.minimum(by_power, by_force), reading.feed)
        is_proven = np.isfinite(proven_feed)
        proven_bound = np.minimum(proven_feed, present_feed)
        bound = np.minimum(bound, np.where(is_proven, proven_bound, np.inf))
        feed_range = machine.feed_max - machine.feed_min
        rise = present_feed + self._settings.rise * control.interval * feed_range
        same_removal = asked_feed * asked_speed / speed  # the asked removal rate, not more
        feed = np.minimum(same_removal, np.minimum(bound, rise))
        feed = np.clip(feed, machine.feed_min, machine.feed_max)

        less_feed = feed < asked_feed * (1 - ROUNDING)
        other_speed = np.abs(speed / asked_speed - 1.0) > ROUNDING
        changed = less_feed | other_speed
        limited = towards(
            reading,
            self._scenario,
            cutting_speed=speed,
            feed=feed,
            change_edge=change_edge,
        )
        if change_edge is not None:
            policy_keeps_edge = actions[:, -1] <= 0.0
            changed |= change_edge & policy_keeps_edge
        limit = np.where(by_power < by_force, "power", "force")
        limit = np.where(rise < bound, "rise", limit)
        kept_within = np.where(changed[:, None], limited, actions)
        limits = np.where(changed, limit, "")
        return kept_within, limits

    def _find_help(
        self, actions: Actions, hopeless: NDArray[np.bool_], blocked: NDArray[np.bool_]
    ) -> NDArray[np.bool_] | None:
        """Return which edges to change; the operator takes over where no edge can help.

        Args:
            actions: the policy's actions, shape (num_envs, size).
            hopeless: whether no speed and feed keep the limits now, shape (num_envs,).
            blocked: likewise for the next cut, which is about to begin.

        Returns:
            Shape (num_envs,), or None if actions command no edge changes.
        """
        self._hopeless = np.where(hopeless, self._hopeless + 1, 0)
        hopeless_time = self._hopeless * self._scenario.control.interval
        stuck = hopeless_time >= HOPELESS
        change_edge = None
        if self._scenario.control.edge_changes == "commanded":
            # A fresh edge may help: the operator takes over only if it has not.
            change_edge = (actions[:, -1] > 0.0) | stuck | blocked
            stuck &= hopeless_time >= 2.0 * HOPELESS
            blocked = np.zeros_like(blocked)
        self._take_over(stuck, "no speed and feed keep the limits")
        self._take_over(blocked, "no speed and feed would keep the limits in the next cut")
        return change_edge

    def _lead_of_drive(self, bound: Values, feed: Values) -> Values:
        """Return the feed to command so that the actual feed falls to its bound soon [mm/rev].

        If the drive is slow, a command below the bound brings the feed down sooner. Too low a
        command would make a loop with delays swing.
        """
        machine = self._scenario.machine
        reaction = self._scenario.control.interval + machine.command_delay
        covered = lag_share(reaction, machine.feed_time_constant)
        share = max(covered, MIN_SHARE)
        below_bound = feed + (bound - feed) / share
        return np.where(feed > bound, below_bound, bound)


def _refused(shape: tuple[int, int], reason: str, problem: str) -> tuple[Actions, NDArray[np.str_]]:
    """Return actions of 0 and the reason in every environment, and log the problem."""
    LOG.warning("the policy is refused: %s", problem)
    return np.zeros(shape, np.float32), np.full(shape[0], reason)
