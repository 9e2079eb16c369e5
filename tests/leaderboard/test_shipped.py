"""Shipped agents, cards and results: valid, true to the documentation, and within the bound."""

from pathlib import Path
from typing import Any

import pytest

from baselines.catalogue import names
from baselines.comparators import CAUSAL, NOMINAL_OPTIMUM
from leaderboard import verify
from leaderboard.agents import agent_file
from leaderboard.family import KNOWN_FORMS
from leaderboard.policies import CLAIRVOYANT, SUMS, agent_files, oracles
from leaderboard.result import (
    MANIFEST_FILE,
    TRAJECTORIES_FILE,
    Manifest,
    read_part,
    read_results,
)
from leaderboard.trajectories import Trajectories
from leaderboard.verify import Selection
from turning_env import FAMILY_ID, IDS, SPLITS, Family, Scenario
from turning_env.scenario.family import families

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "leaderboard" / "results"
AGENTS = ROOT / "agents"
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


@pytest.mark.slow
def test_every_result_is_valid() -> None:
    assert verify.check(RESULTS, AGENTS, Selection()) == []


CASES = [
    pytest.param(
        Selection(
            "RoughTurning-v0",
            "rough_turning",
            ["fixed_tuned", "grid_search", "rescaled_grid_search", *AGENTS_OF_ALL_KINDS],
        ),
        2,
        id="v0, rules and agents",
    ),
    pytest.param(
        Selection("RoughTurning-v0", "rough_turning", [CLAIRVOYANT, "causal", "predictive"]),
        1,
        id="v0, bounds and oracles",
    ),
    pytest.param(
        Selection("RoughTurning-v0", "ck45", ["rescaled_grid_search", f"{BEST}-seed0"]),
        1,
        id="v0, split",
    ),
    pytest.param(
        Selection("RoughTurning-Override-v1", None, [*OVERRIDES, f"{BEST}-seed0"]),
        1,
        id="Override",
    ),
    pytest.param(
        Selection(
            "RoughTurning-Surface-v1",
            None,
            ["constant_force_lead", "constant_force", "ppo-seed0"],
        ),
        1,
        id="Surface",
    ),
    pytest.param(
        Selection("RoughTurning-Batch-v0", None, ["parts_mt", "ppo-seed0"]),
        2,
        id="Batch",
    ),
    pytest.param(
        Selection(FAMILY_ID, "shop-unseen_jobs", ["predictive", "self_tuning", "causal"]),
        1,
        id="family",
        marks=pytest.mark.soak,
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("selection", "seeds"), CASES)
def test_the_first_seeds_come_back(tmp_path: Path, selection: Selection, seeds: int) -> None:
    memory = tmp_path / "memory.json"
    assert (
        verify.verify(
            RESULTS,
            AGENTS,
            selection,
            memory=memory,
            draw=verify.Draw(seeds, key=0),
        )
        == []
    )


TASKS = list(IDS.items())
TASKS += [("RoughTurning-v0", split) for split in SPLITS]


@pytest.mark.parametrize(("env_id", "preset"), TASKS)
def test_every_rule_and_oracle_has_a_result(env_id: str, preset: str) -> None:
    scenario = Scenario.load(preset)
    path = RESULTS / env_id / preset / MANIFEST_FILE
    assert path.exists(), (
        f"{env_id} has no results on {preset}: play them (CONTRIBUTING, Add a task)"
    )
    manifest = read_part(Manifest, path)
    policies = {*names(scenario), *(oracle.name for oracle in oracles(scenario))}
    missing = sorted(policies - manifest.results.keys())
    assert not missing, (
        f"on {preset}, tune {missing} if it has parameters (python -m train.tune rules --scenario "
        f"{preset} --shipped --rules ...), then play what is missing: make results"
    )


SPLITS_OF_FAMILIES = ("unseen_jobs", "unseen_machines", "unseen_materials")
KNOWING = {
    "shop": "predictive with true laws",
    "unmodelled": KNOWN_FORMS,
}
"""The policy of each family that knows what its nominal models lack."""


@pytest.mark.slow
def test_policies_of_the_family_play_every_job_of_their_splits() -> None:
    knowing = {}
    for family in families():
        for split in SPLITS_OF_FAMILIES:
            knowing[f"{family}-{split}"] = KNOWING[family]
    assert {folder.name for folder in (RESULTS / FAMILY_ID).iterdir()} == knowing.keys()
    for name in sorted(knowing):
        # Unranked: tests/test_tables.py ranks them.
        folder = RESULTS / FAMILY_ID / name
        by_label = read_results(folder)
        results = by_label.values()
        for trajectory in read_part(Trajectories, folder / TRAJECTORIES_FILE).episodes:
            steps = by_label[trajectory.policy.label].episodes["steps"]
            assert trajectory.steps == steps[trajectory.seed]
        for result in results:
            assert result.task.scenario.name == name
            assert len(result.task.seeds) == 256
        titles = {result.policy.title for result in results}
        assert {NOMINAL_OPTIMUM, "predictive", "self_tuning", CAUSAL, knowing[name]} <= titles


def trained_agents() -> dict[Path, int]:
    """Return the number of training seeds of each agent, by its path without a seed."""
    counts: dict[Path, int] = {}
    for path in agent_files(AGENTS).values():
        agent = path.with_name(path.stem.rpartition("-seed")[0])
        counts[agent] = counts.get(agent, 0) + 1
    return counts


def test_every_agent_has_a_card_and_the_file_of_one_training_seed() -> None:
    agents = set(trained_agents())
    assert agents == {path.with_suffix("") for path in AGENTS.glob("*/*/*.md")}
    # Of the other training seeds the SHA-256 is enough.
    assert {path.with_name(f"{path.name}-seed0.onnx") for path in agents} <= set(FILES)
    assert len((AGENTS / SUMS).read_text("utf-8").splitlines()) == len(agent_files(AGENTS))


def test_agents_have_five_training_seeds_or_more() -> None:
    counts = trained_agents()
    assert counts
    for path, count in counts.items():
        # Agents of families take long, and those without training need no other seeds.
        if FAMILY_ID not in path.parts and "_untrained" not in path.name:
            assert count >= 5, path


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_file_is_of_its_folder_and_small(path: Path) -> None:
    metadata = agent_file.read(path).metadata
    family: Any = metadata.parameters.get("family")
    home = Family.load(family) if family else metadata.scenario
    assert home.name == path.parent.name
    assert metadata.label == path.stem
    # Git keeps every version: most files are below 250 kB, a GRU of 192 cells takes 1.65 MB.
    assert path.stat().st_size < 1_700_000
