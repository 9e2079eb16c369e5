"""The measurement of how far ahead a policy must look, and what it must know of wear."""

import numpy as np
import pytest

from studies.foresight import DISCOUNTS, WHOLE_JOB, Edges, losses, main
from turning_env import Family


def test_looking_further_ahead_and_knowing_more_never_loses() -> None:
    found = dict(losses(Edges(Family.load("shop"), "train", 8)))
    means = [float(loss.mean()) for loss in found.values()]
    by_discount, (shown, told) = means[: len(DISCOUNTS)], means[len(DISCOUNTS) :]
    assert by_discount == sorted(by_discount, reverse=True)
    assert by_discount[-1] == pytest.approx(0.0, abs=5.0)
    assert 0.0 < shown < told


def test_a_plan_by_the_true_law_changes_edges_before_they_are_worn_out() -> None:
    edges = Edges(Family.load("shop"), "train", 4)
    planned = edges.returns(edges.plan(WHOLE_JOB, edges.true_rate))
    edges.true_rate = 1.001 * edges.true_rate
    late = edges.returns(edges.plan(WHOLE_JOB, edges.true_rate / 1.001))
    assert (late <= planned + 1e-6).all()
    assert (late < planned - 100.0).any()  # unannounced stops of 3 min each
    assert np.isfinite(planned).all()


def test_it_says_what_it_measures(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--jobs", "2", "--split", "unseen_machines"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3 + len(DISCOUNTS)
