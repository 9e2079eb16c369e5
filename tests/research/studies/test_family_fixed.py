import pytest

from research.studies import family_fixed


@pytest.mark.slow
def test_a_row_for_each_pair_of_shares(capsys) -> None:
    shares = ["--speeds", "0.8", "1.0", "--feeds", "0.5"]
    assert family_fixed.main(["shop", "--jobs", "2", *shares]) == 0
    heading, _, *rows = capsys.readouterr().out.splitlines()
    assert heading.startswith("| Speed | Feed | Return [s] |")
    assert [row.split(" | ")[:2] for row in rows] == [["| 0.80", "0.50"], ["| 1.00", "0.50"]]
