"""One's own agents: ranked beside those that come with the project, marked, limited in time."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from leaderboard import policies as leaderboard_policies
from leaderboard import result, score
from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Task, result_folder
from leaderboard.seeds import held_out_seeds
from tests.leaderboard.agents import onnx_agents
from tests.leaderboard.conftest import ENV_ID, on, only, play_all
from turning_env import Scenario

SHORT = onnx_agents.SCENARIO
pytestmark = pytest.mark.slow  # plays agents in processes of their own


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The agents and results that a project comes with: an agent, and results of it and a rule."""
    folder = tmp_path_factory.mktemp("project")
    path = onnx_agents.write(result_folder(folder / "agents", ENV_ID, SHORT.name), memory=True)
    rule = leaderboard_policies.one_named("fixed_handbook", on(SHORT))
    task = Task(env_id=ENV_ID, scenario=SHORT, seeds=held_out_seeds(2))
    with pytest.MonkeyPatch.context() as patched:
        come_with(folder, patched)
        agents = leaderboard_policies.agents([path], on(SHORT))
        play_all(task, [rule, *agents], result_folder(result.RESULTS, ENV_ID, SHORT.name))
    return folder


def come_with(folder: Path, patched: pytest.MonkeyPatch) -> None:
    """Let the agents and results of a folder be those that the project comes with."""
    patched.setattr(leaderboard_policies, "AGENTS", folder / "agents")
    patched.setattr(leaderboard_policies, "shipped_agents", shipped_agents)
    patched.setattr(result, "RESULTS", folder / "shipped")


@pytest.fixture
def words(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A run on the project."""
    come_with(project, monkeypatch)
    SHORT.save(tmp_path / "short.toml")
    where = ["--scenario", str(tmp_path / "short.toml"), "--results", str(tmp_path / "results")]
    return ["run", *where, "--seeds", "2", "--policies"]


def shipped_agents() -> dict[str, str]:
    """Return the agents that the project of a test comes with, by SHA-256."""
    files = leaderboard_policies.agent_files(leaderboard_policies.AGENTS)
    return dict.fromkeys(files, "ppo")


def folder_in(results: Path) -> Path:
    return result_folder(results, ENV_ID, SHORT.name)


def test_an_own_agent_stands_beside_the_shipped_one(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = onnx_agents.write(tmp_path / "mine")
    folder = folder_in(tmp_path / "results")
    (shipped,) = leaderboard_policies.AGENTS.glob("*/*/*.onnx")
    assert main([*words, "--agents", str(mine), str(shipped)]) == 0
    captured = capsys.readouterr()
    own = {standing.name: standing.about.own for standing in read_leaderboard(folder).standings}
    assert own == {"fixed_handbook": False, "ppo": False, "my_ppo": True}
    assert "my_ppo (yours)" in captured.out
    assert "ppo comes with the project; --name" in captured.err
    # The place and the merit of either agent, an empty line, and the file that was written.
    shipped_place, _, own_place, own_merit, _, written = captured.out.splitlines()[-6:]
    assert shipped_place.startswith("agent that ships with the project: rank ")
    assert own_place.startswith("your agent: rank ")
    for place in (shipped_place, own_place):
        assert " of 3, return " in place
    assert "feasib" in own_merit
    assert " over the best rule, fixed_handbook" in own_merit
    page = tmp_path / "results" / "index.html"
    assert written == f"wrote {page}"
    assert page.read_text("utf-8").count(">yours<") == 1

    # The result that ships is copied, not played again.
    copied = folder / "ppo-seed0.json.xz"
    original = folder_in(result.RESULTS) / copied.name
    assert copied.read_bytes() == original.read_bytes()


def test_an_own_agent_is_verified_and_takes_another_name(words: list[str], tmp_path: Path) -> None:
    mine = onnx_agents.write(tmp_path / "mine")
    results = tmp_path / "results"
    assert main([*words, "--agents", str(mine)]) == 0
    verify = ["verify", "--results", str(results), "--agents", str(mine.parent)]
    memory = ["--memory", str(tmp_path / "verified.json")]
    assert main([*verify, *memory, "--policies", "my_ppo"]) == 0
    assert main([*words, "--agents", str(mine), "--name", "second"]) == 0
    names = {standing.name for standing in read_leaderboard(folder_in(results)).standings}
    assert {"my_ppo", "second", "ppo"} <= names


def test_names_that_clash_are_refused_with_advice(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = onnx_agents.write(tmp_path / "mine")
    for name in ("ppo", "grid_search", "causal"):
        assert main([*words, "--agents", str(mine), "--name", name]) == 2
        assert "choose another --name" in capsys.readouterr().err
    assert not (tmp_path / "results").exists()

    other = onnx_agents.write(tmp_path / "other")
    assert main([*words, "--agents", str(mine), str(other), "--name", "both"]) == 2
    assert f"{mine} is both-seed0 too" in capsys.readouterr().err


def test_an_agent_that_takes_too_long_is_skipped(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "slow.onnx"
    path.write_bytes(onnx_agents.toiling(products=60, size=400))
    assert main([*words, "fixed_handbook", "--agent-time", "1", "--agents", str(path)]) == 2
    captured = capsys.readouterr()
    assert "slow-seed0 cannot play: needs more than the 1 s of processor time" in captured.err
    assert "fixed_handbook" in captured.out
    assert (tmp_path / "results" / "index.html").exists()


def test_rules_that_are_not_tuned_are_skipped(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my lathe.toml"
    Scenario.model_validate({"name": "mine", "control": {"time_limit": 0.3}}).save(path)
    words[words.index("--scenario") + 1] = str(path)
    assert main([*words, "fixed_tuned", "fixed_handbook"]) == 0
    advice = f"python -m train.tune rules --scenario '{path}'"
    assert advice in capsys.readouterr().err
    assert main([*words, "fixed_tuned"]) == 2
    assert "nothing to play" in capsys.readouterr().err


def code_of_a_policy(speed: float) -> SimpleNamespace:
    """Return a module with a policy that always acts alike."""

    def steady(observations: list[object]) -> list[list[float]]:
        return [[speed, speed]] * len(observations)

    return SimpleNamespace(steady=steady)


def test_code_of_ones_own_is_ranked_and_played_again_each_time(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = folder_in(tmp_path / "results") / "mine-seed0.json.xz"
    returns = []
    for speed in (0.0, 1.0):
        monkeypatch.setitem(sys.modules, "some_policy", code_of_a_policy(speed))
        assert main([*words, "--policy", "some_policy:steady", "--name", "mine"]) == 0
        place, *_ = capsys.readouterr().out.splitlines()[-4:]
        assert place.startswith("your agent: rank ")
        assert "mine on" in place
        returns.append(only(path).episodes["return"])
    assert returns[0] != returns[1]
    assert main([*words, "--policy", "some_policy:nothing"]) == 2


def test_a_run_and_a_score_give_one_rank(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without --seeds, a run plays the seeds of the results that ship, as ``score`` does."""
    env_id = "RoughTurning-Override-v1"
    slow = SimpleNamespace(policy=lambda observations: np.full((len(observations), 1), -0.3))
    monkeypatch.setitem(sys.modules, "slow", slow)
    words = ["run", "--env", env_id, "--results", str(tmp_path / "results")]
    assert main([*words, "--policies", "idle", "--policy", "slow:policy"]) == 0
    scored = score("slow:policy", env_id)
    place, *_ = capsys.readouterr().out.splitlines()[-4:]
    assert place.startswith(f"your agent: rank {scored.rank} of {scored.ranked}, return ")
