"""All command lines: help whose examples parse, exit statuses, errors of one line, clean JSON."""

import argparse
import importlib
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.train.small import ALGORITHMS
from tests.walking import ROOT, blocks, commands

PACKAGES = ("turning_env", "baselines", "train", "leaderboard", "research", "tools")
SHOP = ("turning_shop", "turning_nc", "turning_control")


class Mistake(NamedTuple):
    """A command line with a mistake in a name, a number or a file."""

    command: str
    arguments: str  # as typed in a shell
    message: str = ""  # a part of what must be said


MISTAKES = {
    "turning_env": [
        "nothing",
        "show nothing",
    ],
    "turning_env presets": [
        "more",
    ],
    "turning_env show": [
        "nothing",
        ".",
    ],
    "turning_env schema": [
        "more",
    ],
    "turning_env warm-up": [
        "more",
    ],
    "turning_env program": [
        "nothing.mpf --scenario rough_turning",
        ". --scenario rough_turning",
        "nothing.mpf --scenario rough_turning --adapt nothing",
        "nothing.mpf --scenario rough_turning --tool T1",
    ],
    "turning_env play": [
        "--env nothing",
        "--seed -1",
        "--fps 0",
    ],
    "turning_env score": [
        "nothing.onnx",
        "nothing:policy",
        "math:pi",
        "nothing.onnx --env nothing",
        "math:cos --seeds 0",
    ],
    "turning_env calibrate": [
        "nothing.csv --out made.toml",
        ". --out made.toml",
    ],
    "turning_env predict": [
        "nothing.csv",
        ". --hold-out row",
    ],
    "turning_env whatif": [
        "nothing --cutting-speed 100 --feed 0.3 --wear 0.2",
        "forging --cutting-speed x --feed 0.3 --wear 0.2",
    ],
    "turning_env advise": [
        "nothing",
        "batch_casting --seeds 0",
        ". --seeds 1",
        "forging --seeds -1",
    ],
    "turning_env map": [
        "nothing --wear 0.2 --out made.png",
        "forging --wear 0.2 --out made.txt",
    ],
    "baselines.law_errors": [
        "nothing",
    ],
    "baselines.tune_contextual": [
        "nothing",
        "shop --jobs 3 --out made.json",
        "shop --jobs x",
    ],
    "turning_control": [
        "nothing",
    ],
    "turning_control shield": [
        "--env nothing",
        "--episodes 0",
        "--target x",
    ],
    "turning_control attack": [
        "--env nothing",
        "--candidates 0",
    ],
    "turning_control demo": [
        "--scenario nothing",
    ],
    "turning_control serve": [
        "--policy nothing",
        "--policy programmed --scenario nothing",
    ],
    "turning_control opcua": [
        "--policy programmed",
        "--policy nothing --url opc.tcp://127.0.0.1:1 --nodes nodes.toml",
    ],
    "turning_control plant": [
        "--log made.csv --scenario nothing",
    ],
    "research.papers.reproduce": [
        "more",
    ],
    "baselines.tune": [
        "--scenario nothing",
        "--rules nobody",
        "--trials 0",
        "--seeds 0",
        "--jobs 0",
        "--trials x",
    ],
    "research.papers.reproduce.part_programming_cases": [
        "more",
    ],
    "research.papers.figures": [
        "--only nothing",
        "--format gif",
    ],
    "train.tune": [
        "--algorithm ppo --scenario nothing",
        "--algorithm nobody",
        "--algorithm ppo --trials 0",
    ],
    "train.curves": [
        "nothing",
        ". --out made.png",
        "nothing --level x",
    ],
    "train.export": [
        "nothing --out made",
        ". --out made",
        "nothing",
    ],
    "leaderboard": [
        "nothing",
    ],
    "leaderboard run": [
        "--env nothing",
        "--scenario nothing",
        "--policies nobody --results made",
        "--policies --agents nothing.onnx --results made",
        "--policies --agents . --results made",
        "--seeds 0",
        "--jobs 0",
        "--seeds 1 --policies fixed_handbook --results file",
        "--knows true_laws",
        "--env RoughTurning-Family-v0 --split nothing",
        "--env RoughTurning-Family-v0 --seeds 257",
    ],
    "leaderboard show": [
        "--results nothing",
        "--results file",
    ],
    "leaderboard page": [
        "--results nothing",
        "--results file",
    ],
    "leaderboard figure": [
        "--results nothing",
        "--scenario nothing",
    ],
    "leaderboard verify": [
        "--results nothing --memory made.json",
        "--seeds 0",
        "--jobs x",
    ],
    "leaderboard cards": [
        "--results nothing",
        "--results file",
    ],
    "leaderboard pack": [
        "--results nothing",
        "--results file",
    ],
    "leaderboard.watch": [
        "--policy nobody --out made.gif",
        "--policy fixed_tuned --out made.txt",
        "--agent nothing.onnx --out made.gif",
    ],
    "tools.clients": [
        "nothing",
        "--write",
    ],
    "research.studies.exploits": [
        "--env nothing",
        "--seeds 0",
        "--search -1",
    ],
    "research.studies.one_job": [
        "--agent nothing.onnx --out made.png",
    ],
    "train.guided_ppo": [
        "--env nothing",
    ],
    "research.studies.family_fixed": [
        "nothing",
        "shop --jobs 0",
    ],
    "research.studies.family_regression": [
        "nothing",
        "shop --jobs 3",
    ],
    "research.studies.family_sources": [
        "nothing",
        "shop --list nothing",
    ],
    "research.studies.measured_sets": [
        "nothing.csv",
        "vicomtech nothing.csv",
        "h13 nothing.csv",
    ],
    "research.studies.slower_wear": [
        "nothing.csv",
        "",
    ],
    "research.studies.unmodelled_draw": [
        "nothing",
        "unmodelled2 --jobs 0",
        "unmodelled2 --part nothing",
    ],
    "research.studies.unmodelled_reactions": [
        "--jobs 0",
        "--part nothing",
    ],
    "research.studies.paired": [
        "ppo causal --scenarios nothing",
        "ppo causal",
    ],
    "research.studies.imitation": [
        "nothing.onnx",
        "nothing.onnx --jobs 0",
    ],
    "train.dagger": [
        "--env nothing",
    ],
    "research.studies.headroom": [
        "--seeds 0",
        "--seeds 257",
    ],
    "tools.audit": [
        "nothing",
    ],
    "tools.fresh_root": [
        "",
        "--archive file",
    ],
    "tools.soak": [
        "--kills 0",
        "--only nothing",
        "--steps 1",
    ],
    "research.studies": [
        "nothing",
        "nothing.toml",
        "ablation --variants nothing",
        "ablation --trainings 0",
        "ablation --jobs x",
    ],
    "research.studies.throughput": [
        "--repeats 0",
    ],
    "tools.wheel": [
        "--constraints nothing",
        "--constraints file",
    ],
}
"""Arguments of every command that must end in an error, whatever it says."""
EXPLAINED = [
    Mistake(
        "train.ppo",
        "--seed -1",
        "the training seed is -1, but must be 0 to 998",
    ),
    Mistake(
        "train.ppo",
        "--total-timesteps 0",
        "total_timesteps is 0, but must be at least 1",
    ),
    Mistake(
        "train.ppo",
        "--scenario nowhere",
        "python -m turning_env presets",
    ),
    Mistake(
        "train.ppo",
        "--env shop",
        "shop is a family of RoughTurning-Family-v0, not an id",
    ),
    Mistake(
        "train.ppo",
        "--env RoughTurning-Overide-v1",
        "'RoughTurning-Overide-v1' is no id; did you mean RoughTurning-Override-v1?",
    ),
    Mistake(
        "leaderboard verify",
        "--env RoughTurning-v1",
        "'RoughTurning-v1' is no id; did you mean RoughTurning-v0",
    ),
    Mistake(
        "train.ppo",
        "--steps 1.5",
        "'1.5' is not a whole number, such as 1000000 or 1e6",
    ),
    Mistake(
        "train.ppo",
        "--set gamma=2",
        "gamma is 2.0, but must be 0 to 1",
    ),
    Mistake(
        "train.ppo",
        "--scenario shop",
        "shop is a family, not a scenario: add --env RoughTurning-Family-v0",
    ),
    Mistake(
        "train.ppo",
        "--stps 100",
        "there is no option --stps; did you mean --steps?",
    ),
    Mistake(
        "leaderboard run",
        "--policies predictiv --results made",
        "no policy is called predictiv; did you mean predictive?",
    ),
    Mistake(
        "train.ppo",
        "--set learing_rate=1",
        "ppo has no hyperparameter 'learing_rate'; did you mean learning_rate",
    ),
    Mistake(
        "train.ppo",
        "--set learning_rate",
        "learning_rate is '', but must be a float of 0 or more, such as 0.002",
    ),
    Mistake(
        "train.ppo",
        "--set gamma=nan",
        "gamma is nan, but",
    ),
    Mistake(
        "train.ppo",
        "--set \"net_arch=[1, 'x']\"",
        "net_arch is 'x', but",
    ),
    Mistake(
        "baselines.tune",
        "--scenario harder_lot --out made.json",
        "scenario 'harder_lot' has a model mismatch",
    ),
    Mistake(
        "baselines.tune",
        "--scenario rough_turning --rules fixed_handbook --out made.json",
        "fixed_handbook has nothing to tune",
    ),
    Mistake(
        "baselines.tune",
        "--scenario rough_turning --rules parts_pv --out made.json",
        "parts_pv cannot play",
    ),
    Mistake(
        "baselines.tune",
        "--scenario forging",
        "ships with the project: give",
    ),
    Mistake(
        "baselines.tune",
        "--shipped --scenario file",
        "--shipped rewrites the parameters of a preset, one of",
    ),
    Mistake(
        "baselines.tune",
        "--scenario rough_turning --out forging.toml",
        "--out forging.toml must end in .json",
    ),
    Mistake(
        "leaderboard.watch",
        "--policy causal --out made.gif",
        "causal cannot be watched: only what acts on observations can",
    ),
    Mistake(
        "leaderboard.watch",
        "--policy grid_search --seed -1 --out made.gif",
        "seed -1",
    ),
    Mistake(
        "leaderboard.watch",
        "--policy grid_search --split train --out made.gif",
        "--split is of RoughTurning-Family-v0",
    ),
    Mistake(
        "leaderboard.watch",
        "--policy grid_search --out cut.avi",
        "cut.avi must end in one of .mp4, .gif, .png",
    ),
    Mistake(
        "leaderboard.watch",
        "--policy grid_search --beside fixed_handbook --human",
        "--human shows one policy",
    ),
    Mistake(
        "turning_env whatif",
        "forging --cutting-speed -1 --feed 0.3 --wear 0.2",
        "-1 is outside the allowed range 0.1 to 5000 m/min",
    ),
    Mistake(
        "turning_env whatif",
        "forging --cutting-speed 100 --feed 0.1:0.2 --wear 0.2",
        "invalid number value: '0.1:0.2'",
    ),
    Mistake(
        "turning_env whatif",
        "forging --cutting-speed 100 --feed 0.3",
        "one of the arguments --time --wear is required",
    ),
    Mistake(
        "turning_env whatif",
        "forging --cutting-speed 100 --feed 0.3 --wear 0.2 --time 1",
        "not allowed with",
    ),
    Mistake(
        "turning_env advise",
        "--material P6 --tool CNMG120408 --grade P25 --stok 80x200",
        "there is no option --stok; did you mean --stock?",
    ),
    Mistake(
        "turning_env advise",
        "--material P6 --tool CNMG120408 --grade P25 --stock 80x200 --depth 2cm",
        "'2cm' is no length: give mm, such as 2.5, or inch, such as 0.08in; decimals have a point",
    ),
    Mistake(
        "turning_control log",
        "opc.tcp://127.0.0.1:1 --appendix",
        "there is no option --appendix; did you mean --append?",
    ),
    Mistake(
        "turning_env map",
        "forging --wear 0.31 --out made.png",
        "--wear is 0.31, but an edge is worn out at tool.wear_criterion, 0.3 mm",
    ),
    Mistake(
        "leaderboard run",
        "--private-key short --results made",
        "the private key has 5 characters, but must have at least 16",
    ),
]
"""Mistakes whose message must help."""


def every_mistake() -> list[Mistake]:
    """Return the mistakes of all commands: those of every training algorithm, and those above."""
    mistakes = []
    for algorithm in ALGORITHMS:
        mistakes.append(Mistake(f"train.{algorithm}", "--env nothing"))
        mistakes.append(Mistake(f"train.{algorithm}", "--steps 1 --runs file"))
    for command, examples in MISTAKES.items():
        mistakes += [Mistake(command, arguments) for arguments in examples]
    return mistakes + EXPLAINED


CASES = every_mistake()
COMMANDS = list(dict.fromkeys(case.command for case in CASES))


class ParsedError(Exception):
    """Raised instead of running a command once it has parsed its arguments."""


def main_of(module: str) -> Callable[[list[str]], int]:
    """Return the function behind ``python -m module``."""
    program = importlib.import_module(module)
    is_package = hasattr(program, "__path__")
    if is_package:
        program = importlib.import_module(f"{module}.__main__")
    main: Callable[[list[str]], int] = program.main
    return main


def status_of(command: str, arguments: list[str]) -> int:
    """Return the exit status of a command, whether its parser or the command itself ends it."""
    module, *words = command.split()
    try:
        return main_of(module)([*words, *arguments])
    except SystemExit as ended:
        return int(ended.code or 0)


@pytest.fixture
def parse(monkeypatch: pytest.MonkeyPatch) -> Callable[[list[str]], None]:
    """Return a function that has a command parse its words, without running it."""
    original = argparse.ArgumentParser.parse_args

    def parse_args(*arguments: Any) -> Any:
        original(*arguments)
        raise ParsedError

    def parse(words: list[str]) -> None:
        with monkeypatch.context() as patched:
            patched.setattr(argparse.ArgumentParser, "parse_args", parse_args)
            with pytest.raises(ParsedError):
                status_of(words[0], words[1:])

    return parse


def test_every_command_is_among_these() -> None:
    folders = dict.fromkeys(PACKAGES, ROOT) | dict.fromkeys(SHOP, ROOT / "shop")
    modules = set()
    for package, folder in folders.items():
        for path in (folder / package).rglob("*.py"):
            if re.search(r"^if __name__ ==", path.read_text("utf-8"), re.MULTILINE):
                module = ".".join(path.relative_to(folder).with_suffix("").parts)
                modules.add(module.removesuffix(".__main__"))
    # These run before anything is installed, or where nothing else is.
    modules -= {"tools.density", "tools.requirements"}
    assert modules == {command.split()[0] for command in COMMANDS}


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_examples_that_parse(
    command: str, capsys, parse: Callable[[list[str]], None]
) -> None:
    assert status_of(command, ["--help"]) == 0
    printed = capsys.readouterr().out
    _, title, text = re.split(
        r"^(examples?):$",
        printed,
        maxsplit=1,
        flags=re.MULTILINE,
    )
    examples = []
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("  python -m "):
            _, _, *words = shlex.split(line)
            examples.append(words)
    words_of_command = command.split()
    length = len(words_of_command)
    of_command = [words for words in examples if words[:length] == words_of_command]
    min_examples = 1 if title == "example" else 2
    assert len(of_command) >= min_examples
    for words in examples:
        parse(words)


@pytest.mark.slow
def test_every_command_in_the_documentation_parses(parse: Callable[[list[str]], None]) -> None:
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    pages += sorted((ROOT / "shop").rglob("*.md"))
    documented = []
    for page in pages:
        for block in blocks(page.read_text("utf-8")):
            if block.language != "bash":
                continue
            for line in commands(block):
                words = shlex.split(line)
                package = words[2].partition(".")[0] if len(words) > 2 else ""
                if words[:2] == ["python", "-m"] and package in PACKAGES + SHOP:
                    documented.append(words[2:])
    assert len(documented) > 50
    for words in documented:
        parse(words)


@pytest.mark.parametrize("mistake", CASES, ids=lambda case: f"{case.command} {case.arguments}")
def test_mistake_is_an_error_of_one_line_and_writes_nothing(
    mistake: Mistake,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    assert status_of(mistake.command, shlex.split(mistake.arguments)) == 2
    printed = capsys.readouterr()
    assert re.search(r"error: \S", printed.err.splitlines()[-1])
    assert mistake.message in printed.err
    assert printed.out == ""
    assert not [path for path in Path().rglob("*") if path.is_file() and path.name != "file"]


@pytest.mark.slow
def test_reader_that_leaves_early_is_no_error() -> None:
    code = "from turning_env.console import exits\n"
    code += "raise SystemExit(exits(checks={})(lambda: print('x' * 10**6) or 0)())"
    for checks, status in ((False, 0), (True, 1)):
        with subprocess.Popen(
            [sys.executable, "-c", code.format(checks)],
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
