"""Policies compared on the jobs of a family."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from baselines.catalogue import RULES
from leaderboard import __main__ as leaderboard
from leaderboard import family, family_play, verify
from leaderboard.family import main
from leaderboard.family_play import ANCHOR, TRUTH, Retold
from leaderboard.family_result import FamilyResult
from leaderboard.family_table import Comparison, compare, table
from leaderboard.result import read_result, write_part
from leaderboard.standings import CAUSAL
from leaderboard.verify import Selection
from tests.train import onnx_agents
from tests.turning_env.test_family_env import BRIEF
from turning_env import FAMILY_ID, Family, FamilyVectorEnv
from turning_env.scoring.policy import Policy

JOBS = 40


def episodes(returns: Any, severe: Any = 0.0) -> dict[str, Any]:
    values = returns + np.zeros((1, JOBS, 2))
    return {
        "return": values,
        "reward_metal": values * 0.0 + 400.0,
        "severe_overload_time": values * 0.0 + severe,
        "engaged_time": values * 0.0 + 100.0,
    }


def compared(**others: Any) -> dict[str, Comparison]:
    base = np.linspace(-100.0, 100.0, JOBS)[:, None]
    rows = {"bad": episodes(base - 50.0), "rule": episodes(base), f"rule{TRUTH}": episodes(base + 10.0)}
    rows |= {name: episodes(base + lead, severe) for name, (lead, severe) in others.items()}
    return {each.name: each for each in compare(rows, ["bad", "rule"], 0.05)}


def test_leads_are_paired_and_over_the_best_rule() -> None:
    found = compared(agent=(5.0, 4.0), reckless=(20.0, 6.0))
    agent = found["agent"]
    assert (agent.lead.value, agent.lead.low, agent.lead.high) == pytest.approx((5.0, 5.0, 5.0))
    assert (agent.median, agent.wins, agent.worst) == pytest.approx((5.0, 1.0, -95.0))
    assert agent.value.low < -10.0 < 20.0 < agent.value.high
    assert (agent.gap_closed.value, agent.gap_closed.low) == pytest.approx((0.5, 0.5))
    assert found[f"rule{TRUTH}"].gap_closed.value == pytest.approx(1.0)
    assert (found["rule"].lead.value, found["bad"].lead.value) == pytest.approx((0.0, -50.0))
    assert (agent.feasible, found["reckless"].feasible) == (1.0, 0.0)
    assert agent.overload == pytest.approx(0.04)
    mixed = compared(agent=(np.where(np.arange(JOBS) < 10, -1.0, 3.0)[:, None], 0.0))["agent"]
    assert (mixed.wins, mixed.lead.value, mixed.median) == pytest.approx((0.75, 2.0, 3.0))
    assert mixed.lead.low < 2.0 < mixed.lead.high


def test_intervals_are_over_jobs_and_training_seeds() -> None:
    found = compared(agent=(np.array([-1.0, 1.0])[:, None, None], np.array([4.0, 6.0])[:, None, None]))["agent"]
    assert (found.lead.low, found.lead.value, found.lead.high) == pytest.approx((-1.0, 0.0, 1.0))
    assert (found.wins, found.feasible, found.overload) == pytest.approx((0.5, 0.5, 0.05))
    assert found.gap_closed.low < 0.0 < found.gap_closed.high


def test_the_full_cost_is_all_cost_over_the_worth_of_the_metal() -> None:
    found = compared(agent=(40.0, 0.0))["agent"].full_cost  # returns of -60 to 140 for metal that is worth 400
    assert found.value == pytest.approx((400.0 - 40.0) / 400.0)
    assert 260.0 / 400.0 < found.low < found.value < found.high < 460.0 / 400.0


def test_without_a_gap_no_share_of_it_is_given() -> None:
    rows = {"rule": episodes(np.zeros((JOBS, 1))), f"rule{TRUTH}": episodes(np.full((JOBS, 1), -1.0))}
    assert all(np.isnan(each.gap_closed.value) for each in compare(rows, ["rule"], 0.05))
    assert "nan" not in table(compare(rows, ["rule"], 0.05))


def test_scores_lie_between_the_anchors_of_each_job() -> None:
    base = np.linspace(-1000.0, 0.0, JOBS)[:, None]
    gap = np.linspace(10.0, 500.0, JOBS)[:, None]
    rows = {ANCHOR: episodes(base), CAUSAL: episodes(base + gap), "rule": episodes(base + 0.5 * gap)}
    found = {each.name: each.score for each in compare(rows, ["rule"], 0.05)}
    assert [found[name].value for name in rows] == pytest.approx([0.0, 1.0, 0.5])
    assert (found["rule"].low, found["rule"].high) == pytest.approx((0.5, 0.5))
    del rows[CAUSAL]
    assert all(np.isnan(each.score.value) for each in compare(rows, ["rule"], 0.05))


class Watching(Policy):
    """Keeps what it sees."""

    def act(self, observations: Any) -> Any:
        self.seen = observations
        return np.zeros((len(observations), 3), np.float32)


def test_an_agent_of_another_family_is_told_the_context_as_in_its_training() -> None:
    played, variables = Family.load(BRIEF), dict(BRIEF["variables"])
    variables["diameter"] = variables["diameter"] | {"log_uniform": [100.0, 200.0]}
    other = Family.load(BRIEF | {"name": "other", "variables": variables})
    mean, spread = other.context_scale
    observations, _ = FamilyVectorEnv(4, played).reset(seed=0)
    watching = Watching()
    Retold(watching, played).act(observations)
    np.testing.assert_allclose(watching.seen, observations, atol=1e-6)
    Retold(watching, played, {"mean": mean, "spread": spread}).act(observations)
    place, entries = played.context_names.index("log_diameter"), observations.shape[1] - len(played.context_names)
    diameters = [played.job(i).scenario.workpiece.diameter for i in range(4)]
    expected = (np.log(diameters) - mean[place]) / spread[place]
    np.testing.assert_allclose(watching.seen[:, entries + place], np.clip(expected, -5.0, 5.0), atol=1e-5)
    assert np.array_equal(watching.seen[:, :entries], observations[:, :entries])


SPLITS = ["unseen_jobs", "unseen_machines"]


def command(folder: Path, *agents: Path, policies: Sequence[str] = ("rescaled_grid_search",)) -> list[str]:
    path = folder / "brief.toml"
    path.write_text(tomli_w.dumps(BRIEF))
    given = ["--family", str(path), "--jobs", "3", "--episodes", "2", "--policies", *policies, CAUSAL, "--split", *SPLITS]
    return [*given, *(["--agent", *map(str, agents)] if agents else [])]


@pytest.mark.slow
def test_the_table_is_the_same_with_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = [*command(tmp_path, policies=["predictive"]), "--forgetful"]
    assert main(given) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("brief, unseen_jobs, 3 jobs of 2 episodes")
    assert all(name in printed for name in ("held optimum", "causal", "predictive, forgetful"))
    kept = ["--keep", str(tmp_path / "kept")]
    assert main([*given, *kept, "--jobs", "2"]) == 0
    assert main([*given, *kept, "--workers", "2"]) == 0
    assert capsys.readouterr().out.endswith(printed)
    monkeypatch.setattr(family, "played", None)  # nothing is played again
    assert main([*given, *kept]) == 0
    assert capsys.readouterr().out == printed
    show = ["show", "--results", str(tmp_path / "kept"), "--env", FAMILY_ID]
    assert leaderboard.main(show) == 0
    assert capsys.readouterr().out == printed
    assert leaderboard.main([*show, "--scenario", "brief-unseen_machines", "--json"]) == 0
    assert '"split": "unseen_machines"' in capsys.readouterr().out


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a rule and of two training seeds, and the agents."""
    folder = tmp_path_factory.mktemp("shipped")
    agents = [onnx_agents.write_of_family(folder / "agents" / FAMILY_ID / "brief", Family.load(BRIEF), seed) for seed in (0, 1)]
    assert main([*command(folder, *agents), "--keep", str(folder / "results")]) == 0
    return folder


@pytest.fixture
def shipped(tmp_path: Path, played: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of them, with a family that is known by its name."""
    shutil.copytree(played, tmp_path, dirs_exist_ok=True)
    load = Family.load
    monkeypatch.setattr(Family, "load", lambda source: load(BRIEF if source == "brief" else source))
    return tmp_path


def complaints(shipped: Path, seeds: int | None = None, policies: Sequence[str] | None = None) -> list[str]:
    """Return what verification says, without playing unless seeds are given."""
    folders = shipped / "results", shipped / "agents", Selection(FAMILY_ID, policies=policies)
    return verify.check(*folders) if seeds is None else verify.verify(*folders, shipped / "memory.json", seeds)


@pytest.mark.slow
def test_results_are_verified_as_on_other_boards(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert complaints(shipped) == complaints(shipped, 1) == []
    folder = shipped / "results" / FAMILY_ID / "brief-unseen_jobs"
    path = folder / "family_gradient-seed1.json.xz"
    result = read_result(path, FamilyResult)
    rows = {seed: [values[0] + 1e-9, *values[1:]] for seed, values in result.rows.items()}
    write_part(FamilyResult.of_rows(result.task, result.policy, rows), path)
    (complaint,) = complaints(shipped, 2, ["family_gradient-seed1"])
    assert complaint.startswith(f"{path}: return differs for 2 of 2 seeds")
    for each in (shipped / "results").rglob("family_gradient-seed0*"):
        each.unlink()
    (complaint,) = complaints(shipped)
    assert "family_gradient-seed0.onnx: has no result in" in complaint

    rule = RULES["rescaled_grid_search"]
    monkeypatch.setitem(RULES, "rescaled_grid_search", replace(rule, version=rule.version + 1))
    assert sum("rescaled_grid_search" in each for each in complaints(shipped)) == len(SPLITS)


@pytest.mark.slow
def test_results_of_another_family_are_invalid(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = Family.load
    monkeypatch.setattr(Family, "load", lambda source: load(BRIEF | {"name": "brief"} if source == "brief" else source))
    assert complaints(shipped) == []
    monkeypatch.setattr(Family, "load", lambda source: load(BRIEF | {"jobs": 32} if source == "brief" else source))
    assert all("is not of the present family 'brief': values differ" in each for each in complaints(shipped)[:4])


@pytest.mark.slow
def test_a_card_has_the_results_of_every_split(shipped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cards = ["cards", "--results", str(shipped / "results"), "--agents", str(shipped / "agents")]
    assert leaderboard.main(cards) == 0
    card = (shipped / "agents" / FAMILY_ID / "brief" / "family_gradient.md").read_text("utf-8")
    for said in (
        "| `unseen_jobs` | 3 | ",
        "| `unseen_machines` | 3 | ",
        "From 2 training seeds.",
        "privileged agent",
        "--scenario mine.toml",
    ):
        assert said in card, said
    (shipped / "results" / FAMILY_ID / "brief-unseen_jobs" / "family_gradient-seed1.json.xz").unlink()
    assert leaderboard.main(cards) == 2
    assert "family_gradient-seed1.onnx has no results" in capsys.readouterr().err


def test_agents_play_each_job_at_the_place_of_its_number() -> None:
    brief = Family.load(BRIEF)
    jobs = [brief.job(number) for number in (1, 3, 4)]
    filled, places = family_play._filled(jobs)
    assert all(filled[place] is job for place, job in zip(places, jobs, strict=True))
    assert [place % family_play.FILLED for place in places] == [job.number % family_play.FILLED for job in jobs]
    assert len(filled) % family_play.FILLED == 0
