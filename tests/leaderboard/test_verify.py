"""Rows that come back pass; whatever does not is named."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from leaderboard import oracles, run, verify
from leaderboard.__main__ import main
from leaderboard.contestants import Reference
from leaderboard.result import Result, Task, read_result, result_folder, result_path, write_part
from leaderboard.verify import Selection
from tests.leaderboard.conftest import ENV_ID, record_of
from tests.train import onnx_agents
from turning_env import Scenario
from turning_env.score.play import EPISODE_FIELDS, Episodes

EVERYTHING = Selection()
RULE = "fixed_handbook"


def bound(scenario: Scenario, draws: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
    return {name: np.array(draws, np.float64) for name in EPISODE_FIELDS}


@pytest.fixture
def shipped(tmp_path: Path, task: Task, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of rows and one of agents: a rule, a rule on a split, an agent, and a reference."""
    oracle = Reference(record_of("oracle").model_copy(update={"kind": "reference"}), bound)
    task = task.model_copy(update={"scenario": onnx_agents.SCENARIO})
    monkeypatch.setattr(references, "references", lambda scenario: [oracle] if scenario == task.scenario else [])
    split = Task(env_id=ENV_ID, scenario=Scenario.load("harder_lot"), draws=[5])
    path = onnx_agents.write(result_folder(tmp_path / "agents", ENV_ID, task.scenario.name))
    players = [
        (task, oracle),
        (task, run.rule(RULE, task.scenario)),
        (task, run.agent(path, task.scenario)),
        (split, run.rule(RULE, split.scenario, Scenario.load("rough_turning"))),
    ]
    for each, player in players:
        result = Result.of(each, player.policy, player.episodes(each.scenario, each.draws, lambda ended: None))
        write_part(result, result_path(result_folder(tmp_path / "rows", ENV_ID, each.scenario.name), player.policy))
    return tmp_path


def complaints(shipped: Path, selection: Selection = EVERYTHING, fresh: bool = True) -> list[str]:
    return verify.verify(shipped / "rows", shipped / "agents", selection, shipped / "verified.json", fresh)


def row(shipped: Path, label: str, scenario: str = "short") -> Path:
    return shipped / "rows" / ENV_ID / scenario / f"{label}.json.xz"


def rewrite(path: Path, **changes: object) -> None:
    write_part(read_result(path).model_copy(update=changes), path)


def test_what_was_played_comes_back(shipped: Path) -> None:
    assert complaints(shipped) == []


def test_a_changed_bit_is_found(shipped: Path) -> None:
    path = row(shipped, "ppo-seed0")
    episodes = read_result(path).episodes
    nudged = [*episodes["return"][:3], float(np.nextafter(episodes["return"][3], np.inf))]
    rewrite(path, episodes=episodes | {"return": nudged, "stopped_time": [-0.0] * 4})
    first, second = complaints(shipped)
    assert first.startswith(f"{path}: return differs on 1 of 4 draws, by up to ")
    assert 0 < float(first.split()[-1]) < 1e-10
    assert second == f"{path}: stopped_time differs on 4 of 4 draws, by up to 0"


def test_other_code_is_found(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("leaderboard.results.code_digest", lambda: "0" * 64)
    found = complaints(shipped)
    assert len(found) == 4
    assert all("is not of the present code: its digests of code, task are others" in complaint for complaint in found)


def test_other_presets_are_found(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    changed = Scenario.model_validate({"name": "harder_lot", "limits": {"power": 6.0}})
    load = Scenario.load
    monkeypatch.setattr(Scenario, "load", lambda source: changed if source == "harder_lot" else load(source))
    assert complaints(shipped) == [
        f"{row(shipped, RULE, 'harder_lot')}: is not of the present preset 'harder_lot': values differ"
    ]


def test_other_parameters_are_found(shipped: Path) -> None:
    path = row(shipped, RULE)
    policy = read_result(path).policy
    rewrite(path, policy=policy.model_copy(update={"parameters": {"cutting_speed": 1.0}}))
    assert complaints(shipped) == [f"{path}: {RULE} is no longer what played: parameters differ"]
    rewrite(path, policy=policy.model_copy(update={"name": "forgotten"}))
    path.rename(row(shipped, "forgotten"))
    assert "forgotten cannot play: no controller is called 'forgotten'" in complaints(shipped)[0]


def test_agents_without_file_or_row_are_found(shipped: Path) -> None:
    agents = shipped / "agents" / ENV_ID / "short"
    path = agents / "ppo-seed0.onnx"
    path.rename(agents / "ppo-seed1.onnx")
    assert complaints(shipped) == [
        f"{agents / 'ppo-seed1.onnx'}: has no row {row(shipped, 'ppo-seed1')}",
        f"{row(shipped, 'ppo-seed0')}: its agent's file is missing: {path}",
    ]
    assert complaints(shipped, Selection(policies=["ppo-seed1", "oracle"])) == complaints(shipped)[:1]
    assert complaints(shipped, Selection(policies=["oracle"])) == []
    onnx_agents.write(agents, seed=1).rename(path)
    (found,) = complaints(shipped, Selection(policies=["ppo"]))
    assert found == f"{row(shipped, 'ppo-seed0')}: ppo-seed0 is no longer what played: digest, training_seed differ"
    path.write_bytes(b"damaged")
    assert "is no ONNX file" in complaints(shipped)[0]


def test_references_that_are_gone_are_found(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(references, "references", lambda scenario: [])
    assert complaints(shipped) == [f"{row(shipped, 'oracle')}: there is no reference 'oracle' for scenario 'short'"]


def test_what_came_back_is_not_played_again(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played = []
    see = verify.differences
    monkeypatch.setattr(
        verify, "differences", lambda result, episodes: played.append(result.policy.name) or see(result, episodes)
    )
    assert complaints(shipped, Selection(scenario="short"), fresh=False) == []
    assert sorted(played) == [RULE, "oracle", "ppo"]
    assert complaints(shipped, fresh=False) == []
    assert played[3:] == [RULE]
    monkeypatch.setattr(verify, "present_versions", lambda: {"numpy": "0"})
    assert complaints(shipped, fresh=False) == []
    assert len(played) == 8
    # Only what came back is remembered.
    path = row(shipped, RULE)
    rewrite(path, episodes=read_result(path).episodes | {"wear": [0.0] * 4})
    for _ in range(2):
        assert len(complaints(shipped, fresh=False)) == 1


def test_a_quick_look_is_at_the_first_draws(shipped: Path) -> None:
    path = row(shipped, RULE)
    episodes = read_result(path).episodes
    rewrite(path, episodes=episodes | {"return": [*episodes["return"][:3], 0.0], "wear": [0.0, *episodes["wear"][1:]]})
    arguments = (shipped / "rows", shipped / "agents", EVERYTHING, shipped / "verified.json", False)
    (quick,) = verify.verify(*arguments, draws=2)
    assert quick.startswith(f"{path}: wear differs on 1 of 2 draws")
    assert not (shipped / "verified.json").exists()
    assert len(verify.verify(*arguments)) == 2


def test_command_line(shipped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["verify", "--rows", str(shipped / "rows"), "--agents", str(shipped / "agents")]
    arguments += ["--memory", str(shipped / "memory.json")]
    assert main(arguments) == 0
    assert capsys.readouterr().out == "every row came back bit for bit\n"
    assert len(json.loads((shipped / "memory.json").read_text())) == 4
    assert main([*arguments, "--draws", "1"]) == 0
    assert capsys.readouterr().out == "the start of every row came back bit for bit\n"
    row(shipped, RULE).write_bytes(b"damaged")
    assert main([*arguments, "--env", ENV_ID, "--scenario", "short", "--policies", RULE]) == 1
    assert "fixed_handbook.json.xz: " in capsys.readouterr().out
    assert main([*arguments, "--policies", "nonsense"]) == 2
    assert "holds no such rows" in capsys.readouterr().err
    for damage in ("{", "[" * 100_000):
        (shipped / "memory.json").write_text(damage)
        assert main(arguments) == 2
        assert "memory.json cannot be read" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*arguments, "--jobs", "0"])


def test_earning_too_much_is_found(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(references, "CLAIRVOYANT", "oracle")
    assert complaints(shipped) == []
    path = row(shipped, RULE)
    episodes = read_result(path).episodes
    rewrite(path, episodes=episodes | {"return": [*episodes["return"][:-1], 1e6]})
    found = [complaint for complaint in complaints(shipped) if "beyond" in complaint]
    assert len(found) == 1
    assert found[0].startswith(f"{path}: beyond the clairvoyant bound on 1 draws, by up to 99")
