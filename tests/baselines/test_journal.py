from pathlib import Path

import pytest

from baselines.journal import Journal


def never() -> float:
    raise AssertionError("this is known")


def test_what_was_found_is_recalled_by_another_journal_of_the_same_task(tmp_path: Path) -> None:
    path = tmp_path / "journal.json"
    assert Journal(path, ["a", 1]).recall([{"x": 0.1}], lambda: 0.1 + 0.2) == 0.1 + 0.2
    again = Journal(path, ["a", 1])
    assert again.recall([{"x": 0.1}], never) == 0.1 + 0.2
    assert again.recall([{"x": 0.2}], lambda: 5.0) == 5.0
    again.finish()
    assert not path.exists()


@pytest.mark.parametrize("task", [["a", 2], None, {}])
def test_another_task_starts_anew(tmp_path: Path, task: object) -> None:
    path = tmp_path / "journal.json"
    Journal(path, ["a", 1]).recall("key", lambda: 1.0)
    assert Journal(path, task).recall("key", lambda: 2.0) == 2.0


@pytest.mark.parametrize("text", ["", "{", "[]", "null"])
def test_a_damaged_file_starts_anew(tmp_path: Path, text: str) -> None:
    path = tmp_path / "journal.json"
    path.write_text(text)
    assert Journal(path, "task").recall("key", lambda: 3.0) == 3.0
