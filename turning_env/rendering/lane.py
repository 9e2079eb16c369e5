"""What is seen of one lathe: how it stands, and what of its past is drawn."""

import math
from collections import deque
from typing import TYPE_CHECKING, Any

from turning_env.rendering.fields import Fields, Key
from turning_env.scenario import Scenario

if TYPE_CHECKING:
    from turning_env.batch.driver import Batch

TRAIL = 90
"""Intervals of which the operating map shows where they were."""
_MIN_WEAR = 1e-4  # [mm]: an edge that has not cut has none, of which there is no logarithm


class Lane:
    """One lathe as an onlooker sees it.

    Attributes:
        now: the last interval's report, by the names of ``quantities.INFO``.
        time, total, removed, edges, broken: since the episode's start: machine time [s], return [s], metal [cm3], edges used up
            and broken [-].
        reward: of the last interval [s].
        bar, along: which bar is shown, and the tool's place from where its metal begins [mm], negative in air.
        depth, hardness: of the metal cut last [mm], [-].
        trail: (cutting speed [m/min], feed [mm/rev]) of the last intervals.
        course: (place [mm], force over limit, power over limit, Ra [um], its reference [um], feed [mm/rev], metal is cut) of
            every interval along the present bar; with parts, of every part, at its number.
        course_number: counts the courses.
        passes: with parts, (cutting speed, feed, depth [mm]) of each pass of the last.
        ended: what has ended the episode, or nothing.
    """

    def __init__(self, scenario: Scenario, lathes: "Batch", lane: int, fields: Fields) -> None:
        self._scenario, self._lathes, self._lane, self.fields = scenario, lathes, lane, fields
        self._parts = scenario.control.action == "part"
        self.trail: deque[tuple[float, float]] = deque(maxlen=TRAIL)
        self.course: list[tuple[float, ...]] = []
        self.course_number = 0
        self.passes: list[tuple[float, float, float]] = []
        self.started = False

    def note(self) -> None:
        """Take down what the last interval gave, or that an episode has begun."""
        self.now: dict[str, float] = self._lathes.info(self._lane)
        begins = int(self._state("step_count")) == 0
        if begins or not self.started:
            self._start(Key(int(self._state("seed")), int(self._state("episode"))))
        self.edge = int(self._state("edge"))
        self.nominal_used_life = float(self._state("nominal_used_life"))
        self._find_place()
        if not begins:
            self._add(self._lathes.reward(self._lane))
            if self._parts:
                self.passes = self.fields.passes(self._lathes.action(self._lane))
        self.ended = self._end(bool(self._state("ended")))
        self._extend_course(begins)

    def _state(self, field: str) -> Any:
        return self._lathes.state(self._lane, field)

    def _start(self, key: Key) -> None:
        self.key = key
        self.started = True
        self.reward = self.time = self.total = self.removed = self.edges = self.broken = 0.0
        self.bar, self.along = 0, -self._scenario.workpiece.approach
        self.depth, self.hardness = self._scenario.workpiece.depth_of_cut, 1.0
        self.trail.clear()
        self.passes = []
        self._forget_course()

    def _forget_course(self) -> None:
        self.course = []
        self.course_number += 1

    def _find_place(self) -> None:
        workpiece, now = self._scenario.workpiece, self.now
        pitch = workpiece.bar_length + workpiece.approach
        bar = int(now["bar"])
        if self._parts and now["passes"] > 0.0:  # the tool stands before the next part; the one that it turned is shown
            bar -= 1
        if workpiece.bars:
            bar = min(bar, workpiece.bars - 1)
        if bar != self.bar and not self._parts:
            self._forget_course()
        self.bar = bar
        self.along = min(now["path"] - bar * pitch - workpiece.approach, workpiece.bar_length)

    def _add(self, reward: float) -> None:
        now = self.now
        self.time += now["time"]
        self.total += reward
        self.reward = reward
        self.removed += now["removed"]
        self.edges += now["edges_used"]
        self.broken += now["edges_broken"]

    def _extend_course(self, begins: bool) -> None:
        now, limits = self.now, self._scenario.limits
        if self._parts:
            if not begins:
                self.trail.extend(each[:2] for each in self.passes)
                shares = (now["mean_thrust_force"] / limits.thrust_force, now["mean_power"] / limits.power)
                self.course.append((self.bar + 1.0, *shares, 0.0, 0.0, now["feed"], 1.0))
            return
        cutting = now["cutting"] > 0.0 and now["depth_of_cut"] > 0.0
        if cutting:
            self.depth, self.hardness = now["depth_of_cut"], now["hardness"]
        self.trail.append((now["cutting_speed"], now["feed"]))
        shares = (now["thrust_force"] / limits.thrust_force, now["power"] / limits.power)
        surface = (now["roughness"], now["roughness_reference"])
        self.course.append((self.along, *shares, *surface, now["feed"], float(cutting)))

    def _end(self, ended: bool) -> str:
        if not ended:
            return ""
        now = self.now
        if now["broken"] > 0.0 and self._scenario.control.edge_changes == "end":
            return "edge broken"
        if now["finished"] > 0.0:
            return "job finished"
        if now["wear"] >= self._scenario.tool.wear_criterion * (1.0 - 1e-9):
            return "edge worn out"
        return "time is up"

    @property
    def state(self) -> str:
        """What is going on, in words."""
        now = self.now
        if self.ended:
            return self.ended
        if now["broken"] > 0.0:
            return "edge broken"
        if now["stopped_time"] > 0.0:
            return "edge changed"
        if self._parts:
            return "part turned" if now["passes"] > 0.0 else "before the first part"
        return "cutting" if now["cutting"] > 0.0 else "in air"

    @property
    def wear(self) -> float:
        """Flank wear of the edge [mm], above 0."""
        return max(self.now["wear"], _MIN_WEAR)

    @property
    def nominal_wear(self) -> float:
        """The same as the nominal model has it."""
        tool, exponent = self._scenario.tool, self._scenario.material.wear.time
        return max(tool.wear_criterion * math.pow(self.nominal_used_life, exponent), _MIN_WEAR)
