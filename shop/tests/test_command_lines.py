"""Command lines of the shop: help whose examples parse, exit statuses, and errors of one line."""

from pathlib import Path

import pytest

from tests.command_lines import check_help, check_mistake, command_modules, documented, parse
from tests.test_command_lines import PACKAGES as BENCHMARK
from tests.walking import ROOT

PACKAGES = ("turning_shop", "turning_nc", "turning_control")
OF_SHOP = ["calibrate", "predict", "whatif", "tools", "advise", "map", "program"]
COMMANDS = [
    *command_modules(ROOT / "shop", PACKAGES),
    *[f"turning_shop {name}" for name in OF_SHOP],
    "turning_control log",
    "turning_control drive",
]

MISTAKES = {
    # A name that does not exist.
    "turning_shop program nothing.mpf --scenario rough_turning": "nothing.mpf",
    "turning_shop calibrate nothing.csv --out made.toml": "nothing.csv",
    "turning_shop predict nothing.csv": "nothing.csv",
    "turning_shop whatif nothing --cutting-speed 100 --feed 0.3 --wear 0.2": "nothing",
    "turning_shop advise nothing": "nothing",
    "turning_shop map nothing --wear 0.2 --out made.png": "nothing",
    "turning_shop nothing": "nothing",
    "turning_control nothing": "nothing",
    "turning_control drive --simulated --policy programmed --scenario nothing": "nothing",
    "turning_control drive --policy nothing": "nothing",
    "turning_control log nothing.csv --cuts cuts.csv": "nothing.csv",
    "turning_control.plant --scenario nothing --log plant.csv": "nothing",
    # A folder in place of a file.
    "turning_shop calibrate . --out made.toml": ".",
    "turning_shop program . --scenario rough_turning": ".",
    # A name with a spelling mistake: the nearest one is proposed.
    "turning_shop advise --material P6 --tool CNMG120408 --grade P25 --stok 80x200": (
        "did you mean --stock?"
    ),
    "turning_control log opc.tcp://127.0.0.1:1 --appendix": "did you mean --append?",
    # A number out of its range, or none.
    "turning_shop whatif forging --cutting-speed -1 --feed 0.3 --wear 0.2": "0.1 to 5000 m/min",
    "turning_shop whatif forging --cutting-speed 100 --feed 0.1:0.2 --wear 0.2": "0.1:0.2",
    "turning_shop whatif forging --cutting-speed 100 --feed 0,2 --wear 0.2": (
        "give 0.001 to 10 mm/rev, without a unit; decimals have a point"
    ),
    "turning_shop map forging --wear 0,2 --out made.png": "decimals have a point",
    "turning_shop advise --material P6 --tool CNMG120408 --grade P25 --feeds 0,1-0,3": (
        "decimals have a point"
    ),
    "turning_control log opc.tcp://127.0.0.1:1 --interval 0,1": "give 0.01 to 3600 s",
    "turning_shop whatif forging --cutting-speed 100 --feed 0.3 --wear 0.2 --hardness 300": (
        "allowed range 0.1 to 10; a hardness has a unit: 300HB"
    ),
    "turning_shop advise --material P6 --hardness 32 HRC": "as in --hardness 32HRC",
    "turning_shop advise forging --agent nothing.onnx": "nothing.onnx: no such file",
    "turning_control log http://127.0.0.1:1 --list": "http://127.0.0.1:1/probe does not answer",
    "turning_shop map forging --wear 0.31 --out made.png": "0.3 mm",
    "turning_shop advise --material P6 --tool CNMG120408 --grade P25 --stock 80x200 --depth 2cm": (
        "give mm, such as 2.5, or inch, such as 0.08in"
    ),
    "turning_shop advise forging --seeds -1": "-1",
    "turning_control drive --simulated --policy programmed --bars 0": "0",
    # Options that are missing, or do not go together.
    "turning_shop whatif forging --cutting-speed 100 --feed 0.3": "--wear",
    "turning_shop whatif forging --cutting-speed 100 --feed 0.3 --wear 0.2 --time 1": "--time",
    "turning_shop program nothing.mpf --scenario rough_turning --tool T1": "T1",
    "turning_shop map forging --wear 0.2 --out made.txt": "made.txt",
    "turning_control drive": "--policy",
    "turning_control drive --policy programmed --nodes nodes.toml": "--url",
    "turning_control drive --policy programmed --bars 1": "--simulated",
    "turning_control drive --policy programmed --simulated --url opc.tcp://a --nodes b": "--url",
    "turning_control log opc.tcp://127.0.0.1:1 --out log.csv --wear 0": "--cuts",
    "turning_control log log.csv --out log.csv": "--cuts",
    "turning_control log log.csv --cuts cuts.csv --append": "--append",
}
"""What the error must contain, by the command line with a mistake."""


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


@pytest.mark.slow
def test_every_command_in_the_documentation_parses() -> None:
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    words_of_commands = documented(pages, PACKAGES)
    shop_pages = sorted((ROOT / "shop").rglob("*.md"))
    words_of_commands += documented(shop_pages, (*BENCHMARK, *PACKAGES))
    assert words_of_commands
    for words in words_of_commands:
        parse(words)
