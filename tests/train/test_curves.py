import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.train.small import ALGORITHMS, small_run
from train import curves, learning_curve
from train.training import train
from turning_env import Scenario


def a_run(
    runs: Path, seed: int, rows: list[dict[str, float]], algorithm: str = "ppo", scenario: Scenario | None = None, **changes: Any
) -> Path:
    """The folder of a training with this learning curve."""
    run = small_run(ALGORITHMS[algorithm], runs, *([scenario] if scenario else []), **changes)
    run = replace(run, seed=seed, folder=runs / f"{algorithm}-seed{seed}")
    run.begin()
    with (run.folder / learning_curve.FILE).open("w", newline="") as file:
        writer = csv.DictWriter(file, learning_curve.COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    return run.folder


def line(slope: float, start: float = 0.0, end: float = 100.0) -> list[dict[str, float]]:
    """A return that grows evenly with the intervals."""
    return [{"steps": x, "wall_time": x / 10.0, "mean_return": slope * x} for x in (start, end)]


def test_seeds_are_averaged_where_all_have_been(tmp_path: Path) -> None:
    folders = [a_run(tmp_path, 0, line(-1.0)), a_run(tmp_path, 1, line(-3.0, 10.0, 60.0)), a_run(tmp_path, 2, line(5.0), "sac")]
    title, found = curves.curves(folders, "steps")
    assert title == "RoughTurning-v0, scenario short"
    assert [(name, curve.seeds) for name, curve in found.items()] == [("ppo", 2), ("sac", 1)]
    curve = found["ppo"]
    assert (curve.place[0], curve.place[-1]) == (10.0, 60.0)
    np.testing.assert_allclose(curve.mean, -2.0 * curve.place)
    np.testing.assert_allclose(curve.low, -3.0 * curve.place)  # of two, both resampled alike one time in four
    np.testing.assert_allclose(curve.high, -1.0 * curve.place)
    np.testing.assert_allclose(found["sac"].low, found["sac"].high)
    _, by_time = curves.curves(folders, "wall_time")
    assert by_time["ppo"].place[-1] == 6.0


def test_the_interval_narrows_as_a_mean_over_seeds_does() -> None:
    values = np.random.default_rng(0).normal(size=(100, 3))
    low, high = curves.interval(values)
    np.testing.assert_allclose(high - low, 2 * 1.96 * values.std(axis=0) / 10.0, rtol=0.1)
    assert np.all((low < values.mean(axis=0)) & (values.mean(axis=0) < high))


def test_real_trainings_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = small_run(ALGORITHMS["ppo"], tmp_path)
    train(run, ALGORITHMS["ppo"])
    out = tmp_path / "curves.png"
    arguments = [str(run.folder), "--out", str(out), "--level", "predictive=-75", "--level", "a=b=-160.5"]
    assert curves.main(arguments) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    (tmp_path / "folder.svg").mkdir()
    assert curves.main([str(run.folder), "--out", str(tmp_path / "folder.svg")]) == 2
    assert "folder.svg: Is a directory" in capsys.readouterr().err
    assert curves.main([str(run.folder), "--out", str(tmp_path / "curves.gif")]) == 2
    assert "its suffix must be .png or .svg or .pdf" in capsys.readouterr().err


def test_what_cannot_be_compared_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = a_run(tmp_path, 0, line(1.0))
    longer = a_run(tmp_path / "longer", 1, line(1.0), steps=4096)
    elsewhere = a_run(tmp_path / "elsewhere", 1, line(1.0), scenario=Scenario.load("casting"))
    later = a_run(tmp_path / "later", 1, line(1.0, 200.0, 300.0))
    unbegun = a_run(tmp_path / "unbegun", 1, [])
    old = a_run(tmp_path / "old", 1, [])
    (old / learning_curve.FILE).unlink()
    for folders, message in (
        ([first, longer], f"{first} and {longer} are trainings with different hyperparameters"),
        ([first, elsewhere], "are trainings on different tasks"),
        ([first, first], "a training seed of ppo is given more than once"),
        ([first, later], "have nothing in common"),
        ([unbegun], f"no episode has ended yet in the training in {unbegun}"),
        ([old], f"{old} holds no learning_curve.csv"),
        ([tmp_path], "holds no training run"),
    ):
        assert curves.main([*map(str, folders), "--out", str(tmp_path / "never.png")]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "never.png").exists()


@pytest.mark.parametrize("level", ["predictive", "=3", "predictive=fast", "predictive=nan"])
def test_a_level_has_a_name_and_a_value(level: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert curves.main([str(a_run(tmp_path, 0, line(1.0))), "--level", level, "--out", str(tmp_path / "never.png")]) == 2
    assert f"--level is {level!r}, but must be NAME=VALUE" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("intervals,mean_return\n1,2\n", "lacks the column wall_time"),
        ("intervals,wall_time,mean_return\n1,2,x\n", "no row of numbers"),
        ("intervals,wall_time,mean_return\n1,2\n", "no row of numbers"),
    ],
)
def test_a_damaged_curve_is_an_error(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / learning_curve.FILE).write_text(text)
    with pytest.raises(ValueError, match=message):
        learning_curve.read(tmp_path)
