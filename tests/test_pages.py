"""Every command and program in the README and the tutorials, run in a copy of the repository, small where it would take long."""

import re
import sys
from pathlib import Path

import pytest

import turning_env
from tests.walking import ROOT, Smaller, check, copy_to, run, walk

DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text("utf-8")
TUTORIALS = DOCS / "tutorials"
INTERPRETED = (
    TUTORIALS / "change_the_lathe.md"
)  # tests/test_identity.py walks this one, interpreted
ALIKE = (
    TUTORIALS / "train.md",
    TUTORIALS / "submit_a_policy.md",
)  # they train, export and rank the same agent
ALONE = (
    ROOT / "README.md",
    DOCS / "results.md",
    *sorted(set(TUTORIALS.glob("*.md")) - {INTERPRETED, *ALIKE}),
)
# This suite itself, the installation of what is under test, and tables, which tests/test_tables.py prints.
ELSEWHERE = (
    "make test",
    "pip install",
    "python -m leaderboard show --results leaderboard/results --",
)
# How a command is made small: options added to it, words replaced in it.
SMALLER: Smaller = {
    "make leaderboard": (
        "SCENARIO=short.toml STEPS=20000 NUM_SEEDS=1 RUNS=few-runs RESULTS=few-results",
        {},
    ),
    "make agents": (
        "STEPS=20000 RUNS=few-seeds SHIPPED=few-agents SEEDS=0 CARDS=agents/*/surface/ppo.md",
        {},
    ),
    "make results": (
        "TASK_SEEDS=2 SHIPPED=few-agents SHIPPED_RESULTS=few-shipped ENVS=RoughTurning-Surface-v1",
        {},
    ),
    "make verify": (
        "VERIFY='--seeds 2 --env RoughTurning-Batch-v0 --policies parts_fixed_tuned ppo-seed0'",
        {},
    ),
    "python -m train.ppo": ("--steps 20000 --set num_envs=32", {}),
    "python -m train.tune": ("--steps 4096 --trials 1", {}),
    "python -m baselines.tune": (
        "--seeds 1 --trials 2",
        {"rough_turning": "short.toml", "my_tool.toml": "short.toml", "--shipped": "--quick"},
    ),
    "python -m leaderboard run --policies steady_load": ("--scenario short.toml", {}),
    "python -m leaderboard run --policy my_module": ("--policies fixed_tuned --seeds 2", {}),
    "python -m leaderboard run --agents": ("--policies fixed_tuned grid_search", {}),
    "python -m leaderboard run": ("--seeds 2", {}),
    "python -m leaderboard.watch": ("--steps 6", {}),
}


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the repository, with a scenario of short episodes."""
    copy_to(tmp_path)
    (tmp_path / "short.toml").write_text('name = "short"\n[control]\ntime_limit = 0.2\n')
    return tmp_path


def set_up() -> bool:
    """Return whether make has set up the present .venv; else the copy's make would, and tie it to the copy."""
    ready = ROOT / ".venv" / "test"
    asked = max(
        (ROOT / name).stat().st_mtime for name in ("pyproject.toml", "packaging/constraints.txt")
    )
    return ready.exists() and ready.stat().st_mtime >= asked


@pytest.mark.slow
@pytest.mark.skipif(not set_up(), reason="needs the .venv that make sets up")
@pytest.mark.parametrize(
    "pages", [ALIKE, *((page,) for page in ALONE)], ids=lambda pages: pages[0].stem
)
def test_a_page_is_true(pages: tuple[Path, ...], copy: Path) -> None:
    done = ELSEWHERE
    for page in pages:
        done += walk(page.read_text("utf-8"), copy, SMALLER, done)


def test_the_readme_prints_what_it_says() -> None:
    program, printed = re.search(
        r"```python\n(.*?)```.*?```text\n(.*?)```", README, re.DOTALL
    ).groups()  # type: ignore[union-attr]
    assert run([sys.executable, "-c", program], ROOT).stdout == printed


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    check(
        run(
            [
                sys.executable,
                "-m",
                "mkdocs",
                "build",
                "--strict",
                "--quiet",
                "--config-file",
                "packaging/mkdocs.yml",
                "--site-dir",
                str(tmp_path),
            ],
            ROOT,
        ),
        "mkdocs",
    )
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
    assert set(turning_env.__all__) - {"__version__"} <= set(
        re.findall(r"^::: turning_env\.(\w+)$", text, re.MULTILINE)
    )


def test_every_link_of_the_readme_leads_somewhere() -> None:
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("page", ["soundness", "security"])
def test_every_file_that_a_page_of_guarantees_names_is_there(page: str) -> None:
    text = (DOCS / f"{page}.md").read_text("utf-8")
    named = set(re.findall(r"`((?:tests|studies|train|turning_env)/[\w/.]+)`", text))
    assert named
    assert {path for path in named if not (ROOT / path).exists()} == set()
