"""A card says what the files and the results say."""

import hashlib
import shutil
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from baselines.policy_spec import PolicySpec, ScenarioId
from leaderboard import cards, page, policies
from leaderboard.__main__ import main
from leaderboard.agents import agent_file
from leaderboard.pieces import Piece, attempt
from leaderboard.policies import SUMS
from leaderboard.ranking import Leaderboard, rank
from leaderboard.result import Result, Task, result_folder, write_result
from tests.leaderboard.agents import onnx_agents
from tests.leaderboard.conftest import ENV_ID, on
from turning_env import Scenario

pytestmark = pytest.mark.slow  # exports and plays agents


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, task: Task) -> Path:
    """Two training seeds of one agent with their results, also on a split, and a rule."""
    project = tmp_path_factory.mktemp("project")
    home = task.model_copy(update={"scenario": onnx_agents.SCENARIO})
    harder = Scenario.load("harder_lot")
    short_and_harder = harder.model_copy(update={"control": onnx_agents.SCENARIO.control})
    split = task.model_copy(update={"scenario": short_and_harder, "seeds": [5, 6]})
    agents = project / "agents" / ENV_ID / "short"
    paths = [onnx_agents.write(agents, seed, memory=True) for seed in (0, 1)]
    for one_task in (home, split):
        rule = policies.one_named("fixed_handbook", on(one_task.scenario))
        folder = result_folder(project / "results", ENV_ID, one_task.scenario.name)
        for policy in [*policies.agents(paths, on(one_task.scenario)), rule]:
            assert policy.tuned_for in (None, ScenarioId.of(home.scenario))
            write_result(result_of(policy, one_task), folder)
    return project


@pytest.fixture
def shipped(tmp_path: Path, played: Path) -> Path:
    """A copy of this project, which a test may change."""
    shutil.copytree(played, tmp_path, dirs_exist_ok=True)
    return tmp_path


def result_of(policy: PolicySpec, task: Task) -> Result:
    """Have a policy play a task."""
    return Result.of(task, policy, attempt(Piece(policy, task.scenario, task.seeds)))


def command(shipped: Path) -> list[str]:
    return ["cards", "--results", str(shipped / "results"), "--agents", str(shipped / "agents")]


def test_a_card_says_what_the_agent_is(shipped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(command(shipped)) == 0
    folder = shipped / "agents" / ENV_ID / "short"
    assert capsys.readouterr().out == f"wrote {folder / 'ppo.md'}\n"
    card = (folder / "ppo.md").read_text("utf-8")
    assert yaml.safe_load(card.split("---\n")[1])["model-index"][0]["name"] == "ppo"
    for seed in (0, 1):
        digest = hashlib.sha256((folder / f"ppo-seed{seed}.onnx").read_bytes()).hexdigest()
        assert f"| {seed} | `ppo-seed{seed}.onnx` | `{digest}` |\n" in card
    for statement in (
        onnx_agents.SCENARIO.digest(),
        "\ntrain it\ntrain it\n```",
        "| gamma | 0.8 |\n",
        "| Input | `memory` | environments x 7, float32 |",
        "4 held-out seeds, 2 training seeds",
        "| `harder_lot` | ",
    ):
        assert statement in card, statement


def test_the_program_on_a_card_loads_the_agent(shipped: Path) -> None:
    assert main(command(shipped)) == 0
    card = (shipped / "agents" / ENV_ID / "short" / "ppo.md").read_text("utf-8")
    _, _, rest = card.partition("```python\n")
    program, _, _ = rest.partition("```")
    names: dict[str, object] = {}
    exec(program, names)
    assert {"agent", "policy"} < names.keys()


def test_only_one_training_seed_must_be_there(shipped: Path) -> None:
    folder = shipped / "agents" / ENV_ID / "short"
    card = folder / "ppo.md"
    sums = shipped / "agents" / SUMS
    assert main(command(shipped)) == 0
    card_before = card.read_text("utf-8")
    sums_before = sums.read_text("utf-8")
    (folder / "ppo-seed1.onnx").unlink()
    assert main(command(shipped)) == 0
    assert card.read_text("utf-8") == card_before
    assert sums.read_text("utf-8") == sums_before


def test_cards_without_results_are_refused(
    shipped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shipped / "agents" / ENV_ID / "short"
    (shipped / "results" / ENV_ID / "short" / "ppo-seed1.json.xz").unlink()
    assert main(command(shipped)) == 2
    assert "ppo-seed1.onnx has no results" in capsys.readouterr().err
    (folder / "ppo-seed1.onnx").rename(folder / "ppo-seed7.onnx")
    assert main(command(shipped)) == 2
    complaint = f"holds ppo-seed1 and should be at {ENV_ID}/short/ppo-seed1.onnx"
    assert complaint in capsys.readouterr().err
    for path in folder.iterdir():
        path.unlink()
    assert main(command(shipped)) == 2
    assert "holds no agents" in capsys.readouterr().err


HOSTILE = {
    "script": "<script>alert(1)</script>",
    "<b>name</b>": "a | b | c",
    "link": "[click](javascript:alert(1)) ![x](http://example.org/x.png) http://example.org",
    "fence": "``` `code` ~~~",
    "lines": "one\n\n# Heading\n| a | b |\n\x1b[2J",
    "list": ["<i>", "](x)", 64],
    "long": 1_000_000 * "x",
}


class HostileAgent(NamedTuple):
    """An agent whose file states hostile parameters, and its results."""

    file: agent_file.AgentFile
    policy: PolicySpec
    board: Leaderboard
    folder: Path


@pytest.fixture
def hostile(tmp_path: Path, task: Task) -> HostileAgent:
    folder = tmp_path / "agents" / ENV_ID / "short"
    path = onnx_agents.write(folder, memory=True)
    home = task.model_copy(update={"scenario": onnx_agents.SCENARIO})
    (policy,) = policies.agents([path], home)
    stated = {
        "command": "python -m train.ppo\n```\n<script>" + 1_000_000 * "y",
        "parameters": HOSTILE,
    }
    # Changed after playing, as the parameters of a file decide how it plays.
    result = result_of(policy, home)
    hostile_policy = policy.model_copy(update=stated)
    hostile_result = Result.of(home, hostile_policy, arrays_of(result))
    file = agent_file.read(path)
    changes = {"parameters": HOSTILE, "versions": {"<u>": "`|`"}}
    metadata = file.metadata.model_copy(update=changes)
    return HostileAgent(
        file=replace(file, metadata=metadata),
        policy=hostile_policy,
        board=Leaderboard(home, [hostile_result], rank([hostile_result]), None, []),
        folder=folder,
    )


def arrays_of(result: Result) -> dict[str, NDArray[np.float64]]:
    return {name: np.array(values) for name, values in result.episodes.items()}


def test_a_card_shows_hostile_parameters_short_and_without_markup(hostile: HostileAgent) -> None:
    card = cards.render(hostile.file, [hostile.policy], hostile.board, None, hostile.folder)
    before, _, rest = card.partition("````bash\n")
    code, _, after = rest.partition("\n````\n")
    assert code.startswith("python -m train.ppo")
    assert "\n" not in code
    for markup in ("<script", "<b>", "<i>", "<u>", "](", "![", "http:", "\x1b", "# Heading\n"):
        assert markup not in before + after, markup
    assert len(card) < 20_000
    assert "1,000,000 characters" in card
    escaped = [line for line in card.splitlines() if line.startswith("| ") and "&#" in line]
    assert escaped
    for row in escaped:
        assert row.count("|") == 3, row


def test_a_page_shows_hostile_parameters_short_and_without_markup(hostile: HostileAgent) -> None:
    html = page.render([hostile.board])
    empty = Leaderboard(hostile.board.task, [], [], None, [])
    assert len(html) < len(page.render([empty])) + 30_000
    assert "<script>alert" not in html
