"""A disk that is full, and folders that must not be written.

Both give a message, and earlier files stay as they were.
"""

import os
import resource
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from leaderboard import __main__ as board
from tests.train.small import ALGORITHMS, SCENARIO, small_run
from tools.soak import files, unreadable
from train import ppo, tune
from train.training import train

Main = Callable[[Sequence[str]], int]
NOBODY = 65534


@contextmanager
def full_disk(most: int) -> Iterator[None]:
    """Limit the size of files."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.fixture
def read_only() -> Iterator[Callable[[], Path]]:
    """Gives a folder in which this process can from then on read but not write."""
    with tempfile.TemporaryDirectory() as name:

        def forbid() -> Path:
            Path(name).chmod(0o555)
            if os.geteuid() == 0:  # may write everywhere
                os.seteuid(NOBODY)
            return Path(name)

        try:
            yield forbid
        finally:
            if os.getuid() == 0:
                os.seteuid(0)


def commands(folder: Path, scenario: Path) -> dict[str, tuple[Main, list[str]]]:
    """Programs that write, with their arguments."""
    rules = [
        "run",
        "--policies",
        "programmed_feed",
        "tmac",
        "--env",
        "RoughTurning-Override-v1",
        "--seeds",
        "1",
    ]
    search = [
        "rules",
        "--scenario",
        str(scenario),
        "--rules",
        "fixed_tuned",
        "--trials",
        "1",
        "--seeds",
        "2",
    ]
    return {
        "train.ppo": (ppo.main, ["--steps", "1", "--runs", str(folder / "runs")]),
        "train.tune": (
            tune.main,
            [*search, "--out", str(folder / "tuned" / "short.json")],
        ),
        "leaderboard run": (board.main, [*rules, "--results", str(folder / "results")]),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", commands(Path(), Path()))
def test_a_folder_that_must_not_be_written_is_an_error(
    name, read_only, tmp_path, capsys, scenario_file
) -> None:
    main, arguments = commands(tmp_path, scenario_file)[name]
    assert (
        main(arguments) == 0
    )  # where it may be written, it is; and all modules are loaded before the user changes
    folder = read_only()
    main, arguments = commands(folder, scenario_file)[name]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert "Permission denied" in said
    assert str(folder) in said
    assert list(folder.iterdir()) == []


@pytest.fixture(scope="module")
def scenario_file() -> Iterator[Path]:
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(SCENARIO.to_toml())
        file.flush()
        Path(file.name).chmod(0o444)
        yield Path(file.name)


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # the file that its library leaves open
def test_a_training_that_finds_the_disk_full_goes_on_later(tmp_path: Path) -> None:
    algorithm = ALGORITHMS["ppo"]
    undisturbed, run = (small_run(algorithm, tmp_path / name) for name in ("undisturbed", "full"))
    train(undisturbed, algorithm)
    with full_disk(20_000), pytest.raises(OSError, match=r"File too large|No space left"):
        train(run, algorithm, checkpoint_every=512)  # its first checkpoint is larger
    assert (run.folder / "run.json").exists()
    assert not run.checkpoint.exists()
    assert not list(run.folder.glob(".partial-*"))
    assert unreadable(run.folder) == []
    train(run, algorithm)
    assert [path.name for path in files(run.folder)] == [
        path.name for path in files(undisturbed.folder)
    ]


@pytest.mark.slow
def test_a_leaderboard_that_finds_the_disk_full_keeps_what_is_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main, arguments = commands(tmp_path, tmp_path)["leaderboard run"]
    with full_disk(3000):  # of which the trajectories are more
        assert main(arguments) == 2
    assert "trajectories.json.xz: File too large" in capsys.readouterr().err
    assert [path.name for path in files(tmp_path)] == (
        played := ["programmed_feed.json.xz", "tmac.json.xz"]
    )
    assert unreadable(tmp_path) == []
    (first, *_) = files(tmp_path)
    before = first.stat().st_mtime_ns
    assert main(arguments) == 0
    assert {path.name for path in files(tmp_path)} == {
        *played,
        "manifest.json",
        "trajectories.json.xz",
        "index.html",
    }
    assert first.stat().st_mtime_ns == before
