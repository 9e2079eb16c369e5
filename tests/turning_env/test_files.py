"""Regular files are read, and files are written whole or not at all.

Locks: ``tests/faults/test_at_once.py``.
"""

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from turning_env.files import folder_lock, read_regular, replace_file, write_file


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


def test_a_write_follows_no_link_that_was_placed_in_advance(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("kept")
    folder = tmp_path / "shared"
    folder.mkdir()
    # Names that a guess by the process and the target may give.
    for name in (f".partial-{os.getpid()}-file.txt", f".partial-{os.getpid()}", "content.txt"):
        (folder / name).symlink_to(secret)
    replace_file(folder / "file.txt", write_text)
    assert secret.read_text() == "kept"
    assert (folder / "file.txt").read_text() == "text"


def test_a_write_fills_a_new_folder_that_others_cannot_enter(tmp_path: Path) -> None:
    folders = []

    def write(path: Path) -> None:
        status = path.parent.stat()
        assert stat.S_IMODE(status.st_mode) == 0o700
        assert status.st_uid == os.getuid()
        folders.append(path.parent)
        write_text(path)

    replace_file(tmp_path / "file.txt", write)
    replace_file(tmp_path / "file.txt", write)
    assert tmp_path not in folders
    assert folders[0] != folders[1]


def test_a_new_file_has_the_permissions_of_any_other(tmp_path: Path) -> None:
    replace_file(tmp_path / "file.txt", write_text)
    write_text(tmp_path / "other.txt")
    written, other = ((tmp_path / name).stat().st_mode for name in ("file.txt", "other.txt"))
    assert written == other


def test_a_name_of_any_length_that_a_file_may_have_can_be_written(tmp_path: Path) -> None:
    target = tmp_path / ("n" * 251 + ".txt")
    replace_file(target, write_text)
    assert target.read_text() == "text"


def test_a_lock_removes_what_killed_processes_left_and_follows_no_link(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").touch()
    folder = tmp_path / "folder"
    (folder / ".partial-killed" / "deep").mkdir(parents=True)
    (folder / ".partial-killed" / "deep" / "content.txt").touch()
    (folder / ".partial-link").symlink_to(kept)
    with folder_lock(folder):
        assert not (folder / ".partial-killed").exists()
    assert (kept / "file").exists()


def test_a_regular_file_is_read_up_to_its_largest_size(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    (tmp_path / "link").symlink_to(path)
    assert read_regular(path, 5) == b"12345"
    assert read_regular(tmp_path / "link", 5) == b"12345"
    with pytest.raises(OSError, match="larger than 4 bytes"):
        read_regular(path, 4)


def test_what_is_no_regular_file_is_refused_by_name(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/zero")
    for name in ("pipe", "link", "device", "."):
        path = tmp_path / name
        with pytest.raises(OSError, match="must be a regular file") as refusal:
            read_regular(path, 10)
        assert refusal.value.filename == str(path)


def test_a_link_is_refused_where_it_must_not_be_followed(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "file")
    with pytest.raises(OSError, match="is a link"):
        read_regular(tmp_path / "link", 10, follow_links=False)


@pytest.mark.parametrize("content", ["Å\n", "Å\n".encode()], ids=["text", "bytes"])
def test_a_content_is_written_as_utf_8(content: str | bytes, tmp_path: Path) -> None:
    path = tmp_path / "new" / "file.txt"
    write_file(path, content)
    assert path.read_bytes() == "Å\n".encode()
