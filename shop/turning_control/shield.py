"""The shield: a layer between policy and control that overrides the policy before a limit is exceeded.

It knows observations and the nominal model, as the policy does, and works in three stages:

1. **Answers.** An answer that is late, raises an error, is not finite or has the wrong shape is replaced by the safe feed, a
   share of the programmed one.
2. **Limits.** Cutting speed and feed are limited so that the loads that an observer expects (``observer.py``) keep their limits
   between the actual and the commanded speed, at the next step of depth, and at the start of the next bar. If a nearby speed
   allows the requested removal rate, that speed is taken. A reading that proves an overload by itself lowers the feed at once.
3. **Hand-over.** After several refused answers in a row, or if no speed and feed keeps the limits now or in the next bar, the
   operator takes over.
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
from turning_env.scenario import Scenario
from turning_env.scoring.policy import Actions, Observations, Policy

LOG = logging.getLogger("turning_control")

HOPELESS = 2.0  # time without any cutting speed that keeps both limits, after which the operator takes over [s]
MIN_SHARE = 0.2  # smallest share of a change of feed that the drive completes in a step; its inverse limits the gain [-]
PATIENCE = 10  # refused answers in a row after which the operator takes over
REFUSALS = ("late", "error", "shape", "not finite")  # reasons for which an answer is refused


@dataclass(frozen=True)
class Settings:
    """Settings of the shield that an operator may choose."""

    safe_share: float = 0.5  # safe over programmed feed [-]
    target: float = 1.02  # expected load over its limit that the shield allows [-]
    rise: float = 20.0  # largest rise of the commanded feed over its range [1/s]
    deadline: float | None = (
        None  # time in which a policy must answer [s]; None: not measured, as in simulations
    )


class Shield(Policy):
    """A policy behind a shield; it is a policy itself.

        shielded = Shield(policy, scenario, num_envs)

    It uses the nominal model of the scenario that the policy plays; ValueError if its actions command whole parts.

    Attributes:
        handed_over: whether the operator has taken over, shape (num_envs,); the safe feed holds until ``reset``.
        reasons: the last decision's reason in each environment: ``passed``, ``power``, ``force``, ``rise``, one of
            ``REFUSALS`` or ``handed over``.
        place: tool position along the bar [mm], below 0 before it, shape (num_envs,); set it before ``act`` if it is known.
            None: the shield integrates the feed.
    """

    place: Values | None = None

    def __init__(
        self, policy: Policy, scenario: Scenario, num_envs: int, settings: Settings = Settings()
    ) -> None:
        if scenario.control.action == "part":
            raise ValueError(
                f"scenario {scenario.name!r} commands whole parts, but the shield guards an action per interval"
            )
        self._policy, self._scenario, self._settings = policy, scenario.nominal(), settings
        self.handed_over = np.zeros(num_envs, np.bool_)
        self.reasons = ["passed"] * num_envs
        self._refused, self._hopeless = np.zeros((2, num_envs), np.int64)
        self._observer = Observer(self._scenario, num_envs)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._policy.reset(mask)
        self.handed_over &= ~mask
        self._refused[mask] = self._hopeless[mask] = 0
        self._observer.reset(mask)

    def act(self, observations: Observations) -> Actions:
        reading = read(observations, self._scenario)
        actions, why = self._answers(observations)
        refused = why != ""
        self._refused = np.where(refused, self._refused + 1, 0)
        self._hand_over(self._refused >= PATIENCE, "no valid answers")
        safe = refused | self.handed_over
        actions[safe] = self._safe_actions(reading)[safe]
        actions, limited_by = self._limited(actions, reading)
        causes = [refused, self.handed_over, limited_by != ""]
        self.reasons = np.select(causes, [why, "handed over", limited_by], "passed").tolist()
        return actions

    def _answers(self, observations: Observations) -> tuple[Actions, NDArray[np.str_]]:
        """Return the policy's actions, 0 if they are refused, and the reasons, shape (num_envs,)."""
        shape, start = (len(observations), action_size(self._scenario)), time.perf_counter()
        try:
            answer = np.asarray(self._policy.act(observations))
        except Exception as error:  # a policy may fail in any way
            why, problem = "error", f"it failed: {type(error).__name__}: {error}"
        else:
            seconds, deadline = time.perf_counter() - start, self._settings.deadline
            if deadline is not None and seconds > deadline:
                why, problem = "late", f"it answered after {1000.0 * seconds:.0f} ms"
            elif answer.shape != shape or answer.dtype.kind not in "fiu":
                why, problem = (
                    "shape",
                    f"its answer has type {answer.dtype} and shape {answer.shape}, not {shape}",
                )
            else:
                finite = np.asarray(np.isfinite(answer).all(axis=1))
                actions = np.clip(np.where(finite[:, None], answer, 0.0), -1.0, 1.0).astype(
                    np.float32
                )
                return actions, np.where(finite, "", "not finite")
        LOG.warning("the policy is refused: %s", problem)
        return np.zeros(shape, np.float32), np.full(len(observations), why)

    def _hand_over(self, where: NDArray[np.bool_], reason: str) -> None:
        for i in np.flatnonzero(where & ~self.handed_over):
            LOG.warning("environment %d: the operator takes over: %s", i, reason)
        self.handed_over |= where

    def _safe_actions(self, reading: Reading) -> Actions:
        """Return the actions that command the safe feed at the programmed speed."""
        control, machine = self._scenario.control, self._scenario.machine
        programmed = np.full(len(reading.feed), control.initial_cutting_speed)
        feed = np.full(
            len(reading.feed),
            max(self._settings.safe_share * control.initial_feed, machine.feed_min),
        )
        return towards(reading, self._scenario, programmed, feed)

    def _limited(self, actions: Actions, reading: Reading) -> tuple[Actions, NDArray[np.str_]]:
        """Return actions that keep the limits, and the limits that changed them, shape (num_envs,)."""
        control, machine, observer = self._scenario.control, self._scenario.machine, self._observer
        observer.follow(reading, self.place)
        asked_speed, asked = commanded(
            actions, reading.commanded_cutting_speed, reading.commanded_feed, self._scenario
        )
        observer.expect(self._settings.target, asked_speed, asked)
        free = control.action != "override"
        entry_speed, blocked = observer.entry_speed(
            asked_speed, reading.commanded_cutting_speed, free
        )
        speed, hopeless = observer.speed(entry_speed, asked, free)
        proven, power_is_over = observer.proven_feed(reading)
        speed = np.where(power_is_over, np.minimum(speed, reading.commanded_cutting_speed), speed)
        self._hopeless = np.where(hopeless, self._hopeless + 1, 0)
        stuck, change_edge = self._hopeless * control.interval >= HOPELESS, None
        if control.edge_changes == "commanded":  # a fresh edge helps before the operator must
            change_edge = (actions[:, -1] > 0.0) | stuck | blocked
            stuck &= self._hopeless * control.interval >= 2.0 * HOPELESS
            blocked = np.zeros_like(blocked)
        self._hand_over(stuck, "no speed and feed keep the limits")
        self._hand_over(blocked, "no speed and feed would keep the limits in the next cut")
        by_power, by_force = np.minimum(
            observer.feeds(speed), observer.feeds(reading.cutting_speed)
        )
        bound = np.minimum(by_power, by_force)
        # If the drive is slow, a command below the bound brings the feed down sooner; too low a command would make a loop with
        # delays swing.
        share = max(
            lag_share(control.interval + machine.command_delay, machine.feed_time_constant),
            MIN_SHARE,
        )
        bound = np.where(reading.feed > bound, reading.feed + (bound - reading.feed) / share, bound)
        bound = np.minimum(
            bound, np.where(np.isfinite(proven), np.minimum(proven, reading.commanded_feed), np.inf)
        )
        rise = reading.commanded_feed + self._settings.rise * control.interval * (
            machine.feed_max - machine.feed_min
        )
        same = asked * asked_speed / speed  # the asked removal rate, not more
        feed = np.clip(
            np.minimum(same, np.minimum(bound, rise)), machine.feed_min, machine.feed_max
        )
        changed = (feed < asked * (1 - 1e-6)) | (np.abs(speed / asked_speed - 1.0) > 1e-6)
        limited = towards(reading, self._scenario, speed, feed, change_edge)
        if change_edge is not None:
            changed |= change_edge & (actions[:, -1] <= 0.0)
        by = np.where(rise < bound, "rise", np.where(by_power < by_force, "power", "force"))
        return np.where(changed[:, None], limited, actions), np.where(changed, by, "")
