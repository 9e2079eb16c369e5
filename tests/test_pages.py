"""Every command and program in the README and the tutorials, run in a copy of the repository, small where it would take long."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from tests.walking import ROOT, Smaller, blocks, check, commands, copy_to, run, small, walk

README = (ROOT / "README.md").read_text("utf-8")
COMMANDS = [line for block in blocks(README) if block.language == "bash" for line in commands(block)]
PROGRAMS = [block.text for block in blocks(README) if block.language == "python"]

# In this order: the last of these changes what is compiled.
TUTORIALS = ("ten_minutes", "train", "submit_a_policy", "add_a_controller", "add_a_material")
# tests/test_identity.py walks this one, interpreted.
INTERPRETED = "change_the_lathe"
# Commands that other tests run.
ELSEWHERE = {"python -m papers.reproduce": "tests/papers/test_reproduce.py"}
TO_OWN = {"--shipped": "--quick"}
"""What ships is not tuned anew."""
# How a command is made small: options added to it, words replaced in it.
SMALLER: Smaller = {
    "make leaderboard": ("STEPS=20000 NUM_SEEDS=1 RUNS=few-runs RESULTS=few-results", {}),
    "make agents": ("STEPS=20000 RUNS=few-seeds SHIPPED=few-agents SEEDS=0 AGENTS=RoughTurning-Surface-v0/ppo", {}),
    "make results": ("TASK_SEEDS=2 SHIPPED=few-agents SHIPPED_RESULTS=few-shipped ENVS=RoughTurning-Surface-v0", {}),
    "make verify": ("VERIFY='--seeds 2 --env RoughTurning-Surface-v0'", {}),
    "python -m train.ppo": ("--steps 20000", {}),
    "python -m baselines.tune": (
        "--seeds 1 --trials 2",
        {"rough_turning": "short.toml", "my_tool.toml": "short.toml", "--shipped": "--quick"},
    ),
    "python -m leaderboard run --policies steady_load": ("--scenario short.toml", {}),
    "python -m leaderboard run --agents": ("--policies fixed_tuned grid_search", {}),  # ``make leaderboard`` plays all
    "python -m leaderboard run": ("--seeds 2", {}),
    "python -m leaderboard.watch": ("--steps 6", {}),
    "python -m papers.figures": ("--only grid_search_12 --out few-figures", {}),
    "python -m benchmarks.throughput": ("--repeats 1", {}),
    "python -m benchmarks.overload_price": ("--seeds 1", {}),
    "python -m benchmarks.ablation": ("--steps 16384 --runs few-ablations --variants as_it_is", {}),
    "python -m benchmarks.bound": ("--seeds 1", {}),
    "python -m benchmarks.peers": ("--repeats 1 --seconds 0.01", {}),
    "python -m benchmarks.growth": ("--max-envs 8 --repeats 1 --seconds 0.01", {}),
    "python -m benchmarks.training": ("--repeats 1 --num-envs 8", {}),
    "python -m benchmarks.time_to_beat": ("--seeds 1 --tuning-seeds 2 --steps 16384 --rule fixed_handbook", {}),
}


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository, with a scenario of short episodes."""
    folder = tmp_path_factory.mktemp("copy")
    copy_to(folder)
    (folder / "short.toml").write_text('name = "short"\n[control]\ntime_limit = 0.2\n')
    return folder


def set_up() -> bool:
    """Return whether make has set up the present .venv; else the copy's make would, and tie it to the copy."""
    ready = ROOT / ".venv" / "test"
    asked = max((ROOT / name).stat().st_mtime for name in ("pyproject.toml", "constraints.txt"))
    return ready.exists() and ready.stat().st_mtime >= asked


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS, ids=range(len(PROGRAMS)))
def test_every_program_runs(program: str, copy: Path) -> None:
    check(run([sys.executable, "-W", "error", "-c", program], copy), program)


@pytest.mark.slow
@pytest.mark.skipif(not set_up(), reason="needs the .venv that make sets up")
def test_every_command_works_in_the_order_given(copy: Path) -> None:
    assert COMMANDS[0] == "make leaderboard"
    assert "make test" in COMMANDS
    for command in dict.fromkeys(COMMANDS):
        if command in ELSEWHERE:
            assert f"main({shlex.split(command)[3:]})" in (ROOT / ELSEWHERE[command]).read_text("utf-8")
            continue
        if command in ("make test", "make check"):  # what is running now
            assert "pytest" in run(["make", "-n", "test"], copy).stdout
            continue
        # Made small, these may miss their criteria, which is an exit with 1.
        allowed = (0, 1) if any(name in command for name in ("throughput", "training", "time_to_beat")) else (0,)
        check(run(small(command, SMALLER), copy), command, allowed)
    for page in TUTORIALS:
        walk((ROOT / "docs" / "tutorials" / f"{page}.md").read_text("utf-8"), copy, SMALLER, COMMANDS)
    for made in ("few-results/index.html", "results/index.html", "docs/leaderboard.png", "short.tuned.json"):
        assert (copy / made).stat().st_size > 0


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    check(run([sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)], ROOT), "mkdocs")
    for page in ("index.html", "environment/index.html", "scenario/index.html", "api/index.html", "leaderboard-page.html"):
        text = (tmp_path / page).read_text("utf-8")
        assert "RoughTurning" in text
        assert "fonts.googleapis.com" not in text
    assert {path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md")} == {*TUTORIALS, INTERPRETED}


def test_every_link_leads_somewhere() -> None:
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
