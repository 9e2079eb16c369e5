"""Compiled or interpreted, in this process or another: the same numbers."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from tests.turning_env.playing import (
    FAILING,
    HOT_SPINDLE,
    SHORT_LIVED,
    Record,
    assert_same_bytes,
    changed,
    fixed_actions,
    play,
)
from turning_env import RoughTurningEnv, Scenario, presets
from turning_env.numerics.compilation import (
    FIRST_ENV,
    ONE_ENV,
    compiled,
    compiled_entry,
    compiled_separately,
    env_range,
    machine_code_folder,
)

REPOSITORY = Path(__file__).parents[3]
INTERPRETED = """
import pickle, sys
from tests.turning_env.numerics.test_compilation import plays

pickle.dump(plays(), sys.stdout.buffer)
"""


def play_of(scenario: Scenario, steps: int) -> Record:
    return play(RoughTurningEnv(scenario), 21, fixed_actions(steps, 1, scenario)[:, 0])


def plays() -> dict[str, Record]:
    """Return a few steps of every preset, and more that cross ends of episodes."""
    records = {}
    for preset in presets():
        steps = 2 if preset.startswith("batch") else 10
        records[preset] = play_of(Scenario.load(preset), steps)
    records["short_lived"] = play_of(SHORT_LIVED, 100)
    records["hot_spindle"] = play_of(HOT_SPINDLE, 40)
    records["failing"] = play_of(changed("rough_turning", **FAILING), 100)
    return records


@pytest.mark.slow
def test_an_interpreted_process_with_another_hash_seed_gives_the_same_bytes() -> None:
    variables = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONHASHSEED": "1"}
    command = [sys.executable, "-W", "error", "-c", INTERPRETED]
    run = subprocess.run(
        command,
        cwd=REPOSITORY,
        env=variables,
        capture_output=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr.decode()
    interpreted = pickle.loads(run.stdout)
    compiled = plays()
    assert interpreted.keys() == compiled.keys()
    for name, record in compiled.items():
        assert_same_bytes(interpreted[name], record)


def test_environments_are_counted_without_a_sign() -> None:
    numbers = list(env_range(2, 5))
    assert numbers == [2, 3, 4]
    assert (FIRST_ENV, ONE_ENV) == (0, 1)
    assert {type(number) for number in (FIRST_ENV, ONE_ENV)} == {np.uint64}


@pytest.mark.parametrize("decorate", [compiled, compiled_separately])
def test_called_from_python_compiled_functions_run_interpreted(decorate: Any) -> None:
    def described(x: object) -> str:
        return f"{x!r}"  # Numba cannot compile this

    assert decorate(described)("text") == "'text'"


def made(sources: Path, text: str) -> Path:
    """Return the folder for the machine code of a source with this text."""
    machine_code_folder.cache_clear()
    sources.mkdir(exist_ok=True)
    (sources / "entry.py").write_text(text)
    folder = machine_code_folder(sources)
    machine_code_folder.cache_clear()
    assert folder is not None
    return folder


def test_machine_code_is_kept_by_the_contents_of_its_sources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    first = made(tmp_path / "sources", "x = 1")
    assert first.parent == tmp_path / "sources" / "__pycache__"
    assert first.name.startswith("machine_code-")
    assert len(first.name) == len("machine_code-") + 24
    kept = first.parent / "entry.pyc"
    kept.write_text("bytecode")
    # The same sources have the same folder, with what it holds; others have another.
    (first / "code").write_text("machine code")
    assert made(tmp_path / "sources", "x = 1") == first
    assert (first / "code").exists()
    second = made(tmp_path / "sources", "x = 2")
    assert second != first
    assert not first.exists()
    assert kept.exists()
    # Half of the name is that of the shared sources.
    assert second.name[:25] == first.name[:25]


def test_a_chosen_folder_holds_the_machine_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "chosen"))
    folder = made(tmp_path / "sources", "x = 1")
    assert folder.parents[1] == tmp_path / "chosen"
    assert folder.parent.name.startswith("sources_")


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_an_entry_is_compiled_at_its_first_call_and_named_as_its_function() -> None:
    def last_of(values: Any) -> Any:
        return values[-1]

    entry = compiled_entry(last_of)
    assert entry.__name__ == "last_of"
    assert entry(np.array([1.0, 5.0])) == 5.0
    assert entry(np.array([1.0, 6.0])) == 6.0
