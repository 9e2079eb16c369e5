"""Every command and program in the README and the tutorials runs in a copy of the repository.

Commands that would take long are made small.
"""

import re
import sys
from pathlib import Path

import pytest

import turning_env
from tests.walking import LONG, ROOT, Smaller, blocks, check, commands, copy_to, run, walk

DOCS = ROOT / "docs"
SET_UP = ROOT / ".venv" / "test"
README = (ROOT / "README.md").read_text("utf-8")
TUTORIALS = DOCS / "tutorials"
# tests/test_identity.py walks this page, interpreted.
INTERPRETED = TUTORIALS / "change_the_lathe.md"
TEXTS = {"README": README}
"""The texts to walk, by name."""
for page in ("results", "scenario"):
    TEXTS[page] = (DOCS / f"{page}.md").read_text("utf-8")
for tutorial in sorted(TUTORIALS.glob("*.md")):
    if tutorial != INTERPRETED:
        TEXTS[tutorial.stem] = tutorial.read_text("utf-8")
# A class needs nothing of the page on which its plan is.
TEXTS["train"], _, TEXTS["class"] = TEXTS["train"].partition("## A class of 90 minutes\n")
# Both train the same agent first. In one copy of the repository that is done once.
TEXTS["train_and_submit"] = TEXTS.pop("train") + TEXTS.pop("submit_a_policy")
ELSEWHERE = (
    # This suite itself, and the installation of what is under test.
    "make test",
    "pip install",
    "python -m pip ",
    # tests/test_tables.py prints these tables and draws these figures.
    "python -m leaderboard show --results leaderboard/results --",
    "python -m leaderboard figure ",
    "python -m train.curves agents/",
    # Readers have these files, and the page shows them made in other ways.
    "python -m train.export mine-seed3.zip",
    "python -m leaderboard run --env RoughTurning-Family-v1 --agents submissions",
    "docker ",
    # A window, and minutes of compiling: tests/leaderboard/test_game.py and
    # tests/turning_env/test_main.py have both.
    "python -m leaderboard play",
    "python -m baselines.warm_up",
)
SMALLER = {
    # Episodes of RoughTurning-Batch-v0 have twenty steps.
    "make agents": Smaller(
        "STEPS=3000 RUNS=few-seeds SHIPPED=few-agents SEEDS=0 CARDS=agents/*/batch_casting/ppo.md"
    ),
    "make results": Smaller(
        "NUM_SEEDS=2 JOBS=1 SHIPPED=few-agents SHIPPED_RESULTS=few-shipped "
        "ENVS=RoughTurning-Batch-v0"
    ),
    "make verify": Smaller(
        "JOBS=1 "
        "VERIFY='--seeds 2 --env RoughTurning-Batch-v0 --policies parts_fixed_tuned ppo-seed0'"
    ),
    "python -m train.ppo": Smaller("--steps 20000 --set num_envs=32"),
    "python -m train.tune agent": Smaller("--steps 4096 --trials 1 --scenario short.toml"),
    "python -m train.tune rules": Smaller(
        "--seeds 1 --trials 2",
        {"rough_turning": "short.toml", "my_tool.toml": "short.toml", "--shipped": "--quick"},
    ),
    "python -m leaderboard run --policies steady_load": Smaller("--scenario short.toml"),
    "python -m leaderboard run --policy my_module": Smaller(
        "--policies fixed_tuned --scenario short.toml"
    ),
    "python -m leaderboard run --agents": Smaller(
        "--policies fixed_tuned grid_search --scenario short.toml"
    ),
    # The oracle takes seconds to compile.
    "python -m leaderboard run --policy team1": Smaller(replaced={"causal": "idle"}),
    "python -m leaderboard run": Smaller("--seeds 2"),
    "python -m leaderboard score": Smaller("--seeds 2"),
    # The page is of the agent: a rule that acts at once can play beside it.
    "python -m leaderboard run --env RoughTurning-Family-v1 --split": Smaller(
        "--seeds 1", {"self_tuning": "fixed_nominal_optimum"}
    ),
    "python -m leaderboard.watch": Smaller("--steps 6"),
}
"""How commands are made small, by their first words."""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Return a copy of the repository, with a scenario of short episodes."""
    copy_to(tmp_path)
    (tmp_path / "short.toml").write_text('name = "short"\n[control]\ntime_limit = 0.2\n')
    return tmp_path


@pytest.mark.slow
@pytest.mark.skipif(not SET_UP.exists(), reason="needs the .venv that make sets up")
@pytest.mark.parametrize("name", TEXTS)
def test_a_page_is_true(name: str, copy: Path) -> None:
    assert TEXTS[name]
    walk(TEXTS[name], copy, SMALLER, ELSEWHERE)


def test_every_smaller_command_is_in_a_text() -> None:
    printed = [
        command
        for text in TEXTS.values()
        for block in blocks(text)
        if block.language == "bash" and not block.text.startswith(LONG)
        for command in commands(block)
    ]
    for start in SMALLER:
        assert any(command.startswith(start) for command in printed), start


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    options = "--strict --quiet --config-file packaging/mkdocs.yml --site-dir"
    command = [sys.executable, "-m", "mkdocs", "build", *options.split(), str(tmp_path)]
    check(run(command, ROOT), "mkdocs build")
    for page in (
        "index.html",
        "environment/index.html",
        "scenario/index.html",
        "api/index.html",
        "leaderboard-page.html",
    ):
        text = (tmp_path / page).read_text("utf-8")
        assert "RoughTurning" in text
        assert "fonts.googleapis.com" not in text


def test_every_public_name_is_in_the_reference() -> None:
    text = (DOCS / "api.md").read_text("utf-8")
    documented = set(re.findall(r"^::: turning_env\.(\w+)$", text, re.MULTILINE))
    assert set(turning_env.__all__) - {"__version__"} <= documented


def test_every_link_of_the_readme_leads_somewhere() -> None:
    targets = re.findall(r"\]\((?!https?:)([^)#]+)\)", README)
    assert targets
    for target in targets:
        assert (ROOT / target).exists(), target


def test_every_file_that_the_page_of_guarantees_names_is_there() -> None:
    text = (DOCS / "soundness.md").read_text("utf-8")
    named = set(re.findall(r"`((?:tests|shop|research|train|turning_env)/[\w/.]+)`", text))
    assert named
    assert {path for path in named if not (ROOT / path).exists()} == set()
