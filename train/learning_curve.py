"""What a training has reached after how many steps and seconds: one row now and then, in a CSV in the run's folder."""

import csv
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from train.run import Run
from turning_env.files import replace_file

FILE = "learning_curve.csv"
ROWS = 200
"""About so many rows per training."""
COLUMNS = ("steps", "wall_time", "mean_return")
"""Of every row: steps trained for; seconds that took, interruptions left out; mean return [s] of the last 100 episodes that
ended, as the agent plays while it explores. An algorithm may add columns of its own."""

Row = dict[str, float]


def read(folder: Path) -> list[Row]:
    """The rows of a run's learning curve, in the order of time.

    Raises:
        ValueError: the folder holds no learning curve, or something else under its name.
    """
    path = folder / FILE
    if not path.is_file():
        raise ValueError(f"{folder} holds no {FILE}: it is no training run, or one from before curves were kept; train it anew")
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        missing = set(COLUMNS) - set(reader.fieldnames or ())
        if missing:
            raise ValueError(f"{path} lacks the column {', '.join(sorted(missing))}")
        try:
            return [{name: float(value) for name, value in row.items()} for row in reader]
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path} holds a row that is no row of numbers: {error}") from error


class LearningCurve(BaseCallback):
    """Writes the curve while a run is trained; a run that is resumed goes on with what it had at its checkpoint."""

    def __init__(self, run: Run, further: Callable[[Any], Row]) -> None:
        """``further`` gives an algorithm's own columns for its model."""
        super().__init__()
        self._run, self._further = run, further
        self._rows: list[Row] = []
        self._start = 0.0

    def _on_training_start(self) -> None:
        known = read(self._run.folder) if (self._run.folder / FILE).exists() else []
        # What lies beyond the checkpoint is trained again.
        self._rows = [row for row in known if row["steps"] <= self.num_timesteps]
        self._start = time.monotonic() - (self._rows[-1]["wall_time"] if self._rows else 0.0)
        self._write()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        if self.num_timesteps - self._last >= self._run.parameters["steps"] / ROWS:
            self._add()

    def _on_training_end(self) -> None:
        if self.num_timesteps > self._last:
            self._add()

    @property
    def _last(self) -> float:
        return self._rows[-1]["steps"] if self._rows else 0.0

    def _add(self) -> None:
        episodes = self.model.ep_info_buffer
        if not episodes:
            return
        figures = (self.num_timesteps, time.monotonic() - self._start, np.mean([episode["r"] for episode in episodes]))
        row = dict(zip(COLUMNS, map(float, figures), strict=True))
        self._rows.append(row | self._further(self.model))
        self._write()

    def _write(self) -> None:
        replace_file(self._run.folder / FILE, self._fill)

    def _fill(self, path: Path) -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, self._rows[0] if self._rows else COLUMNS)
            writer.writeheader()
            writer.writerows(self._rows)
