"""The gallery: metrics of episodes made by hand, pictures that apply, and the command line."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leaderboard import gallery
from leaderboard.__main__ import main
from leaderboard.gallery import METRICS, Episode, by_life_stage, measure
from leaderboard.result import ResultError
from tests.leaderboard.conftest import Steady
from turning_env import Scenario
from turning_env.scoring.policy import PolicySpec

BAR = {"bar_length": 100.0, "approach": 5.0}
MakeEpisode = Callable[..., Episode]


def steady(name: str = "steady", action: tuple[float, ...] = (0.0, 0.0), **values: Any) -> PolicySpec:
    return PolicySpec(name=name, make=lambda num_envs: Steady(num_envs, action), **values)  # type: ignore[arg-type]


@pytest.fixture
def make_episode() -> MakeEpisode:
    """An episode along three bars, in steps of 5 mm and a second, at 100 m/min and 0.2 mm/rev but for what is given."""

    def make(**series: Any) -> Episode:
        path = np.arange(5.0, 3 * 105.0 + 0.1, 5.0)
        metal = (path % 105.0 > 5.0) | (path % 105.0 == 0.0)
        plain = {
            "path": path,
            "minutes": np.arange(1, len(path) + 1) / 60.0,
            "depth_of_cut": 2.5 * metal,
            "hardness": 1.0 * metal,
            "cutting_speed": 100.0,
            "feed": 0.2,
            "thrust_force": 750.0 * metal,
            "power": 3.5 * metal,
            "used_life": np.linspace(0.0, 1.0, len(path)),
            "engaged_time": 1.0 * metal,
            "removed": 2.0 * metal,
            "edges_used": 1.0 / len(path),
            "overload_time": 0.0,
            "severe_overload_time": 0.0,
        }
        scenario = Scenario.model_validate({"workpiece": BAR})
        return Episode(7, scenario, {name: np.broadcast_to(values, path.shape) for name, values in (plain | series).items()})

    return make


def test_metrics_count_used_edges_and_cutting_time(make_episode: MakeEpisode) -> None:
    episode, half = make_episode(), make_episode(edges_used=0.5 / 63)
    over = np.where((np.arange(63) >= 10) & (np.arange(63) < 16), 1.0, 0.0)
    metrics = measure([episode])
    assert (metrics["minutes_per_edge"], metrics["removed_per_edge"]) == pytest.approx((63 / 60, 2.0 * 60))
    assert measure([episode, half])["minutes_per_edge"] == pytest.approx(2 * 63 / 60 / 1.5)
    assert math.isnan(measure([make_episode(edges_used=0.0)])["minutes_per_edge"])
    metrics = measure([make_episode(overload_time=over, severe_overload_time=0.5 * over), episode])
    assert (metrics["overload_share"], metrics["severe_overload_share"]) == pytest.approx((100 * 6 / 120, 100 * 3 / 120))


def test_stages_are_of_life_and_weighted_by_cutting_time(make_episode: MakeEpisode) -> None:
    used = np.where(np.arange(63) < 42, 0.1, 0.9)
    episode = make_episode(used_life=used, cutting_speed=np.where(used < 0.5, 150.0, 190.0))
    np.testing.assert_allclose(by_life_stage([episode], "cutting_speed"), [150.0, np.nan, np.nan, np.nan, 190.0])
    metrics = measure([episode])
    assert (metrics["first_cutting_speed"], metrics["last_cutting_speed"]) == (150.0, 190.0)
    engaged = episode.cutting * np.where(np.arange(63) == 1, 3.0, 1.0)  # path 10 mm, in metal
    weighted = make_episode(used_life=used, feed=np.arange(63.0), engaged_time=engaged)
    in_metal = np.flatnonzero(episode.cutting & (used < 0.5))
    assert measure([weighted])["first_feed"] == pytest.approx((in_metal.sum() + 2 * 1) / (len(in_metal) + 2))


@pytest.mark.slow
def test_pictures_are_drawn_if_they_apply(make_episode: MakeEpisode, tmp_path: Path) -> None:
    played = {"one": [make_episode(), make_episode()], "two": [make_episode(power=8.0)]}
    written = gallery.write(played, tmp_path / "new")
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(gallery.PICTURES)
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)
    batch = Scenario.load("batch_casting")  # its steps are whole parts
    played = gallery.play([steady(action=(0.0,) * (2 + 2 * batch.control.passes_max))], batch, [7])
    assert gallery.write(played, tmp_path / "batch") == []


@pytest.mark.parametrize(
    ("policies", "message"),
    [
        ([], "nothing to draw"),
        ([steady(f"p{number}") for number in range(7)], r"7 policies .* at most 6"),
        ([steady("causal", kind="oracle")], "causal cannot be drawn"),
        ([steady("wrong", (math.nan, 0.0))], "wrong cannot play"),
    ],
)
def test_what_cannot_be_drawn_is_refused(scenario: Scenario, policies: list[PolicySpec], message: str) -> None:
    with pytest.raises(ResultError, match=message):
        gallery.play(policies, scenario, [7])


@pytest.mark.slow
def test_command(scenario: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario.save(tmp_path / "short.toml")
    common = ["gallery", "--scenario", str(tmp_path / "short.toml"), "--seeds", "1", "--out", str(tmp_path / "pictures")]
    assert main([*common, "--policies", "fixed_handbook"]) == 0
    printed = capsys.readouterr().out
    assert all(heading in printed for heading, _ in METRICS.values())
    assert "not drawn, as no policy shows it: bars.png" in printed
    assert main([*common, "--policies", "fixed_handbook", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["seeds"] == [2_000_000_000]
    assert data["policies"]["fixed_handbook"].keys() == METRICS.keys()
