"""The fuzzer tries every reader, finds planted faults, and keeps what has shown them."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from random import Random
from typing import Any

import pytest

from benchmarks.fuzz.__main__ import main
from benchmarks.fuzz.damage import damaged_json, damaged_onnx, damaged_toml
from benchmarks.fuzz.readers import READERS, ROOT
from benchmarks.fuzz.search import Search


@pytest.mark.parametrize("name", READERS)
def test_no_reader_breaks_its_promise(name: str, tmp_path: Path) -> None:
    search = Search(READERS[name], tmp_path, tmp_path / "kept")
    search.damage(600.0, 300, Random(0))
    assert search.found == {}
    assert search.tried == 300


@pytest.mark.parametrize(("damage", "name"), [(damaged_toml, "scenario"), (damaged_json, "results"), (damaged_onnx, "agent")])
def test_damage_that_keeps_the_form_leaves_some_files_valid_and_some_not(damage: Any, name: str, tmp_path: Path) -> None:
    reader, random = READERS[name], Random(0)
    given = [reader.check(tmp_path, damage(reader.valid()[0], random)) is not None for _ in range(60)]
    assert 5 < sum(given) < 55


def stumbles(folder: Path, content: bytes) -> None:
    """A reader with two faults, one of which shows itself in two ways."""
    if b"FCTDEF" not in content:
        raise KeyError("FCTDEF")
    if b"M30" not in content:
        raise IndexError(len(content))


def test_planted_faults_are_found_and_kept_once_each(tmp_path: Path) -> None:
    heard: list[int] = []
    reader = READERS["program"]._replace(check=stumbles)
    search = Search(reader, tmp_path, tmp_path / "kept", lambda tried, found, seconds: heard.append(len(found)))
    search.damage(600.0, 300, Random(0))
    assert sorted(error.split(":")[0] for error in search.found.values()) == ["IndexError", "KeyError"]
    assert max(heard) == 2
    for path in map(Path, search.found):
        with pytest.raises((KeyError, IndexError)):
            stumbles(tmp_path, path.read_bytes())
    assert len(list((tmp_path / "kept").iterdir())) == 2


def test_a_slow_input_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.fuzz.search.LONGEST", -1.0)
    search = Search(READERS["program"], tmp_path, tmp_path / "kept")
    search.attempt(b"")
    assert [error.split(":")[0] for error in search.found.values()] == ["TimeoutError"]


def test_it_ends_after_its_time(tmp_path: Path) -> None:
    search = Search(READERS["program"], tmp_path, tmp_path / "kept")
    search.damage(0.2, None, Random(0))
    assert 0.2 <= search.seconds < 10.0


def test_it_prints_a_table_and_is_content(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--reader", "program", "--inputs", "50", "--seed", "0", "--out", str(tmp_path), "--random"]
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines()[1].split() == ["program", "10", "50", "-", "-", "0"]
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["unhandled"] == {}


WORKER = """
import os
from benchmarks.fuzz import readers
from benchmarks.fuzz.worker import main
def check(folder, content):
    (folder / "tried.mpf").write_bytes(content)
    {fault}
readers.READERS["program"] = readers.READERS["program"]._replace(check=check)
main()
"""


@pytest.mark.parametrize(("fault", "error"), [("os.abort()", "status -6"), ("raise KeyError('planted')", "planted")])
def test_what_a_worker_finds_or_dies_of_is_told_with_how_to_run_it_again(
    fault: str, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("benchmarks.fuzz.__main__._PROGRAM", WORKER.format(fault=fault))
    assert main(["--reader", "program", "--inputs", "20", "--out", str(tmp_path / "out"), "--random"]) == 1
    told = capsys.readouterr().err
    assert error in told
    command = next(line for line in told.splitlines() if line.startswith("  python -m benchmarks.fuzz"))
    arguments = command.split()[3:]
    assert main(arguments) == 0  # the true reader has no such fault
    assert Path(arguments[-1]).parent == tmp_path / "out" / "program"


def test_a_worker_that_does_not_start_is_an_error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("benchmarks.fuzz.__main__._PROGRAM", "raise SystemExit('no such thing')")
    assert main(["--reader", "program", "--inputs", "1", "--random"]) == 2
    assert "no such thing" in capsys.readouterr().err


# Where the tests were started in the background of a shell, interruptions are ignored unless a program says otherwise.
INTERRUPTIBLE = """
import signal, sys
from benchmarks.fuzz.__main__ import main
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main())
"""


def test_interrupted_it_ends_its_worker(tmp_path: Path) -> None:
    command = [sys.executable, "-c", INTERRUPTIBLE, "--reader", "program", "--random", "--out", str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, env=os.environ | {"TMPDIR": str(tmp_path)}) as it:
        while not list(tmp_path.glob("*/tried.*")):
            assert it.poll() is None
        it.send_signal(signal.SIGINT)
        assert it.stderr is not None
        assert it.stderr.read().endswith("the next search goes on from there\n")
    assert it.returncode == 130
    assert not list(tmp_path.glob("*/tried.*"))


@pytest.mark.skipif(importlib.util.find_spec("atheris") is None, reason="needs atheris")
def test_with_atheris_the_code_that_is_reached_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--reader", "program", "--inputs", "300", "--seed", "0", "--out", str(tmp_path), "--json"]) == 0
    outcome = json.loads(capsys.readouterr().out)[0]
    assert outcome["inputs"] == 300
    assert outcome["branches"] > 50
    assert list((tmp_path / "program" / "corpus").iterdir())
