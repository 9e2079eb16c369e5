"""Optional packages that are not installed: one line that says what to do, or no effect."""

from pathlib import Path

import pytest

from tests.faults.missing import check_missing, run_module, run_program

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("package", "command"),
    [
        ("torch", "train.ppo --steps 1"),
        ("optuna", "train.tune rules --trials 1"),
        (
            "matplotlib",
            "leaderboard figure --results leaderboard/results --env RoughTurning-Batch-v0",
        ),
        (
            "onnxruntime",
            "leaderboard run --results FILE --policies "
            "--agents agents/RoughTurning-Batch-v0/batch_casting/ppo-seed0.onnx",
        ),
        (
            "joblib",
            "leaderboard run --results FILE --policies programmed_feed "
            "--env RoughTurning-Override-v1 --seeds 1 --jobs 2",
        ),
        (
            "distributed",
            "leaderboard run --results FILE --policies programmed_feed "
            "--env RoughTurning-Override-v1 --seeds 1 --scheduler tcp://127.0.0.1:1",
        ),
        (
            "PIL",
            "leaderboard.watch --policy programmed_feed --env RoughTurning-Override-v1 "
            "--steps 1 --out FILE.gif",
        ),
        (
            "pygame",
            "leaderboard.watch --policy programmed_feed --env RoughTurning-Override-v1 "
            "--steps 1 --human",
        ),
    ],
)
def test_what_is_missing_is_said_in_one_line(package: str, command: str, tmp_path: Path) -> None:
    check_missing(tmp_path, package, command)


def test_scoring_an_agent_without_onnxruntime_says_how_to_install_it() -> None:
    agent = "agents/RoughTurning-Batch-v0/batch_casting/ppo-seed0.onnx"
    code = f"import leaderboard; leaderboard.score('{agent}')"
    finished = run_program("onnxruntime", code)
    last = finished.stderr.splitlines()[-1]
    assert (
        last == "ModuleNotFoundError: onnxruntime is not installed: "
        "pip install 'rough-turning[onnx]'"
    )


def test_without_torch_rules_are_played(tmp_path: Path) -> None:
    words = [
        "leaderboard",
        "run",
        "--env",
        "RoughTurning-Override-v1",
        "--seeds",
        "1",
        "--policies",
        "programmed_feed",
    ]
    words += ["--results", str(tmp_path / "results")]
    assert run_module("torch", words).returncode == 0
    assert (tmp_path / "results" / "index.html").exists()
