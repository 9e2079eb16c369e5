"""Seeds for tuning and for scoring."""

import pytest

from turning_env.scoring import seeds


def test_ranges_do_not_meet_and_start_where_they_say():
    tuning, held_out = seeds.tuning_seeds(1_000_000), seeds.held_out_seeds(1_000_000)
    assert (tuning[0], held_out[0]) == (seeds.TUNING_START, seeds.HELD_OUT_START)
    assert max(tuning) < min(held_out)
    assert len(set(tuning)) == len(set(held_out)) == 1_000_000


@pytest.mark.parametrize("make", [seeds.tuning_seeds, seeds.held_out_seeds])
@pytest.mark.parametrize("count", [0, -1, 1_000_001])
def test_impossible_counts_are_refused(make, count):
    with pytest.raises(ValueError, match=rf"{count} seeds .* 1 to 1000000"):
        make(count)
