"""Two programs in one folder at once."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from baselines import tuned
from leaderboard.result import Task, read_part, result_folder
from leaderboard.trajectories import RECORDED_SEEDS, Trajectories
from tests.leaderboard.conftest import ENV_ID, Steady, play_all, spec
from tests.train.small import ALGORITHMS, SCENARIO, small_run
from tests.walking import ROOT
from train import tune, tune_rules
from train.run import Run
from train.training import train
from turning_env import Scenario
from turning_env.files import folder_lock

PARTIAL = ".partial-*"
HOLD = """
import sys
from pathlib import Path
from turning_env import files
with getattr(files, sys.argv[1])(Path(sys.argv[2])):
    print("held", flush=True)
    sys.stdin.readline()
"""


@contextmanager
def held(how: str, path: Path) -> Iterator["subprocess.Popen[str]"]:
    """Another process, which holds a folder or a file until it is killed or its input ends."""
    command = [sys.executable, "-c", HOLD, how, str(path)]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        try:
            yield other
        finally:
            other.kill()


@pytest.mark.slow
def test_a_folder_is_held_until_the_process_ends_however_it_ends(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    with held("folder_lock", folder) as other:
        (folder / ".partial-7").mkdir()
        (folder / ".partial-7" / "content.txt").touch()
        with (
            pytest.raises(ValueError, match=f"another process works in {folder}"),
            folder_lock(folder),
        ):
            pass
        assert list(folder.glob(PARTIAL))  # another process may be filling it
        other.kill()
        other.wait()
        with folder_lock(folder):
            assert not list(folder.glob(PARTIAL))
    assert not list(folder.iterdir())


@pytest.mark.slow
def test_who_waits_for_a_folder_then_holds_it_alone(tmp_path: Path) -> None:
    inside = 0

    def enter(_: int) -> None:
        nonlocal inside
        with folder_lock(tmp_path, wait=True):
            inside += 1
            assert inside == 1
            time.sleep(0.01)
            inside -= 1

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(enter, range(8)))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_training_is_not_trained_twice_at_once(tmp_path: Path) -> None:
    algorithm = ALGORITHMS["ppo"]
    run = small_run(algorithm, tmp_path, steps=512)
    with held("folder_lock", run.folder) as other:
        with pytest.raises(
            ValueError, match=f"another process works in {run.folder}: wait until it has finished"
        ):
            train(run, algorithm)
        assert not list(run.folder.glob("[!.]*"))
        threading.Timer(0.2, other.kill).start()
        assert train(run, algorithm, wait=True) == run.policy


def test_a_damaged_run_says_which_file(tmp_path: Path) -> None:
    algorithm = ALGORITHMS["ppo"]
    run = small_run(algorithm, tmp_path)
    run.begin()
    run.checkpoint.write_bytes(b"no archive")
    with pytest.raises(
        ValueError,
        match=rf"{run.checkpoint} cannot be read: .*; delete it to train from the start",
    ):
        train(run, algorithm)
    for content in ("{}", "[]", "[" * 100_000):
        (run.folder / "run.json").write_text(content)
        with pytest.raises(
            ValueError, match=rf"{run.folder / 'run.json'} describes no training run"
        ):
            Run.read(run.folder)


@pytest.mark.slow
def test_a_search_of_rules_is_not_made_twice_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    SCENARIO.save(tmp_path / "short.toml")
    arguments = [
        "rules",
        "--scenario",
        str(tmp_path / "short.toml"),
        "--trials",
        "1",
        "--seeds",
        "2",
        "--rules",
    ]
    with held("file_lock", tune_rules.log_of("fixed_tuned", tmp_path / "short.tuned.json")):
        assert tune.main([*arguments, "fixed_tuned"]) == 2
        assert "error: another process works in" in capsys.readouterr().err
        assert (
            tune.main([*arguments, "rescaled_grid_search"]) == 0
        )  # another rule, into the same file
    assert tune.main([*arguments, "fixed_tuned"]) == 0
    assert tuned.contents(Scenario.load(tmp_path / "short.toml"))["rules"].keys() == {
        "fixed_tuned",
        "rescaled_grid_search",
    }


@pytest.mark.slow
def test_two_runs_of_the_leaderboard_into_one_folder_lose_nothing(tmp_path: Path) -> None:
    task = Task(
        env_id=ENV_ID,
        scenario=Scenario.model_validate({"control": {"time_limit": 0.2}}),
        seeds=[7, 8, 9, 10],
    )
    here, expected = (
        result_folder(tmp_path / name, ENV_ID, task.scenario.name) for name in ("two", "one")
    )
    second = spec("second", (0.0, 0.2))
    third = spec("third", (0.0, 0.3))
    recording = 0

    def make(num_envs: int) -> Steady:
        nonlocal recording
        recording += num_envs == 1
        if recording == 1:  # while the first run records what its policy does
            recording += 1
            play_all(task, [second, third], here)
        return Steady(num_envs, (0.0, 0.1))

    play_all(task, [spec("first", (0.0, 0.1), make=make), third], here)
    play_all(task, [spec("first", (0.0, 0.1)), second, third], expected)
    assert recording > 1
    names = [path.name for path in sorted(expected.iterdir())]
    assert names == [
        "first.json.xz",
        "manifest.json",
        "second.json.xz",
        "third.json.xz",
        "trajectories.json.xz",
    ]
    for name in set(names) - {"manifest.json"}:
        assert (here / name).read_bytes() == (expected / name).read_bytes()
    assert (
        len(read_part(Trajectories, here / "trajectories.json.xz").episodes) == 3 * RECORDED_SEEDS
    )
