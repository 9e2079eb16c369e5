import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.train.small import ALGORITHMS, small_run
from train import curves
from train.run import CURVE_COLUMNS
from turning_env import Scenario


def a_run(
    runs: Path,
    seed: int,
    rows: list[dict[str, float]],
    algorithm: str = "ppo",
    preset: str = "",
    total_timesteps: int = 2048,
) -> Path:
    run = small_run(
        ALGORITHMS[algorithm],
        runs,
        *([Scenario.load(preset)] if preset else []),
        total_timesteps=total_timesteps,
    )
    run = replace(run, seed=seed, folder=runs / f"{algorithm}-seed{seed}")
    run.begin()
    with run.learning_curve.open("w", newline="") as file:
        writer = csv.DictWriter(file, CURVE_COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    return run.folder


def line(slope: float, start: float = 0.0, end: float = 100.0) -> list[dict[str, float]]:
    return [{"steps": x, "wall_time": x / 10.0, "mean_return": slope * x} for x in (start, end)]


def test_seeds_are_averaged_where_their_curves_overlap(tmp_path: Path) -> None:
    folders = [
        a_run(tmp_path, 0, line(-1.0)),
        a_run(tmp_path, 1, line(-3.0, 10.0, 60.0)),
        a_run(tmp_path, 2, line(5.0), "sac"),
    ]
    trainings = curves.read(folders)
    assert trainings.env_id == "RoughTurning-v0"
    assert trainings.scenario.name == "short"
    by_name = curves.curves(trainings.trainings)
    seeds = {name: curve.seeds for name, curve in by_name.items()}
    assert seeds == {"ppo": 2, "sac": 1}
    curve = by_name["ppo"]
    assert curve.steps[0] == 10.0
    assert curve.steps[-1] == 60.0
    np.testing.assert_allclose(curve.mean, -2.0 * curve.steps, rtol=1e-3)
    # Of two seeds, both resampled are the same one time in four, so the interval has their width.
    np.testing.assert_allclose(curve.low, -3.0 * curve.steps, rtol=1e-3)
    np.testing.assert_allclose(curve.high, -1.0 * curve.steps, rtol=1e-3)
    single = by_name["sac"]
    np.testing.assert_allclose(single.low, single.high)


def test_the_axis_of_returns_ends_near_the_curves() -> None:
    training = curves.LearningCurve(first=0.0, last=100.0, mean_return=[-4000.0, -70.0])
    figure = curves.draw(curves.curves({"ppo-seed0": training}), levels={})
    low, high = figure.axes[0].get_ylim()
    assert -8000.0 < low < -4000.0
    assert -70.0 < high < 0.0


@pytest.mark.slow
def test_a_file_of_curves_draws_the_same_picture_and_takes_further_trainings(
    tmp_path: Path,
) -> None:
    file = tmp_path / curves.FILE
    pictures = [tmp_path / "runs.svg", tmp_path / "file.svg"]
    folders = [str(a_run(tmp_path, seed, line(-1.0 - seed / 3.0))) for seed in (0, 1)]
    assert curves.main([*folders, "--out", str(file)]) == 0
    for sources, picture in zip((folders, [str(file)]), pictures, strict=True):
        assert (
            curves.main(
                [
                    *sources,
                    "--out",
                    str(picture),
                    "--level",
                    "predictive=-75",
                    "--level",
                    "a=b=-160.5",
                ]
            )
            == 0
        )
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    another_algorithm = a_run(tmp_path, 0, line(5.0), "sac")
    another_seed = a_run(tmp_path / "new", 1, line(7.0))
    for run in (another_algorithm, another_seed):
        assert curves.main([str(file), str(run), "--out", str(file)]) == 0
    trainings = curves.Trainings.read(file).trainings
    last_returns = {name: training.mean_return[-1] for name, training in trainings.items()}
    assert last_returns == {"ppo-seed0": -100.0, "ppo-seed1": 700.0, "sac-seed0": 500.0}
    assert list(last_returns) == sorted(last_returns)
    assert sum("-seed" in row for row in file.read_text("utf-8").splitlines()) == 3


def test_mistakes_are_named_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = a_run(tmp_path, 0, line(1.0))
    longer = a_run(
        tmp_path / "longer",
        1,
        line(1.0),
        total_timesteps=4096,
    )
    elsewhere = a_run(
        tmp_path / "elsewhere",
        1,
        line(1.0),
        preset="casting",
    )
    later = a_run(tmp_path / "later", 1, line(1.0, 200.0, 300.0))
    unbegun = a_run(tmp_path / "unbegun", 1, [])
    never = ["--out", str(tmp_path / "never.png")]
    (tmp_path / "other.json").write_text("{}")
    curves.main([str(first), "--out", str(tmp_path / curves.FILE)])
    for arguments, message in (
        (
            [first, longer, *never],
            f"{first} and {longer} are trainings with different hyperparameters",
        ),
        ([first, elsewhere, *never], "are trainings on different tasks"),
        ([first, first, *never], "ppo-seed0 is given more than once"),
        ([*[tmp_path / curves.FILE] * 2, *never], "ppo-seed0 is given more than once"),
        ([tmp_path / "other.json", *never], f"{tmp_path / 'other.json'} holds no learning curves"),
        ([first, later, *never], "do not overlap"),
        ([unbegun, *never], f"no episode has ended yet in the training in {unbegun}"),
        ([tmp_path, *never], "holds no training run"),
        ([first, "--out", str(tmp_path / "never.gif")], "its suffix must be .png or .svg or .pdf"),
    ):
        assert curves.main([*map(str, arguments)]) == 2
        assert message in capsys.readouterr().err
    assert not list(tmp_path.glob("never*"))
