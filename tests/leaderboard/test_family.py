"""Policies compared on the jobs of a family."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from leaderboard import family
from leaderboard.family import ANCHOR, TRUTH, Comparison, Retold, compare, main, table
from leaderboard.standings import CAUSAL
from tests.turning_env.test_family_env import BRIEF
from turning_env import Family, FamilyVectorEnv
from turning_env.scoring.policy import Policy

JOBS = 40


def episodes(returns: Any, severe: Any = 0.0) -> dict[str, Any]:
    values = np.broadcast_to(np.asarray(returns, np.float64), (JOBS, 2))
    return {"return": values, "severe_overload_time": values * 0.0 + severe, "engaged_time": values * 0.0 + 100.0}


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


@pytest.mark.slow
def test_the_table_is_the_same_with_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "brief.toml"
    path.write_text(tomli_w.dumps(BRIEF))
    command = ["--family", str(path), "--jobs", "5", "--episodes", "1", "--policies", "predictive", "causal", "--forgetful"]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("brief, unseen_jobs, 5 jobs")
    assert all(name in printed for name in ("held optimum", "causal", "predictive, forgetful"))
    assert main([*command, "--workers", "2", "--keep", str(tmp_path / "kept")]) == 0
    assert capsys.readouterr().out == printed
    monkeypatch.setattr(family, "played", None)  # nothing is played again
    assert main([*command, "--keep", str(tmp_path / "kept")]) == 0
    assert capsys.readouterr().out == printed
