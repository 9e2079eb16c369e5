"""A card says what the files and the results say."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from leaderboard import cards, page, policies
from leaderboard.__main__ import main
from leaderboard.policies import SUMS
from leaderboard.ranking import Leaderboard
from leaderboard.result import Result, Task, result_folder, write_result
from leaderboard.run import Piece, attempt
from leaderboard.standings import rank
from tests.leaderboard.conftest import ENV_ID, on
from tests.train import onnx_agents
from train.agents import agent_file
from turning_env import Scenario
from turning_env.scoring.policy import ScenarioId

pytestmark = pytest.mark.slow  # exports and plays agents


@pytest.fixture
def shipped(tmp_path: Path, task: Task) -> Path:
    """Two training seeds of one agent with their results, also on a split, and a rule."""
    own = task.model_copy(update={"scenario": onnx_agents.SCENARIO})
    short_split = Scenario.load("harder_lot").model_copy(
        update={"control": onnx_agents.SCENARIO.control}
    )
    split = task.model_copy(update={"scenario": short_split, "seeds": [5, 6]})
    paths = [
        onnx_agents.write(tmp_path / "agents" / ENV_ID / "short", seed, memory=True)
        for seed in (0, 1)
    ]
    for each in (own, split):
        for policy in [
            *policies.agents(paths, on(each.scenario)),
            policies.one_named("fixed_handbook", on(each.scenario)),
        ]:
            assert policy.tuned_for in (None, ScenarioId.of(own.scenario))
            result = Result.of(each, policy, attempt(Piece(policy, each.scenario, each.seeds)))
            write_result(result, result_folder(tmp_path / "results", ENV_ID, each.scenario.name))
    return tmp_path


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
    for said in (
        onnx_agents.SCENARIO.digest(),
        "\ntrain it\ntrain it\n```",
        "| gamma | 0.8 |\n",
        "| Input | `memory` | environments x 7, float32 |",
        "4 held-out seeds, 2 training seeds",
        "| `harder_lot` | ",
    ):
        assert said in card, said
    program = card[card.index("```python\n") + 10 : card.rindex("```")]
    names: dict[str, object] = {}
    exec(program, names)
    assert {"agent", "policy"} < names.keys()


def test_only_one_training_seed_must_be_there(shipped: Path) -> None:
    folder = shipped / "agents" / ENV_ID / "short"
    written = folder / "ppo.md", shipped / "agents" / SUMS
    assert main(command(shipped)) == 0
    before = [path.read_text("utf-8") for path in written]
    (folder / "ppo-seed1.onnx").unlink()
    assert main(command(shipped)) == 0
    assert [path.read_text("utf-8") for path in written] == before


def test_cards_without_results_are_refused(
    shipped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shipped / "agents" / ENV_ID / "short"
    (shipped / "results" / ENV_ID / "short" / "ppo-seed1.json.xz").unlink()
    assert main(command(shipped)) == 2
    assert "ppo-seed1.onnx has no results" in capsys.readouterr().err
    (folder / "ppo-seed1.onnx").rename(folder / "ppo-seed7.onnx")
    assert main(command(shipped)) == 2
    assert (
        f"holds ppo-seed1 and should be at {ENV_ID}/short/ppo-seed1.onnx" in capsys.readouterr().err
    )
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


def test_parameters_of_a_hostile_agent_are_short_and_no_markup(
    tmp_path: Path, task: Task, monkeypatch
) -> None:
    folder = tmp_path / "agents" / ENV_ID / "short"
    path = onnx_agents.write(folder, memory=True)
    command = "python -m train.ppo\n```\n<script>" + 1_000_000 * "y"
    own = task.model_copy(update={"scenario": onnx_agents.SCENARIO})
    (policy,) = policies.agents([path], own)
    hostile = policy.model_copy(update={"command": command, "parameters": HOSTILE})
    played = Result.of(own, hostile, attempt(Piece(policy, own.scenario, own.seeds)))
    board = Leaderboard(own, [played], rank([played]), None, [])
    file = agent_file.read(path)
    metadata = file.metadata.model_copy(update={"parameters": HOSTILE, "versions": {"<u>": "`|`"}})
    card = cards.render(replace(file, metadata=metadata), [hostile], board, None, folder)
    before, _, rest = card.partition("````bash\n")
    code, _, after = rest.partition("\n````\n")
    assert code.startswith("python -m train.ppo")
    assert "\n" not in code
    for markup in ("<script", "<b>", "<i>", "<u>", "](", "![", "http:", "\x1b", "# Heading\n"):
        assert markup not in before + after, markup
    assert len(card) < 20_000
    assert "1,000,000 characters" in card
    tables = [line for line in card.splitlines() if line.startswith("| ") and "&#" in line]
    assert all(line.count("|") == 3 for line in tables)
    html = page.render([board])
    assert len(html) < len(page.render([Leaderboard(own, [], [], None, [])])) + 30_000
    assert "<script>alert" not in html
