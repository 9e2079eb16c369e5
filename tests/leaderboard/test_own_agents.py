"""One's own agents: ranked beside those that come with the project, marked, limited in time."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from leaderboard import policies as leaderboard_policies
from leaderboard import result
from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Task, result_folder
from tests.leaderboard.conftest import ENV_ID, on, only, play_all
from tests.train import onnx_agents
from turning_env import Scenario
from turning_env.scoring.seeds import held_out_seeds

SHORT = onnx_agents.SCENARIO
pytestmark = pytest.mark.slow  # plays agents in processes of their own


@pytest.fixture
def words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A run on a project that comes with a rule's and an agent's results."""
    path = onnx_agents.write(result_folder(tmp_path / "agents", ENV_ID, SHORT.name), memory=True)
    monkeypatch.setattr(leaderboard_policies, "AGENTS", tmp_path / "agents")
    monkeypatch.setattr(result, "RESULTS", tmp_path / "shipped")
    monkeypatch.setattr(
        leaderboard_policies, "shipped_agents", leaderboard_policies.shipped_agents.__wrapped__
    )
    policies = [
        leaderboard_policies.one_named("fixed_handbook", on(SHORT)),
        *leaderboard_policies.agents([path], on(SHORT)),
    ]
    task = Task(env_id=ENV_ID, scenario=SHORT, seeds=held_out_seeds(2))
    play_all(task, policies, result_folder(result.RESULTS, ENV_ID, SHORT.name))
    SHORT.save(tmp_path / "short.toml")
    where = ["--scenario", str(tmp_path / "short.toml"), "--results", str(tmp_path / "results")]
    return ["run", *where, "--seeds", "2", "--policies"]


def test_an_own_agent_stands_beside_the_shipped_one(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine, folder = (
        onnx_agents.write(tmp_path / "mine"),
        result_folder(tmp_path / "results", ENV_ID, SHORT.name),
    )
    (theirs,) = leaderboard_policies.AGENTS.glob("*/*/*.onnx")
    assert main([*words, "--agents", str(mine), str(theirs)]) == 0
    told = capsys.readouterr()
    own = {standing.name: standing.own for standing in read_leaderboard(folder).standings}
    assert own == {"fixed_handbook": False, "ppo": False, "my_ppo": True}
    assert "my_ppo (yours)" in told.out
    places = [line.partition(": rank ") for line in told.out.splitlines()[-2:]]
    assert [whose for whose, _, _ in places] == ["agent that ships with the project", "your agent"]
    assert all(" of 3, return " in place for _, _, place in places)
    assert "ppo comes with the project; --name" in told.err
    assert (tmp_path / "results" / "index.html").read_text("utf-8").count(">yours<") == 1
    before = (folder / "ppo-seed0.json.xz").read_bytes()
    assert (
        before
        == (result_folder(result.RESULTS, ENV_ID, SHORT.name) / "ppo-seed0.json.xz").read_bytes()
    )
    where = [
        "--results",
        str(tmp_path / "results"),
        "--agents",
        str(mine.parent),
        "--memory",
        str(tmp_path / "verified.json"),
    ]
    assert main(["verify", *where, "--policies", "my_ppo"]) == 0
    assert main([*words, "--agents", str(mine), "--name", "second"]) == 0
    assert {"my_ppo", "second", "ppo"} <= {
        standing.name for standing in read_leaderboard(folder).standings
    }


def test_names_that_clash_are_refused_with_advice(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine, other = (onnx_agents.write(tmp_path / name) for name in ("mine", "other"))
    for name in ("ppo", "grid_search", "causal"):
        assert main([*words, "--agents", str(mine), "--name", name]) == 2
        assert "choose another --name" in capsys.readouterr().err
    assert not (tmp_path / "results").exists()
    assert main([*words, "--agents", str(mine), str(other), "--name", "both"]) == 2
    assert f"{mine} is both-seed0 too" in capsys.readouterr().err


def test_an_agent_that_takes_too_long_is_skipped(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "slow.onnx"
    path.write_bytes(onnx_agents.toiling(products=60, size=400))
    assert main([*words, "fixed_handbook", "--agent-time", "1", "--agents", str(path)]) == 2
    told = capsys.readouterr()
    assert "slow-seed0 cannot play: needs more than the 1 s of processor time" in told.err
    assert "fixed_handbook" in told.out
    assert (tmp_path / "results" / "index.html").exists()


def test_rules_that_are_not_tuned_are_skipped(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my lathe.toml"
    Scenario.model_validate({"name": "mine", "control": {"time_limit": 0.3}}).save(path)
    words[2] = str(path)
    assert main([*words, "fixed_tuned", "fixed_handbook"]) == 0
    advice = f"python -m baselines.tune --scenario '{path}'"
    assert advice in capsys.readouterr().err
    assert main([*words, "fixed_tuned"]) == 2
    assert "nothing to play" in capsys.readouterr().err


def test_code_of_ones_own_is_ranked_and_played_again_each_time(
    words: list[str], tmp_path: Path, monkeypatch, capsys
) -> None:
    path = result_folder(tmp_path / "results", ENV_ID, SHORT.name) / "mine-seed0.json.xz"
    returns = []
    for speed in (0.0, 1.0):
        policy = SimpleNamespace(
            steady=lambda observations, speed=speed: [[speed] * 2] * len(observations)
        )
        monkeypatch.setitem(sys.modules, "some_policy", policy)
        assert main([*words, "--policy", "some_policy:steady", "--name", "mine"]) == 0
        last = capsys.readouterr().out.splitlines()[-1]
        assert last.startswith("your agent: rank ")
        assert "mine on" in last
        returns.append(only(path).episodes["return"])
    assert returns[0] != returns[1]
    assert main([*words, "--policy", "some_policy:nothing"]) == 2
