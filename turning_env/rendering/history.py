"""The present state and the recorded past of one environment, as frames show them."""

from collections import deque
from typing import Any, NamedTuple

from turning_env.batch.driver import REWARD, Batch
from turning_env.physics.spindle import capacity_at
from turning_env.rendering.fields import Fields

STEPS = 240  # number of past steps that the chart of loads shows
_MIN_WEAR = 1e-4  # [mm]: the logarithm of a fresh edge's wear, 0, does not exist


class Sample(NamedTuple):
    """One step; with parts, one part, with speed and feed of its last pass."""

    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]
    force: float  # over its limit [-]
    power: float  # over its limit [-]
    cutting: bool
    roughness: float = 0.0  # Ra [um]
    reference: float = 0.0  # [um]


class History:
    """A recorder of one environment from an episode's first frame to its end.

    Attributes:
        scenario: the scenario that the environment plays: of a family, its job's.
        whole: whether recording began at the episode's start.
        key: (seed, episode), which determine the bars.
        now: the last step's report, by the names of ``quantities.INFO``.
        time: machine time since the episode's start [s].
        total, removed: since recording began: return [s], metal [cm3].
        reward: reward of the last step [s], 0 before the first.
        bar, along: number of the bar that is shown, and the tool's place from where its metal begins [mm], negative in air.
        depth, hardness: of the metal cut last [mm], [-].
        samples: the last steps.
        passes: with parts, (cutting speed, feed, depth [mm]) of each pass of the last.
        ended: cause of the episode's end, or an empty text.
    """

    def __init__(self, batch: Batch, index: int) -> None:
        self._batch, self._index = batch, index
        self._watched = False

    def begin(self) -> None:
        """Start to record the present episode, unless it is being recorded."""
        if self._watched:
            return
        self._watched = True
        self.scenario = (
            self._batch.job(self._index).scenario if self._batch.jobs else self._batch.scenario
        )
        self.fields = Fields(self.scenario)
        self._parts = self.scenario.control.action == "part"
        self.key, steps = self._moment()
        self.whole = steps == 0
        self.total = self.removed = 0.0
        self.bar, self.depth, self.hardness = 0, self.scenario.workpiece.depth_of_cut, 1.0
        self.samples: deque[Sample] = deque(
            maxlen=self.scenario.workpiece.bars if self._parts else STEPS
        )
        self.passes: list[tuple[float, float, float]] = []
        self._note(steps)

    def goes_on(self) -> bool:
        """Record the last step, if there was one; return whether the recorded episode goes on."""
        key, steps = self._moment()
        self._watched = steps >= self._steps and key == self.key
        if self._watched and steps > self._steps:
            self._note(steps)
            self.total += self.reward
            self.removed += self.now["removed"]
        return self._watched

    def _note(self, steps: int) -> None:
        self._steps = steps
        self.now: dict[str, float] = self._batch.info(self._index)
        self.reward = float(self._batch.table[REWARD, self._index]) if steps else 0.0
        self.time = 60.0 * float(self._state("clock"))
        self.edge = int(self._state("edge"))
        self.nominal_used_life = float(self._state("nominal_used_life"))
        self.ended = self._end() if self._state("ended") else ""
        self._find_place()
        now, limits = self.now, self.scenario.limits
        speed, feed = now["cutting_speed"], now["feed"]
        if not self._parts:
            cutting = steps > 0 and now["cutting"] > 0.0 and now["depth_of_cut"] > 0.0
            if cutting:
                self.depth, self.hardness = now["depth_of_cut"], now["hardness"]
            power = now["power"] / (limits.power * capacity_at(self.scenario, speed))
            loads = now["thrust_force"] / limits.thrust_force, power
            self.samples.append(
                Sample(speed, feed, *loads, cutting, now["roughness"], now["roughness_reference"])
            )
        elif steps:
            self.passes = self.fields.passes(self._batch.actions[self._index])
            loads = now["mean_thrust_force"] / limits.thrust_force, now["mean_power"] / limits.power
            self.samples.append(Sample(speed, feed, *loads, True))

    def _moment(self) -> tuple[tuple[int, int], int]:
        """Return (seed, episode), and the number of steps in it."""
        return (self._state("seed"), self._state("episode")), self._state("step_count")

    def _state(self, field: str) -> Any:
        return self._batch.state(self._index, field)

    def _find_place(self) -> None:
        workpiece, now = self.scenario.workpiece, self.now
        before_next = self._parts and now["passes"] > 0.0  # the last part is shown
        bar = int(now["bar"]) - before_next
        self.bar = min(bar, workpiece.bars - 1) if workpiece.bars else bar
        pitch = workpiece.bar_length + workpiece.approach
        self.along = min(now["path"] - self.bar * pitch - workpiece.approach, workpiece.bar_length)

    def _end(self) -> str:
        now = self.now
        if now["broken"] > 0.0 and self.scenario.control.edge_changes == "end":
            return "edge broken"
        if now["finished"] > 0.0:
            return "job finished"
        return (
            "edge worn out"
            if now["wear"] >= self.scenario.tool.wear_criterion * (1.0 - 1e-9)
            else "time is up"
        )

    @property
    def state(self) -> str:
        """The present state in words."""
        now = self.now
        if self.ended:
            return self.ended
        if now["broken"] > 0.0:
            return "edge broken"
        if now["stopped_time"] > 0.0:
            return "edge changed" if self.scenario.swarf.tangle_rate == 0.0 else "machine stopped"
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
        used_life: float = self.nominal_used_life**self.scenario.material.wear.time
        return max(self.scenario.tool.wear_criterion * used_life, _MIN_WEAR)
