"""Compiled or interpreted, in this process or another: the same numbers."""

import importlib.util
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import turning_env
from tests.turning_env.playing import SHORT_LIVED, Record, assert_same_bytes, fixed_actions, play
from turning_env import RoughTurningEnv, presets
from turning_env.numerics.compilation import source_digest

PACKAGE = Path(turning_env.__file__).parent
REPOSITORY = Path(__file__).parents[3]


def every_play() -> dict[str, Record]:
    """A few hundred intervals of the default scenario, fewer of every other, and a few parts."""
    counts = {preset: 4 if preset.startswith("batch") else 40 for preset in presets()}
    records = {
        preset: play(RoughTurningEnv(preset), 21, fixed_actions(count, 1, preset)[:, 0]) for preset, count in counts.items()
    }
    records["short_lived"] = play(RoughTurningEnv(SHORT_LIVED), 21, fixed_actions(100, 1)[:, 0])
    records["default"] = play(RoughTurningEnv(), 21, fixed_actions(300, 1)[:, 0])
    return records


def every_play_elsewhere(**variables: str) -> dict[str, Record]:
    """The same from a new interpreter with these environment variables."""
    code = "import pickle, sys; from tests.turning_env.test_compilation import every_play as play; "
    code += "pickle.dump(play(), sys.stdout.buffer)"
    command = [sys.executable, "-W", "error", "-c", code]
    run = subprocess.run(command, cwd=REPOSITORY, env=os.environ | variables, capture_output=True, check=False)
    assert run.returncode == 0, run.stderr.decode()
    return pickle.loads(run.stdout)


def test_the_interpreter_gives_what_the_compiler_gives():
    compiled, interpreted = every_play(), every_play_elsewhere(NUMBA_DISABLE_JIT="1")
    assert compiled.keys() == interpreted.keys()
    for name, record in compiled.items():
        assert record.keys() == interpreted[name].keys()
        assert_same_bytes(interpreted[name], record)


@pytest.mark.parametrize("hash_seed", ["0", "1"])
def test_results_do_not_depend_on_the_process_or_its_hash_seed(hash_seed):
    elsewhere = every_play_elsewhere(PYTHONHASHSEED=hash_seed)
    for name, record in every_play().items():
        assert_same_bytes(elsewhere[name], record)


def test_the_digest_of_the_sources_changes_with_every_file(tmp_path):
    folder = tmp_path / "turning_env"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    specification = importlib.util.spec_from_file_location("copied_compilation", folder / "compilation.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    digests = [source_digest()]
    assert module.source_digest() == digests[0]
    for path in sorted(folder.glob("*.py")):
        path.write_text(path.read_text("utf-8") + "# changed\n", "utf-8")
        digests.append(module.source_digest())
    (folder / "wear.py").rename(folder / "tear.py")
    digests.append(module.source_digest())
    (folder / "deeper").mkdir()
    (folder / "deeper" / "wind.py").write_text("")
    assert module.source_digest() == digests[-1]
    (folder / "deeper" / "wind.py").rename(folder / "wind.py")
    digests.append(module.source_digest())
    assert len(set(digests)) == len(digests)


def test_the_digest_is_of_a_folder_s_sources_and_nothing_else(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "copy", ignore=shutil.ignore_patterns("*.toml", "__pycache__"))
    assert source_digest(tmp_path / "copy") == source_digest(PACKAGE) == source_digest()


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_the_compiler_s_cache_is_keyed_by_the_digest():
    from turning_env.batch import driver as lathes
    from turning_env.batch import single as lone_lathe

    for entry in (lathes._first_unfit, lathes._start_lanes, lathes._step_blocks, lone_lathe._step_lone):
        assert source_digest() in [cell.cell_contents for cell in entry.py_func.__closure__]
