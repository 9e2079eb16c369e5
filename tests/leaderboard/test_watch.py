"""Filming policies: every kind of file, two side by side, the window, and errors."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from leaderboard.watch import main
from turning_env import Scenario

AGENT = "agents/RoughTurning-v0/rough_turning/ppo-seed0.onnx"
HEIGHT, WIDTH = 670, 960


@pytest.fixture
def short(scenario: Scenario, tmp_path: Path) -> list[str]:
    """Options for an episode of twelve steps."""
    scenario.save(tmp_path / "short.toml")
    return ["--scenario", str(tmp_path / "short.toml")]


@pytest.mark.slow
def test_videos_gifs_and_stills(short: list[str], tmp_path: Path) -> None:
    for name, begin in (("cut.mp4", b"ftyp"), ("cut.gif", b"GIF"), ("frame.png", b"PNG")):
        path = tmp_path / "new" / name
        words = ["--policy", "fixed_handbook", "--steps", "5", "--every", "3", "--out", str(path)]
        assert main([*short, *words]) == 0
        assert begin in path.read_bytes()[:16]
        assert path.stat().st_size > 5_000
    with Image.open(tmp_path / "new" / "cut.gif") as gif:
        assert (gif.n_frames, gif.size) == (3, (WIDTH, HEIGHT))
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["cut.gif", "cut.mp4", "frame.png"]


@pytest.mark.slow
def test_two_stand_side_by_side_and_the_still_is_the_end(short: list[str], tmp_path: Path) -> None:
    pictures = []
    for words in (["--agent", AGENT, "--beside", "fixed_handbook"], ["--policy", "fixed_handbook"]):
        assert main([*short, *words, "--out", str(tmp_path / "still.png")]) == 0
        with Image.open(tmp_path / "still.png") as image:
            pictures.append(np.asarray(image))
    both, alone = pictures
    assert both.shape == (HEIGHT, 2 * WIDTH + 8, 3)
    assert np.array_equal(both[:, WIDTH + 8 :], alone)
    assert not np.array_equal(both[:, :WIDTH], alone)


def test_a_window_shows_it(short: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    assert main([*short, "--policy", "fixed_handbook", "--steps", "2", "--human"]) == 0
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonsense")
    assert main([*short, "--policy", "fixed_handbook", "--human"]) == 2
    assert "error: no window can be opened" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "causal"], "causal cannot be watched: only what acts on observations can"),
        (["--policy", "grid_search", "--seed", "-1"], "seed -1"),
        (["--policy", "grid_search", "--out", "cut.avi"], "cut.avi must end in one of .mp4, .gif, .png"),
    ],
)
def test_bad_input_gets_a_message(arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = [] if "--out" in arguments else ["--out", str(tmp_path / "cut.gif")]
    assert main([*arguments, *out]) == 2
    assert f"error: {message}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert main(["--policy", "grid_search", "--beside", "fixed_handbook", "--human"]) == 2
    assert "error: --human shows one policy" in capsys.readouterr().err
