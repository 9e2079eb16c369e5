"""Filming policies: every kind of file, two side by side, the window, and errors."""

from pathlib import Path

import numpy as np
import pytest
import tomli_w
from PIL import Image

from leaderboard.watch import main
from tests.leaderboard.agents import onnx_agents
from tests.turning_env.test_family_env import BRIEF, BRIEF_FAMILY
from turning_env import FAMILY_ID, Scenario

AGENT = "agents/RoughTurning-v0/rough_turning/ppo-seed0.onnx"
HEIGHT = 670
WIDTH = 960
GAP = 8  # between two pictures


@pytest.fixture
def short(scenario: Scenario, tmp_path: Path) -> list[str]:
    """Options for an episode of twelve steps."""
    scenario.save(tmp_path / "short.toml")
    return ["--scenario", str(tmp_path / "short.toml")]


@pytest.mark.slow
def test_videos_gifs_and_stills(short: list[str], tmp_path: Path) -> None:
    watch = [*short, "--policy", "fixed_handbook", "--steps", "5", "--every", "3", "--out"]
    folder = tmp_path / "new"
    for name, signature in [("cut.mp4", b"ftyp"), ("cut.gif", b"GIF"), ("frame.png", b"PNG")]:
        path = folder / name
        assert main([*watch, str(path)]) == 0
        assert signature in path.read_bytes()[:16]
        assert path.stat().st_size > 5_000
    with Image.open(folder / "cut.gif") as gif:
        # The start, step 3 and the end.
        assert gif.n_frames == 3
        assert gif.size == (WIDTH, HEIGHT)
    assert sorted(path.name for path in folder.iterdir()) == ["cut.gif", "cut.mp4", "frame.png"]


@pytest.mark.slow
def test_two_stand_side_by_side_and_the_still_is_the_end(short: list[str], tmp_path: Path) -> None:
    def still(*words: str) -> np.ndarray:
        path = tmp_path / "still.png"
        assert main([*short, *words, "--out", str(path)]) == 0
        with Image.open(path) as image:
            return np.asarray(image)

    both = still("--agent", AGENT, "--beside", "fixed_handbook")
    alone = still("--policy", "fixed_handbook")
    assert both.shape == (HEIGHT, 2 * WIDTH + GAP, 3)
    assert np.array_equal(both[:, WIDTH + GAP :], alone)
    assert not np.array_equal(both[:, :WIDTH], alone)


@pytest.mark.slow
def test_policies_are_watched_on_a_job_of_a_family(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "brief.toml").write_text(tomli_w.dumps(BRIEF))
    agent = onnx_agents.write_of_family(tmp_path / "agents", BRIEF_FAMILY, 0)
    family = ["--env", FAMILY_ID, "--scenario", str(tmp_path / "brief.toml")]
    out = tmp_path / "job.png"
    watch = [*family, "--split", "unseen_jobs", "--out", str(out)]
    pictures = set()
    for seed in ("1", "2"):
        for rule in ("rescaled_grid_search", "self_tuning"):  # built from one job, and from all
            policies = ["--agent", str(agent), "--beside", rule]
            assert main([*watch, *policies, "--seed", seed, "--steps", "3"]) == 0
            pictures.add(out.read_bytes())
    assert len(pictures) == 4
    assert main([*watch, "--policy", "self_tuning", "--seed", "100000"]) == 2
    assert "100001 seeds asked for, but the split 'unseen_jobs'" in capsys.readouterr().err
