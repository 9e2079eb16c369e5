"""What comes with the project: agents, their cards, and rows that come back, say what is claimed and keep to the bound."""

from pathlib import Path

import pytest

from baselines.catalogue import names
from leaderboard import verify
from leaderboard.board import read_board
from leaderboard.oracles import CLAIRVOYANT, references
from leaderboard.result import SUFFIX, result_files
from leaderboard.verify import Selection
from train.agents import onnx_policy
from turning_env import IDS, SPLITS, Scenario

ROOT = Path(__file__).parents[2]
ROWS, AGENTS = ROOT / "leaderboard" / "results", ROOT / "agents"
FILES = sorted(AGENTS.glob("*/*/*.onnx"))
BEST = "analytic_gradient"


def complaints(
    tmp_path: Path, draws: int, *policies: str, env: str = "RoughTurning-v0", scenario: str | None = None
) -> list[str]:
    return verify.verify(ROWS, AGENTS, Selection(env, scenario, list(policies)), tmp_path / "memory.json", False, draws)


def test_the_first_draws_of_rows_come_back(tmp_path: Path) -> None:
    agents = ("ppo-seed0", "recurrent_ppo-seed1", "lagrangian_ppo-seed2", "sac-seed3", "tqc-seed4", f"{BEST}-seed0")
    quick = ("fixed_tuned", "grid_search", "rescaled_grid_search", *agents)
    assert complaints(tmp_path, 2, *quick, scenario="rough_turning") == []
    assert complaints(tmp_path, 1, CLAIRVOYANT, "causal", "predictive", scenario="rough_turning") == []
    assert complaints(tmp_path, 1, "rescaled_grid_search", f"{BEST}-seed1", scenario="ck45") == []
    assert complaints(tmp_path, 1, "omative", f"{BEST}-seed2", env="RoughTurning-Override-v0") == []
    assert complaints(tmp_path, 1, "constant_force", "ppo-seed3", env="RoughTurning-Surface-v0") == []
    assert complaints(tmp_path, 2, "parts_mt", "ppo-seed4", env="RoughTurning-Batch-v0") == []


def test_no_row_is_beyond_the_clairvoyant_bound() -> None:
    paths = [path for folder in ROWS.glob("*/*") for path in result_files(folder)]
    assert sum(path.name == f"{CLAIRVOYANT}{SUFFIX}" for path in paths) >= 2 + len(SPLITS)
    assert list(verify._beyond_the_bound(paths)) == []


def test_the_best_agent_is_what_is_claimed() -> None:
    board = read_board(ROWS / "RoughTurning-v0" / "rough_turning")
    standings = {standing.name: standing for standing in board.standings}
    best = standings[BEST]
    assert board.standings[0] is best
    assert len(board.task.draws) == 256
    assert len(best.training_seeds) == 5
    assert best.feasible
    assert best.way_gone is not None
    assert best.way_gone.value >= 2.0 / 3.0
    assert best.over_best_rule is not None
    assert best.over_best_rule.low > 0.0
    assert best.best_rule is not None
    assert best.broken_share <= standings[best.best_rule].broken_share


@pytest.mark.parametrize(("env_id", "preset"), [*IDS.items(), *(("RoughTurning-v0", split) for split in SPLITS)])
def test_every_rule_and_reference_has_a_row(env_id: str, preset: str) -> None:
    board, scenario = read_board(ROWS / env_id / preset), Scenario.load(preset)
    assert not board.left_out
    wanted = {*names(scenario), *(reference.policy.name for reference in references(scenario))}
    assert wanted <= {standing.name for standing in board.standings}


def test_agents_that_are_said_to_beat_every_rule_do() -> None:
    claims = {"Override": BEST, "Surface": "ppo", "Shift": BEST, "Batch": "ppo"}
    for task, name in claims.items():
        env_id = f"RoughTurning-{task}-v0"
        best = read_board(ROWS / env_id / IDS[env_id]).standings[0]
        assert best.name == name
        assert best.feasible
        assert best.over_best_rule is not None
        assert best.over_best_rule.low > 0.0


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.parent.name}-{path.stem}")
def test_every_agent_can_be_loaded_and_has_a_card(path: Path) -> None:
    agent = onnx_policy.load(path)
    assert (agent.env_id, agent.scenario.name) == (path.parent.parent.name, path.parent.name)
    assert path.stem == f"{agent.name}-seed{agent.seed}"
    assert path.with_name(f"{agent.name}.md").is_file()
    assert path.stat().st_size < 500_000


def test_there_are_five_seeds_of_every_agent() -> None:
    names = {path.with_name(path.stem.rpartition("-seed")[0]) for path in FILES}
    assert len(FILES) == 5 * len(names)
