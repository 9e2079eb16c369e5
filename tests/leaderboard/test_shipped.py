"""Shipped agents, cards and results: valid, true to the documentation, and within the bound."""

from pathlib import Path
from typing import Any

import pytest

from baselines.catalogue import names
from leaderboard import verify
from leaderboard.family import CAUSAL, NOMINAL_OPTIMUM
from leaderboard.policies import CLAIRVOYANT, SUMS, agent_files, oracles
from leaderboard.ranking import read_leaderboards
from leaderboard.result import MANIFEST_FILE, Manifest, read_part
from leaderboard.verify import Selection
from train.agents import agent_file
from turning_env import FAMILY_ID, IDS, SPLITS, Family, Scenario
from turning_env.scenario.family import families

ROOT = Path(__file__).parents[2]
RESULTS, AGENTS = ROOT / "leaderboard" / "results", ROOT / "agents"
FILES = sorted(AGENTS.glob("*/*/*.onnx"))
BEST = "analytic_gradient"
OVERRIDES = (
    "constant_power_lead",
    "omative",
    "tmac",
    "iadapts",
    "fuzzy_override",
    "constant_force_limit",
    "current_limit",
)
AGENTS_OF_ALL_KINDS = [
    f"{name}-seed0"
    for name in ("ppo", "ppo_belief", "recurrent_ppo", "lagrangian_ppo", "sac", "tqc", BEST)
]


def test_every_result_is_valid() -> None:
    assert verify.check(RESULTS, AGENTS, Selection()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "scenario", "seeds", "policies"),
    [
        (
            "RoughTurning-v0",
            "rough_turning",
            2,
            ["fixed_tuned", "grid_search", "rescaled_grid_search", *AGENTS_OF_ALL_KINDS],
        ),
        ("RoughTurning-v0", "rough_turning", 1, [CLAIRVOYANT, "causal", "predictive"]),
        ("RoughTurning-v0", "ck45", 1, ["rescaled_grid_search", f"{BEST}-seed0"]),
        ("RoughTurning-Override-v1", None, 1, [*OVERRIDES, f"{BEST}-seed0"]),
        (
            "RoughTurning-Surface-v1",
            None,
            1,
            ["constant_force_lead", "constant_force", "ppo-seed0"],
        ),
        ("RoughTurning-Batch-v0", None, 2, ["parts_mt", "ppo-seed0"]),
        pytest.param(
            *(FAMILY_ID, "shop-unseen_jobs", 1, ["predictive", "self_tuning", "causal"]),
            marks=pytest.mark.soak,
        ),
    ],
)
def test_the_first_seeds_come_back(
    tmp_path: Path, env_id: str, scenario: str | None, seeds: int, policies: list[str]
) -> None:
    assert (
        verify.verify(
            RESULTS, AGENTS, Selection(env_id, scenario, policies), tmp_path / "memory.json", seeds
        )
        == []
    )


@pytest.mark.parametrize(
    ("env_id", "preset"), [*IDS.items(), *(("RoughTurning-v0", split) for split in SPLITS)]
)
def test_every_rule_and_oracle_has_a_result(env_id: str, preset: str) -> None:
    scenario = Scenario.load(preset)
    wanted = {*names(scenario), *(oracle.name for oracle in oracles(scenario))}
    assert wanted <= read_part(Manifest, RESULTS / env_id / preset / MANIFEST_FILE).results.keys()


def test_policies_of_the_family_play_every_job_of_the_three_splits() -> None:
    boards = read_leaderboards(RESULTS, scenarios=families())
    splits = "unseen_jobs", "unseen_machines", "unseen_materials"
    played = [board.task.scenario.name for board in boards]
    assert played == [f"{family}-{split}" for family in families() for split in splits]
    for board in boards:
        assert len(board.task.seeds) == 256
        names = {each.name for each in board.standings}
        told = "true laws" if board.task.scenario.name.startswith("shop") else "true forms"
        assert {
            NOMINAL_OPTIMUM,
            "predictive",
            "self_tuning",
            f"self_tuning with {told}",
            CAUSAL,
        } <= names


def test_every_agent_is_of_its_folder_and_has_a_card() -> None:
    known = agent_files(AGENTS)
    names = [path.with_name(path.stem.rpartition("-seed")[0]) for path in known.values()]
    assert set(names) == {path.with_suffix("") for path in AGENTS.glob("*/*/*.md")}
    assert {path.with_name(f"{path.name}-seed0.onnx") for path in names} <= set(
        FILES
    )  # of others the SHA-256 is enough
    assert all(
        names.count(path) >= 5
        for path in names
        if FAMILY_ID not in path.parts and "_untrained" not in path.name
    )
    assert len((AGENTS / SUMS).read_text("utf-8").splitlines()) == len(known)
    for path in FILES:
        metadata = agent_file.read(path).metadata
        family: Any = metadata.parameters.get("family")
        assert (Family.load(family).name if family else metadata.scenario.name, metadata.label) == (
            path.parent.name,
            path.stem,
        )
        assert path.stat().st_size < 250_000
