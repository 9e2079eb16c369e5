"""The present state and the recorded past of one environment, as frames show them."""

import math
from collections import deque
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from turning_env.physics.spindle import capacity_at
from turning_env.scenario import Scenario
from turning_render.fields import Fields

if TYPE_CHECKING:
    from turning_env.batch.driver import Batch

TRAIL = 90
"""Number of past steps that the operating map shows."""
LONG_STEP = 10.0
"""Length of a step [s] from which on few steps lie in one bar."""
_MIN_WEAR = 1e-4  # [mm]: the logarithm of a fresh edge's wear, 0, does not exist


def along(scenario: Scenario) -> Literal["place", "time", "part"]:
    """Return the order of samples: place along a bar, machine time if steps are long, or the part's number."""
    control = scenario.control
    if control.action == "part":
        return "part"
    return "time" if control.interval >= LONG_STEP and control.action != "override" else "place"


class Sample(NamedTuple):
    """One step along a bar; with parts, one part.

    Attributes:
        place: Along the bar [mm], since the episode's start [min] or the part's number, see ``along``.
        force, power: Over their limits [-].
        feed: [mm/rev]
        cutting: Whether metal is cut.
        roughness, reference: Ra and its reference [um], 0 with parts.
    """

    place: float
    force: float
    power: float
    feed: float
    cutting: bool
    roughness: float = 0.0
    reference: float = 0.0


class History:
    """A recorder of one environment from an episode's first frame to its end.

    Attributes:
        whole: whether recording began at the episode's start.
        key: (seed, episode), which determine the bars.
        now: the last step's report, by the names of ``quantities.INFO``.
        time: machine time since the episode's start [s].
        total, removed, edges, broken: since recording began: return [s], metal [cm3], edges used up and broken [-].
        reward: reward of the last step [s], 0 before the first.
        bar, along: number of the bar that is shown, and the tool's place from where its metal begins [mm], negative in air.
        depth, hardness: of the metal cut last [mm], [-].
        trail: (cutting speed [m/min], feed [mm/rev]) of the last steps.
        along_bar: a sample of each step along the present bar, or of the episode where samples are not ordered by place.
        bars_seen: number of times that ``along_bar`` has been restarted.
        passes: with parts, (cutting speed, feed, depth [mm]) of each pass of the last.
        ended: cause of the episode's end, or an empty text.
    """

    def __init__(self, scenario: Scenario, batch: "Batch", index: int, fields: Fields) -> None:
        self._scenario, self._batch, self._index, self.fields = scenario, batch, index, fields
        self._along = along(scenario)
        self._parts = self._along == "part"
        self.trail: deque[tuple[float, float]] = deque(maxlen=TRAIL)
        self.along_bar: list[Sample] = []
        self.bars_seen = 0
        self.passes: list[tuple[float, float, float]] = []
        self._watched = False

    def begin(self) -> None:
        """Start to record the present episode, unless it is being recorded."""
        if self._watched:
            return
        self._watched = True
        self.key, steps = self._moment()
        self.whole = steps == 0
        self.total = self.removed = self.edges = self.broken = 0.0
        self.bar, self.depth, self.hardness = 0, self._scenario.workpiece.depth_of_cut, 1.0
        self.trail.clear()
        self.passes = []
        self._start_bar()
        self._note(steps)

    def goes_on(self) -> bool:
        """Record the last step, if there was one; return whether the recorded episode goes on."""
        key, steps = self._moment()
        self._watched = steps >= self._steps and key == self.key
        if self._watched and steps > self._steps:
            self._note(steps)
            self.total += self.reward
            self.removed += self.now["removed"]
            self.edges += self.now["edges_used"]
            self.broken += self.now["edges_broken"]
        return self._watched

    def _note(self, steps: int) -> None:
        self._steps = steps
        self.now: dict[str, float] = self._batch.info(self._index)
        self.reward = self._batch.reward(self._index) if steps else 0.0
        self.time = 60.0 * float(self._state("clock"))
        self.edge = int(self._state("edge"))
        self.nominal_used_life = float(self._state("nominal_used_life"))
        self.ended = self._end() if self._state("ended") else ""
        self._find_place()
        if not self._parts:
            self._note_step(cutting=steps > 0 and self.now["cutting"] > 0.0 and self.now["depth_of_cut"] > 0.0)
        elif steps:
            self._note_part()

    def _moment(self) -> tuple[tuple[int, int], int]:
        """Return (seed, episode), and the number of steps in it."""
        return (self._state("seed"), self._state("episode")), self._state("step_count")

    def _state(self, field: str) -> Any:
        return self._batch.state(self._index, field)

    def _start_bar(self) -> None:
        self.along_bar = []
        self.bars_seen += 1

    def _find_place(self) -> None:
        workpiece, now = self._scenario.workpiece, self.now
        pitch = workpiece.bar_length + workpiece.approach
        bar = int(now["bar"])
        if self._parts and now["passes"] > 0.0:  # the tool is before the next part; the last one is shown
            bar -= 1
        if workpiece.bars:
            bar = min(bar, workpiece.bars - 1)
        if bar != self.bar and self._along == "place":
            self._start_bar()
        self.bar = bar
        self.along = min(now["path"] - bar * pitch - workpiece.approach, workpiece.bar_length)

    def _note_part(self) -> None:
        now, limits = self.now, self._scenario.limits
        self.passes = self.fields.passes(self._batch.action(self._index))
        self.trail.extend(each[:2] for each in self.passes)
        shares = (now["mean_thrust_force"] / limits.thrust_force, now["mean_power"] / limits.power)
        self.along_bar.append(Sample(self.bar + 1.0, *shares, now["feed"], True))

    def _note_step(self, cutting: bool) -> None:
        now, limits = self.now, self._scenario.limits
        if cutting:
            self.depth, self.hardness = now["depth_of_cut"], now["hardness"]
        self.trail.append((now["cutting_speed"], now["feed"]))
        allowed_power = limits.power * capacity_at(self._scenario, now["cutting_speed"])
        shares = (now["thrust_force"] / limits.thrust_force, now["power"] / allowed_power)
        place = self.time / 60.0 if self._along == "time" else self.along
        self.along_bar.append(Sample(place, *shares, now["feed"], cutting, now["roughness"], now["roughness_reference"]))

    def _end(self) -> str:
        now = self.now
        if now["broken"] > 0.0 and self._scenario.control.edge_changes == "end":
            return "edge broken"
        if now["finished"] > 0.0:
            return "job finished"
        return "edge worn out" if now["wear"] >= self._scenario.tool.wear_criterion * (1.0 - 1e-9) else "time is up"

    @property
    def state(self) -> str:
        """The present state in words."""
        now = self.now
        if self.ended:
            return self.ended
        if now["broken"] > 0.0:
            return "edge broken"
        if now["stopped_time"] > 0.0:
            return "edge changed" if self._scenario.swarf.tangle_rate == 0.0 else "machine stopped"
        if self._parts:
            return "part turned" if now["passes"] > 0.0 else "before the first part"
        return "cutting" if now["cutting"] > 0.0 else "in air"

    @property
    def wear(self) -> float:
        """Flank wear of the edge [mm], above 0."""
        return max(self.now["wear"], _MIN_WEAR)

    @property
    def nominal_wear(self) -> float:
        """Flank wear by the nominal model [mm], above 0."""
        tool, exponent = self._scenario.tool, self._scenario.material.wear.time
        return max(tool.wear_criterion * math.pow(self.nominal_used_life, exponent), _MIN_WEAR)
