import pytest

from research.studies.slower_wear import largest_reversal, reversal_of, settings_of

SLOW = {1.0: 0.10, 2.0: 0.15, 4.0: 0.20}
FAST = {1.0: 0.05, 2.0: 0.10, 4.0: 0.16}


def test_a_slower_edge_that_always_wears_more_is_a_reversal() -> None:
    reversal = reversal_of(SLOW, FAST, 2.0)
    assert reversal is not None
    assert reversal.wear_ratio == pytest.approx(1.5)
    # 2^(1 / 0.3) 1.5^(1 / 0.5) - 1
    assert reversal.size == pytest.approx(21.7, abs=0.1)


@pytest.mark.parametrize(
    "fast",
    [
        pytest.param(FAST | {4.0: 0.21}, id="once less"),
        pytest.param({1.0: 0.05, 2.0: 0.10, 3.0: 0.12}, id="two common times"),
    ],
)
def test_an_edge_that_wears_less_once_or_is_seen_too_seldom_is_none(fast) -> None:
    assert reversal_of(SLOW, fast, 2.0) is None


def test_a_setting_counts_its_largest_reversal() -> None:
    least = {time: wear / 2.0 for time, wear in FAST.items()}
    reversal = largest_reversal({100.0: SLOW, 150.0: FAST, 200.0: least})
    assert reversal is not None
    assert reversal.speed_ratio == 2.0
    assert largest_reversal({100.0: FAST, 150.0: SLOW}) is None


def test_settings_with_one_speed_are_left_out() -> None:
    row = {
        "organization": "A",
        "work_material": "steel",
        "tool_material": "carbide",
        "nose_radius_mm": "0.8",
        "feed_mm_rev": "0.1",
        "depth_of_cut_mm": "0.5",
        "time_min": "1",
        "flank_wear_mm": "0.1",
    }
    rows = [row | {"cutting_speed_m_min": speed} for speed in ("100", "200")]
    assert settings_of(rows) == [{100.0: {1.0: 0.1}, 200.0: {1.0: 0.1}}]
    assert settings_of(rows[:1]) == []
