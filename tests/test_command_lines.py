"""Command lines: help whose examples parse, exit statuses, and errors of one line."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_lines import check_help, check_mistake, command_modules, documented, parse
from tests.train.small import ALGORITHMS
from tests.walking import ROOT

PACKAGES = ("turning_env", "baselines", "train", "leaderboard", "research", "tools")
MODULES = set(command_modules(ROOT, PACKAGES))
# It runs before anything is installed.
MODULES -= {"tools.requirements"}
COMMANDS = [
    *sorted(MODULES),
    "turning_env show",
    "leaderboard score",
    "leaderboard play",
    "leaderboard run",
    "leaderboard show",
    "leaderboard verify",
]

MISTAKES = {
    # A name that does not exist.
    "turning_env nothing": "nothing",
    "turning_env show nothing": "nothing",
    "leaderboard play --env nothing": "nothing",
    "leaderboard score nothing.onnx": "nothing.onnx",
    "leaderboard score nothing:policy": "nothing",
    "train.tune rules --scenario nothing": "nothing",
    "train.tune agent --algorithm nobody": "nobody",
    "train.curves nothing": "nothing",
    "train.export nothing --out made": "nothing",
    "leaderboard run --scenario nothing": "nothing",
    "leaderboard run --policies --agents nothing.onnx --results made": "nothing.onnx",
    "leaderboard run --env RoughTurning-Family-v1 --split nothing": "nothing",
    "leaderboard show --results nothing": "nothing",
    "leaderboard page --results nothing": "nothing",
    "leaderboard verify --results nothing --memory made.json": "nothing",
    "leaderboard.watch --policy nobody --out made.gif": "nobody",
    # A name with a spelling mistake: the nearest one is proposed.
    "train.ppo --env RoughTurning-Overide-v1": "did you mean RoughTurning-Override-v1?",
    "train.ppo --stps 100": "did you mean --steps?",
    "train.ppo --set learing_rate=1": "did you mean learning_rate",
    "leaderboard run --policies predictiv --results made": "did you mean predictive?",
    "leaderboard verify --env RoughTurning-v1": "did you mean RoughTurning-v0",
    # A family in place of an id or a scenario.
    "train.ppo --env shop": "RoughTurning-Family-v1",
    "train.ppo --scenario shop": "--env RoughTurning-Family-v1",
    # A number out of its range, or none.
    "leaderboard play --seed -1": "-1",
    "leaderboard score math:cos --seeds 0": "0",
    "train.tune rules --trials x": "x",
    "train.tune rules --jobs 0": "0",
    "train.ppo --seed -1": "0 to 998",
    "train.ppo --steps 1.5": "whole number",
    "train.ppo --set gamma=2": "0 to 1",
    "train.ppo --set gamma=nan": "gamma is nan",
    "train.ppo --set learning_rate": "a float of 0 or more",
    "leaderboard run --seeds 0": "0",
    "leaderboard run --env RoughTurning-Family-v1 --seeds 257": "257",
    "leaderboard verify --jobs x": "x",
    "leaderboard run --private-key short --results made": "at least 16",
    # Options that do not go together, or that the policy cannot do.
    "leaderboard run --knows true_laws": "--knows",
    "leaderboard.watch --policy grid_search --split train --out made.gif": "--split",
    "leaderboard.watch --policy grid_search --beside fixed_handbook --human": "--human",
    "leaderboard.watch --policy causal --out made.gif": "causal",
    "leaderboard.watch --policy grid_search --out cut.avi": ".mp4, .gif, .png",
    "train.tune rules --scenario rough_turning --out forging.toml": ".json",
    "train.tune rules --scenario rough_turning --rules parts_pv --out made.json": "parts_pv",
    "train.tune rules --scenario harder_lot --out made.json": "harder_lot",
}
"""What the error must contain, by the command line with a mistake."""
for algorithm in ALGORITHMS:
    MISTAKES[f"train.{algorithm} --env nothing"] = "nothing"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_examples_that_parse(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    check_help(command, capsys)


@pytest.mark.parametrize("command", MISTAKES)
def test_a_mistake_is_an_error_of_one_line_and_writes_nothing(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    check_mistake(command, MISTAKES[command], capsys)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize(
    "command",
    [
        "train.ppo --steps 1 --runs file",
        "leaderboard run --seeds 1 --policies fixed_handbook --results file",
        "leaderboard show --results file",
    ],
)
def test_a_file_in_place_of_a_folder_is_an_error_and_stays(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "file").write_text("mine")
    monkeypatch.chdir(tmp_path)
    check_mistake(command, "file", capsys)
    files = [path.name for path in tmp_path.rglob("*") if path.is_file()]
    assert files == ["file"]
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.slow
def test_every_command_in_the_documentation_parses() -> None:
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    words_of_commands = documented(pages, PACKAGES)
    assert words_of_commands
    for words in words_of_commands:
        parse(words)


@pytest.mark.slow
@pytest.mark.parametrize(("checks", "status"), [(False, 0), (True, 1)])
def test_reader_that_leaves_early_is_no_error(checks: bool, status: int) -> None:
    code = "from turning_env.console import exits\n"
    code += f"raise SystemExit(exits(checks={checks})(lambda: print('x' * 10**6) or 0)())"
    with subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.read(1)
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == status
