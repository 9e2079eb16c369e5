"""Results that come back pass; whatever does not is named."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leaderboard import policies, verify
from leaderboard.__main__ import main
from leaderboard.family import CAUSAL
from leaderboard.policies import CLAIRVOYANT
from leaderboard.result import (
    MANIFEST_FILE,
    Result,
    Task,
    result_folder,
    write_manifest,
    write_result,
)
from leaderboard.run import Piece, attempt
from leaderboard.verify import Selection
from tests.leaderboard.conftest import ENV_ID, MakeResult, on, only, spec
from tests.train import onnx_agents
from turning_env import MODEL_VERSION, Scenario
from turning_env.scoring.policy import PolicySpec

RULE = "fixed_handbook"
SHORT = onnx_agents.SCENARIO
EVERYTHING, ONE_RULE = Selection(), Selection(scenario="short", policies=[RULE])


def fill(folder: Path, on: Task, policies: Sequence[PolicySpec]) -> None:
    results = result_folder(folder / "results", ENV_ID, on.scenario.name)
    for policy in policies:
        write_result(Result.of(on, policy, attempt(Piece(policy, on.scenario, on.seeds))), results)
    write_manifest(results, on)


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, task: Task) -> Path:
    """A folder of results: a rule, a rule on a split, and an oracle."""
    folder = tmp_path_factory.mktemp("shipped")
    split = Task(env_id=ENV_ID, scenario=Scenario.load("harder_lot"), seeds=[5])
    fill(
        folder,
        task.model_copy(update={"scenario": SHORT}),
        [policies.one_named(name, on(SHORT)) for name in (CAUSAL, RULE)],
    )
    fill(
        folder,
        split,
        [policies.one_named(RULE, on(split.scenario), Scenario.load("rough_turning"))],
    )
    return folder


@pytest.fixture
def shipped(tmp_path: Path, played: Path) -> Path:
    shutil.copytree(played, tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.fixture
def with_agent(shipped: Path, task: Task) -> Path:
    path = onnx_agents.write(result_folder(shipped / "agents", ENV_ID, SHORT.name))
    fill(
        shipped,
        task.model_copy(update={"scenario": SHORT}),
        [policies.agents([path], on(SHORT))[0]],
    )
    return shipped


def complaints(
    shipped: Path, selection: Selection = EVERYTHING, seeds: int | None = None
) -> list[str]:
    return verify.verify(
        shipped / "results", shipped / "agents", selection, shipped / "verified.json", seeds
    )


def checked(shipped: Path, selection: Selection = EVERYTHING) -> list[str]:
    return verify.check(shipped / "results", shipped / "agents", selection)


def file_of(shipped: Path, label: str, scenario: str = "short") -> Path:
    return shipped / "results" / ENV_ID / scenario / f"{label}.json.xz"


def place(path: Path) -> str:
    """Return how a complaint names a policy's result."""
    return str(path).removesuffix(".json.xz")


def rewrite(
    path: Path,
    new: dict[str, list[float]] | None = None,
    model_version: int = MODEL_VERSION,
    **policy: Any,
) -> None:
    """Write a result with other episodes, another model or a changed policy, and the manifest that belongs to it."""
    old = only(path)
    task = old.task.model_copy(update={"model_version": model_version})
    changed = {name: np.array(values) for name, values in (old.episodes | (new or {})).items()}
    path.unlink()
    write_result(Result.of(task, old.policy.model_copy(update=policy), changed), path.parent)
    write_manifest(path.parent, task)


@pytest.mark.slow
def test_a_changed_bit_is_found(with_agent: Path) -> None:
    path = file_of(with_agent, "ppo-seed0")
    returns = only(path).episodes["return"]
    nudged = [*returns[:3], float(np.nextafter(returns[3], np.inf))]
    rewrite(path, {"return": nudged, "stopped_time": [-0.0] * 4})
    assert checked(with_agent) == []
    first, second = complaints(with_agent)
    assert first.startswith(f"{place(path)}: return differs for 1 of 4 seeds, by up to ")
    assert 0 < float(first.split()[-1]) < 1e-10
    assert second == f"{place(path)}: stopped_time differs for 4 of 4 seeds, by up to 0"


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        (
            {"parameters": {"cutting_speed": 1.0}},
            f"{RULE} is no longer what played: parameters differ",
        ),
        ({"version": 9}, f"{RULE} is no longer what played: version differ"),
        ({"name": "forgotten"}, "forgotten cannot play: no controller is called 'forgotten'"),
        (
            {"model_version": 0},
            f"was played with version 0 of the model, which is now {MODEL_VERSION}",
        ),
    ],
)
def test_other_rules_and_models_are_found(
    shipped: Path, changed: dict[str, Any], complaint: str
) -> None:
    rewrite(file_of(shipped, RULE), **changed)
    selection = Selection(scenario="short", policies=[RULE, "forgotten"])
    (found,) = checked(shipped, selection)
    assert complaint in found
    assert found in complaints(shipped, selection)


def test_a_manifest_that_disagrees_is_found(shipped: Path) -> None:
    path = file_of(shipped, RULE)
    manifest = path.with_name(MANIFEST_FILE)
    before = manifest.read_text()
    rewrite(path, {"wear": [0.0] * 4})
    manifest.write_text(before)
    assert checked(shipped) == [
        f"{place(path)}: {MANIFEST_FILE} beside it says otherwise: run python -m leaderboard run again"
    ]
    manifest.unlink()
    assert len(checked(shipped)) == 2


@pytest.mark.slow
def test_agents_without_file_or_result_are_found(with_agent: Path) -> None:
    agents, result = with_agent / "agents" / ENV_ID / "short", file_of(with_agent, "ppo-seed0")
    (agents / "ppo-seed0.onnx").rename(agents / "another_name.onnx")
    assert checked(with_agent) == []
    (agents / "another_name.onnx").unlink()
    other = onnx_agents.write(agents, seed=1)
    unplayed = f"{other}: has no result in {result.parent}"
    gone = f"{place(result)}: ppo-seed0 is no longer what played: none of the agents' files has its SHA-256"
    assert checked(with_agent) == [gone, unplayed]
    assert complaints(with_agent, Selection(policies=["ppo-seed0"])) == [gone]
    assert checked(with_agent, Selection(policies=["ppo-seed1", CAUSAL])) == [unplayed]
    assert checked(with_agent, Selection(policies=[CAUSAL])) == []
    other.unlink()
    line = f"{only(result).policy.sha256}  {ENV_ID}/short/ppo-seed0.onnx\n"
    (with_agent / "agents" / policies.SUMS).write_text(line)  # published elsewhere
    assert complaints(with_agent) == checked(with_agent) == []


def test_a_quick_look_is_at_the_shortest_episodes(shipped: Path) -> None:
    path = file_of(shipped, RULE)
    episodes = {name: np.array(values) for name, values in only(path).episodes.items()}
    by_length = np.argsort(episodes["steps"], kind="stable")
    episodes["wear"][by_length[0]] = episodes["return"][by_length[3]] = 0.0
    rewrite(path, {name: episodes[name].tolist() for name in ("return", "wear")})
    (quick,) = complaints(shipped, ONE_RULE, seeds=2)
    assert quick.startswith(f"{place(path)}: wear differs for 1 of 2 seeds")
    assert not (shipped / "verified.json").exists()
    (shipped / "verified.json").write_text("[]")  # of a verification that was interrupted
    complaints(shipped, ONE_RULE, seeds=2)
    assert (shipped / "verified.json").exists()
    assert len(complaints(shipped, ONE_RULE)) == 2


@pytest.mark.slow
def test_command_line(with_agent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = ["--results", str(with_agent / "results"), "--agents", str(with_agent / "agents")]
    arguments = ["verify", *folders, "--memory", str(with_agent / "memory.json")]
    quick = "the shortest episodes of every result came back\n"
    for option, said in (([], "every result came back\n"), (["--seeds", "1"], quick)):
        assert main([*arguments, *option]) == 0
        assert capsys.readouterr().out == said
    assert main([*arguments, "--check"]) == 0
    assert capsys.readouterr().out == "every result is valid\n"
    assert main([*arguments, "--policies", "nonsense"]) == 2
    assert "holds no such results" in capsys.readouterr().err
    file_of(with_agent, RULE).write_bytes(b"damaged")
    assert main([*arguments, "--env", ENV_ID, "--scenario", "short", "--policies", RULE]) == 1
    assert "fixed_handbook.json.xz cannot be read" in capsys.readouterr().out
    (with_agent / "memory.json").write_text("{")
    assert main(arguments) == 2
    assert "memory.json cannot be read" in capsys.readouterr().err


def test_earning_too_much_is_found(shipped: Path, task: Task, make_result: MakeResult) -> None:
    path = file_of(shipped, RULE)
    own = task.model_copy(update={"scenario": SHORT})
    write_result(
        make_result(CLAIRVOYANT, policy=spec(CLAIRVOYANT, kind="oracle"), on=own, returns=9.0),
        path.parent,
    )
    rewrite(path, {"return": [*only(path).episodes["return"][:-1], 1e6]})
    (found,) = [complaint for complaint in checked(shipped) if "beyond" in complaint]
    assert found.startswith(f"{place(path)}: beyond the clairvoyant bound for 1 seeds, by up to 99")
