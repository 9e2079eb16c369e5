"""Files are written whole or not at all. Locks: ``tests/faults/test_at_once.py``."""

from collections.abc import Callable
from pathlib import Path

import pytest

from turning_env.files import replace_file


def test_target_is_replaced_once_it_is_whole(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "er" / "model.tar.zip"
    replace_file(target, lambda path: path.write_text("old"))

    def write(path: Path) -> None:
        path.write_text("new")
        assert target.read_text() == "old"

    replace_file(target, write)
    assert target.read_text() == "new"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize(
    "error", [OSError("disk full"), ValueError("no such value"), KeyboardInterrupt()]
)
def test_failed_write_keeps_the_old_file_and_nothing_else(
    tmp_path: Path, error: BaseException
) -> None:
    target = tmp_path / "file.txt"
    target.write_text("old")

    def write(path: Path) -> None:
        path.write_text("ha")
        raise error

    with pytest.raises(type(error)):
        replace_file(target, write)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def write_text(path: Path) -> None:
    path.write_text("text")


def write_nothing(path: Path) -> None:
    pass


def fill_the_disk(path: Path) -> None:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("name", "write"),
    [("taken", write_text), ("none", write_nothing), ("full", fill_the_disk)],
    ids=["the target is a folder", "nothing was written", "the disk is full"],
)
def test_an_error_names_the_target(
    name: str, write: Callable[[Path], None], tmp_path: Path
) -> None:
    (tmp_path / "taken" / "inside").mkdir(parents=True)
    with pytest.raises(OSError) as refusal:  # noqa: PT011 - the file's name is what counts
        replace_file(tmp_path / name, write)
    assert refusal.value.filename == str(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
