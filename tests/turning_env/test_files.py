"""Files are written whole or not at all."""

import os
from pathlib import Path

import pytest

from turning_env.files import replace_file


def test_the_target_is_replaced_and_its_folder_made(tmp_path):
    target = tmp_path / "deep" / "er" / "file.txt"
    for text in ("one", "two"):
        replace_file(target, lambda path, text=text: path.write_text(text))
        assert target.read_text() == text
    assert list(target.parent.iterdir()) == [target]


def test_until_it_is_whole_it_is_hidden_beside_the_target_with_its_suffix(tmp_path):
    target = tmp_path / "model.tar.zip"
    target.write_text("old")
    written: list[Path] = []

    def write(path: Path) -> None:
        written.append(path)
        path.write_text("new")
        assert target.read_text() == "old"

    replace_file(target, write)
    (partial,) = written
    assert partial.parent == tmp_path
    assert partial.name == f".partial-{os.getpid()}-model.tar.zip"
    assert target.read_text() == "new"


@pytest.mark.parametrize("error", [OSError("disk full"), ValueError("no such value"), KeyboardInterrupt()])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, error):
    target = tmp_path / "file.txt"
    target.write_text("old")

    def write(path: Path) -> None:
        path.write_text("ha")
        raise error

    with pytest.raises(type(error)):
        replace_file(target, write)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_what_replaces_the_target_is_on_the_disk(tmp_path, monkeypatch):
    synced: list[str] = []
    monkeypatch.setattr("turning_env.files.os.fsync", lambda number: synced.append(os.readlink(f"/proc/self/fd/{number}")))
    replace_file(tmp_path / "file.txt", lambda path: path.write_text("text"))
    assert synced == [str(tmp_path / f".partial-{os.getpid()}-file.txt")]


def test_a_rename_that_fails_leaves_nothing(tmp_path):
    (tmp_path / "taken" / "inside").mkdir(parents=True)
    with pytest.raises(OSError, match="taken"):
        replace_file(tmp_path / "taken", lambda path: path.write_text("text"))
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_writer_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        replace_file(tmp_path / "file.txt", lambda path: None)
