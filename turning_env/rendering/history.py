"""The present state and the recorded past of one environment, as frames show them."""

from collections import deque
from typing import Any, NamedTuple

from turning_env.batch.driver import Batch
from turning_env.rendering.fields import Fields, Pass
from turning_env.scenario.laws import capacity_at

STEPS = 240  # past steps that the chart of loads shows
_MIN_WEAR = 1e-4  # [mm]; maps show its logarithm, which a fresh edge's wear of 0 does not have


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
        total: return since recording began [s].
        removed: metal removed since recording began [cm3].
        reward: reward of the last step [s], 0 before the first.
        bar: number of the bar that is shown.
        along: the tool's place from where the bar's metal begins [mm], negative in air.
        depth: depth of the metal cut last [mm].
        hardness: hardness of the metal cut last [-].
        samples: the last steps.
        passes: with parts, the passes of the last.
        ended: cause of the episode's end, or an empty text.
    """

    def __init__(self, batch: Batch, index: int) -> None:
        self._batch = batch
        self._index = index
        self._is_recording = False

    def begin(self) -> None:
        """Start to record the present episode, unless it is being recorded."""
        if self._is_recording:
            return
        self._is_recording = True
        if self._batch.jobs:
            self.scenario = self._batch.job(self._index).scenario
        else:
            self.scenario = self._batch.scenario
        workpiece = self.scenario.workpiece
        self.fields = Fields(self.scenario)
        self._parts = self.scenario.control.action == "part"
        self.key = self._episode_key()
        steps = self._state("step_count")
        self.whole = steps == 0
        self.total = 0.0
        self.removed = 0.0
        self.bar = 0
        self.depth = workpiece.depth_of_cut
        self.hardness = 1.0
        self.samples: deque[Sample] = deque(maxlen=workpiece.bars if self._parts else STEPS)
        self.passes: list[Pass] = []
        self._record(steps)

    def goes_on(self) -> bool:
        """Record the last step, if there was one; return whether the recorded episode goes on."""
        steps = self._state("step_count")
        self._is_recording = steps >= self._steps and self._episode_key() == self.key
        if self._is_recording and steps > self._steps:
            self._record(steps)
            self.total += self.reward
            self.removed += self.now["removed"]
        return self._is_recording

    def _record(self, steps: int) -> None:
        """Record the present state, which is that after a number of steps."""
        self._steps = steps
        self.now: dict[str, float] = self._batch.info(self._index)
        self.reward = float(self._batch.rewards[self._index]) if steps else 0.0
        self.time = 60.0 * float(self._state("clock"))
        self.edge = int(self._state("edge"))
        self.nominal_used_life = float(self._state("nominal_used_life"))
        self.ended = self._cause_of_end() if self._state("ended") else ""
        self._find_place()
        if not self._parts:
            self.samples.append(self._step_sample(steps))
        elif steps:
            self.passes = self.fields.passes(self._batch.actions[self._index])
            self.samples.append(self._part_sample())

    def _step_sample(self, steps: int) -> Sample:
        """Return the present state as a sample, after a number of steps; note the metal cut."""
        now = self.now
        limits = self.scenario.limits
        speed = now["cutting_speed"]
        cutting = steps > 0 and now["cutting"] > 0.0 and now["depth_of_cut"] > 0.0
        if cutting:
            self.depth = now["depth_of_cut"]
            self.hardness = now["hardness"]
        # At low speeds the spindle has only a share of its power.
        power_limit = limits.power * capacity_at(self.scenario, speed)
        return Sample(
            cutting_speed=speed,
            feed=now["feed"],
            force=now["thrust_force"] / limits.thrust_force,
            power=now["power"] / power_limit,
            cutting=cutting,
            roughness=now["roughness"],
            reference=now["roughness_reference"],
        )

    def _part_sample(self) -> Sample:
        """Return the last part as a sample."""
        now = self.now
        limits = self.scenario.limits
        return Sample(
            cutting_speed=now["cutting_speed"],
            feed=now["feed"],
            force=now["mean_thrust_force"] / limits.thrust_force,
            power=now["mean_power"] / limits.power,
            cutting=True,
        )

    def _episode_key(self) -> tuple[int, int]:
        """Return the seed and the number of the present episode."""
        return self._state("seed"), self._state("episode")

    def _state(self, field: str) -> Any:
        return self._batch.state(self._index, field)

    def _find_place(self) -> None:
        workpiece = self.scenario.workpiece
        self.bar = int(self.now["bar"])
        # A part that has been turned is shown until the next is.
        if self._parts and self.now["passes"] > 0.0:
            self.bar -= 1
        if workpiece.bars:
            self.bar = min(self.bar, workpiece.bars - 1)
        pitch = workpiece.bar_length + workpiece.approach
        along = self.now["path"] - self.bar * pitch - workpiece.approach
        self.along = min(along, workpiece.bar_length)

    def _cause_of_end(self) -> str:
        now = self.now
        criterion = self.scenario.tool.wear_criterion
        if now["broken"] > 0.0 and self.scenario.control.edge_changes == "end":
            return "edge broken"
        if now["finished"] > 0.0:
            return "job finished"
        if now["wear"] >= criterion * (1.0 - 1e-9):
            return "edge worn out"
        return "time is up"

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
