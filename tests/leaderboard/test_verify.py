"""Results that come back pass; whatever does not is named."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baselines.comparators import CAUSAL
from baselines.policy_spec import PolicySpec
from leaderboard import policies, verify
from leaderboard.__main__ import main
from leaderboard.pieces import Piece, attempt
from leaderboard.policies import CLAIRVOYANT
from leaderboard.result import (
    MANIFEST_FILE,
    Result,
    Task,
    result_folder,
    write_manifest,
    write_result,
)
from leaderboard.verify import Draw, Selection
from tests.leaderboard.agents import onnx_agents
from tests.leaderboard.conftest import ENV_ID, MakeResult, on, only, spec
from turning_env import MODEL_VERSION, Scenario

RULE = "fixed_handbook"
SHORT = onnx_agents.SCENARIO
EVERYTHING = Selection()
ONE_RULE = Selection(scenario="short", policies=[RULE])


def fill(folder: Path, task: Task, policies: Sequence[PolicySpec]) -> None:
    """Play policies on a task, and write the results and the manifest below a folder."""
    results = result_folder(folder / "results", ENV_ID, task.scenario.name)
    for policy in policies:
        played = attempt(Piece(policy, task.scenario, task.seeds))
        write_result(Result.of(task, policy, played), results)
    write_manifest(results, task)


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, task: Task) -> Path:
    """A folder of results: a rule, a rule on a split, and an oracle."""
    folder = tmp_path_factory.mktemp("shipped")
    on_short = [policies.one_named(name, on(SHORT)) for name in (CAUSAL, RULE)]
    fill(folder, task.model_copy(update={"scenario": SHORT}), on_short)
    split = Task(env_id=ENV_ID, scenario=Scenario.load("harder_lot"), seeds=[5])
    rule = policies.one_named(RULE, split, tuned_on=Scenario.load("rough_turning"))
    fill(folder, split, [rule])
    return folder


@pytest.fixture
def shipped(tmp_path: Path, played: Path) -> Path:
    """A copy of these results that a test may damage."""
    shutil.copytree(played, tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.fixture
def with_agent(shipped: Path, task: Task) -> Path:
    """The same with an agent and its result."""
    path = onnx_agents.write(result_folder(shipped / "agents", ENV_ID, SHORT.name))
    agents = policies.agents([path], on(SHORT))
    fill(shipped, task.model_copy(update={"scenario": SHORT}), agents)
    return shipped


def complaints(
    shipped: Path, selection: Selection = EVERYTHING, draw: Draw | None = None
) -> list[str]:
    return verify.verify(
        shipped / "results", shipped / "agents", selection, shipped / "verified.json", draw
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
    """Write a result with other episodes, another model or a changed policy, and its manifest."""
    old = only(path)
    task = old.task.model_copy(update={"model_version": model_version})
    episodes = old.episodes | (new or {})
    arrays = {name: np.array(values) for name, values in episodes.items()}
    changed = Result.of(task, old.policy.model_copy(update=policy), arrays)
    path.unlink()
    write_result(changed, path.parent)
    write_manifest(path.parent, task)


@pytest.mark.slow
def test_a_changed_bit_is_found(with_agent: Path) -> None:
    path = file_of(with_agent, "ppo-seed0")
    returns = only(path).episodes["return"]
    nudged = [*returns[:3], float(np.nextafter(returns[3], np.inf))]
    rewrite(path, {"return": nudged, "stopped_time": [-0.0] * 4})
    assert checked(with_agent) == []
    about_return, about_zeros = complaints(with_agent)
    assert about_return.startswith(f"{place(path)}: return differs for 1 of 4 seeds, by up to ")
    assert 0 < float(about_return.split()[-1]) < 1e-10
    # Negative zeros are equal to zeros, but not bit for bit.
    assert about_zeros == f"{place(path)}: stopped_time differs for 4 of 4 seeds, by up to 0"


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        pytest.param(
            {"parameters": {"cutting_speed": 1.0}},
            f"{RULE} is no longer what played: parameters differ",
            id="parameters",
        ),
        pytest.param(
            {"version": 9},
            f"{RULE} is no longer what played: version differ",
            id="version",
        ),
        pytest.param(
            {"name": "forgotten"},
            "forgotten cannot play: no controller is called 'forgotten'",
            id="name",
        ),
        pytest.param(
            {"model_version": 0},
            f"was played with version 0 of the model, which is now {MODEL_VERSION}",
            id="model",
        ),
    ],
)
def test_other_rules_and_models_are_found(
    shipped: Path, changed: dict[str, Any], complaint: str
) -> None:
    rewrite(file_of(shipped, RULE), **changed)
    selection = Selection(scenario="short", policies=[RULE, "forgotten"])
    (checks,) = checked(shipped, selection)
    assert complaint in checks
    assert checks in complaints(shipped, selection)


def test_a_manifest_that_disagrees_is_found(shipped: Path) -> None:
    path = file_of(shipped, RULE)
    manifest = path.with_name(MANIFEST_FILE)
    before = manifest.read_text()
    rewrite(path, {"wear": [0.0] * 4})
    manifest.write_text(before)
    advice = "run python -m leaderboard run again"
    assert checked(shipped) == [
        f"{place(path)}: {MANIFEST_FILE} beside it says otherwise: {advice}"
    ]
    manifest.unlink()
    assert len(checked(shipped)) == 2


@pytest.mark.slow
def test_agents_without_file_or_result_are_found(with_agent: Path) -> None:
    agents = with_agent / "agents" / ENV_ID / "short"
    result = file_of(with_agent, "ppo-seed0")
    digest = only(result).policy.sha256
    (agents / "ppo-seed0.onnx").rename(agents / "another_name.onnx")
    assert checked(with_agent) == []
    (agents / "another_name.onnx").unlink()
    other = onnx_agents.write(agents, seed=1)
    unplayed = f"{other}: has no result in {result.parent}"
    gone = (
        f"{place(result)}: ppo-seed0 is no longer what played: none of the agents' files has its "
        "SHA-256"
    )
    assert checked(with_agent) == [gone, unplayed]
    assert complaints(with_agent, Selection(policies=["ppo-seed0"])) == [gone]
    assert checked(with_agent, Selection(policies=["ppo-seed1", CAUSAL])) == [unplayed]
    assert checked(with_agent, Selection(policies=[CAUSAL])) == []
    # A file that is published elsewhere is listed.
    other.unlink()
    sums = with_agent / "agents" / policies.SUMS
    sums.write_text(f"{digest}  {ENV_ID}/short/ppo-seed0.onnx\n")
    assert checked(with_agent) == []
    assert complaints(with_agent) == []


def test_a_forger_cannot_choose_the_seeds_of_a_quick_look(shipped: Path) -> None:
    path = file_of(shipped, RULE)
    episodes = only(path).episodes
    # The last seed's return is forged, and its episode made the longest.
    returns = [*episodes["return"][:-1], 0.0]
    steps = [*episodes["steps"][:-1], 1e6]
    rewrite(path, {"return": returns, "steps": steps})
    caught = 0
    for key in range(40):
        caught += 3 in Draw(1, key).places(only(path), is_bound=False)
    assert 2 <= caught <= 20  # 10 expected
    drawn = next(key for key in range(40) if 3 in Draw(1, key).places(only(path), False))
    about_return, about_steps = complaints(shipped, ONE_RULE, draw=Draw(1, drawn))
    assert about_return.startswith(f"{place(path)}: return differs for 1 of 1 seeds")
    assert about_steps.startswith(f"{place(path)}: steps differs for 1 of 1 seeds")


def test_a_draw_is_fresh_and_its_key_repeats_it(shipped: Path) -> None:
    result = only(file_of(shipped, RULE))
    draw = Draw.fresh(2)
    assert Draw.fresh(2).key != draw.key
    assert draw.places(result, False) == Draw(2, draw.key).places(result, False)
    assert len(draw.places(result, is_bound=False)) == 2
    assert len(draw.places(result, is_bound=True)) == 1
    assert Draw(9, 0).places(result, False) == [0, 1, 2, 3]


def test_a_quick_look_leaves_the_memory_of_an_interrupted_verification(shipped: Path) -> None:
    memory = shipped / "verified.json"
    assert complaints(shipped, ONE_RULE, draw=Draw.fresh(2)) == []
    assert not memory.exists()
    memory.write_text("[]")
    assert complaints(shipped, ONE_RULE, draw=Draw.fresh(2)) == []
    assert memory.exists()


@pytest.mark.slow
def test_command_line(with_agent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = ["--results", str(with_agent / "results"), "--agents", str(with_agent / "agents")]
    arguments = ["verify", *folders, "--memory", str(with_agent / "memory.json")]
    assert main(arguments) == 0
    assert capsys.readouterr().out == "every result came back\n"
    assert main([*arguments, "--seeds", "1"]) == 0
    printed = capsys.readouterr()
    assert printed.out == "the drawn seeds of every result came back\n"
    assert "--seeds 1 --draw " in printed.err
    assert main([*arguments, "--draw", "1"]) == 2
    assert "add --seeds" in capsys.readouterr().err
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
    on_short = task.model_copy(update={"scenario": SHORT})
    bound = spec(CLAIRVOYANT, kind="oracle")
    write_result(
        make_result(
            CLAIRVOYANT,
            policy=bound,
            on=on_short,
            returns=9.0,
        ),
        path.parent,
    )
    *returns, _ = only(path).episodes["return"]
    rewrite(path, {"return": [*returns, 1e6]})
    (beyond,) = [complaint for complaint in checked(shipped) if "beyond" in complaint]
    fault = "beyond the clairvoyant bound for 1 seeds, by up to 99"
    assert beyond.startswith(f"{place(path)}: {fault}")
