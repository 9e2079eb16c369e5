"""The ablation trains its variants as it says, and its table comes whole."""

from pathlib import Path

import numpy as np
import pytest

from studies import ablation
from studies.ablation import VARIANTS, Played
from tests.train.small import PARAMETERS, SCENARIO
from train.run import Run, hyperparameters


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings of some hundred intervals, on edges that wear out soon."""
    known = hyperparameters("ppo", ablation.ENV_ID) | PARAMETERS["ppo"] | {"rollout": 32, "batch_size": 64}
    monkeypatch.setattr("train.run.hyperparameters", lambda algorithm, env_id: known)
    monkeypatch.setattr(ablation, "IDS", {ablation.ENV_ID: SCENARIO})
    monkeypatch.setattr(ablation, "NUM_SEEDS", 3)


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_every_variant_is_trained_played_and_tabled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "docs" / "ablation.md"
    arguments = ["--steps", "300", "--runs", str(tmp_path / "runs"), "--out", str(out)]
    assert ablation.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" | ")[0][2:] for line in lines[2:]] == [variant.title for variant in VARIANTS.values()]
    assert all(line.count("|") == lines[0].count("|") for line in lines)
    written = out.read_text("utf-8")
    assert "\n".join(lines) in written
    assert f"python -m studies.ablation {' '.join(arguments)}" in written
    scenarios = {name: Run.read(ablation_folder(tmp_path, name)).scenario for name in VARIANTS}
    assert scenarios["set_point"].control.action == "set_point"
    assert scenarios["as_it_is"] == SCENARIO
    assert Run.read(ablation_folder(tmp_path, "four_frames")).parameters["frames"] == 4


def ablation_folder(folder: Path, name: str) -> Path:
    """Where a variant's first training is kept."""
    return folder / "runs" / "ablation" / name / ablation.ENV_ID / SCENARIO.name / "ppo-seed0"


def test_differences_are_paired_by_draw() -> None:
    """Draws differ by far more than the variants do."""
    draws = np.linspace(-500.0, 500.0, 40)
    rows = [
        Played(name, {"return": np.stack([draws + more, draws + more + 2.0])} | dict.fromkeys(COUNTS, np.ones((2, 40))), 7.0)
        for name, more in (("as_it_is", 0.0), ("discount_0.5", 30.0))
    ]
    first, second = (line.split(" | ") for line in ablation.table(rows)[2:])
    assert (first[2], second[2]) == ("", "30.0 (28.0 to 32.0)")
    assert first[1].startswith("1 (-")
    assert second[3:] == ["100.00", "100.0", "7 |"]


COUNTS = ("severe_overload_time", "engaged_time", "edges_broken", "edges_used")
