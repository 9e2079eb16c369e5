import pytest

from baselines import reproduce


def test_every_figure_of_the_paper_agrees(capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduce.main() == 0
    printed = capsys.readouterr().out
    assert "MISMATCH" not in printed
    assert sum(line.startswith("Table 1") for line in printed.splitlines()) == 16 * 5
    assert sum(line.startswith("Table 2") for line in printed.splitlines()) == 16 * 8


@pytest.mark.parametrize("column", ["thrust_force_n", "feed_mm_rev", "total_wear_mm"])
def test_a_figure_that_is_off_fails(column: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    printed = reproduce.rows

    def altered(table: str) -> list[dict[str, str]]:
        rows = printed(table)
        for row in rows:
            if column in row:
                row[column] = str(float(row[column]) * 1.01)
        return rows

    monkeypatch.setattr(reproduce, "rows", altered)
    assert reproduce.main() == 1
    assert "MISMATCH" in capsys.readouterr().out
