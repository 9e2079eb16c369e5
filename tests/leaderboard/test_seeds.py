"""Seeds for tuning and for scoring."""

import pytest

from leaderboard import seeds


def test_seeds_for_tuning_and_scoring_have_none_in_common():
    tuning = seeds.tuning_seeds(1_000_000)
    held_out = seeds.held_out_seeds(1_000_000)
    assert tuning[0] == seeds.TUNING_START
    assert held_out[0] == seeds.HELD_OUT_START
    assert len(set(tuning)) == 1_000_000
    assert len(set(held_out)) == 1_000_000
    assert max(tuning) < min(held_out)


@pytest.mark.parametrize("make", [seeds.tuning_seeds, seeds.held_out_seeds])
@pytest.mark.parametrize("count", [0, -1, 1_000_001])
def test_impossible_counts_are_refused(make, count):
    with pytest.raises(ValueError, match=rf"{count} seeds .* 1 to 1000000"):
        make(count)
