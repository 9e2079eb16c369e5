"""Machine code on disk: processes share it, and nothing stale is used."""

import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests import preloaded
from tests.walking import MAX_SECONDS, ROOT

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled"),
]

# The package without its __init__.py, whose imports take longer than all else here.
MODULE = f"""
import sys, types
package = sys.modules["turning_env"] = types.ModuleType("turning_env")
package.__path__ = [{str(ROOT / "turning_env")!r}]
from helper import factor
from turning_env.numerics.compilation import compiled_entry

@compiled_entry
def last(values):
    return factor() * values[-1]
"""
HELPER = """
from numba.extending import register_jitable

@register_jitable
def factor():
    return 1.0
"""
# Bytecode would hide a source that is changed, to one of the same size, within a second.
PROGRAM = """
import sys
sys.dont_write_bytecode = True
import numpy as np
from entry import last
print(last(np.arange(3.0)))
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    sources = tmp_path / "sources"
    sources.mkdir()
    (sources / "entry.py").write_text(MODULE)
    (sources / "helper.py").write_text(HELPER)
    return sources


def run(folder: Path, before: str = "", **variables: str) -> "subprocess.CompletedProcess[str]":
    """Run the program in a process of its own, after some other code."""
    path = os.pathsep.join([str(folder), str(ROOT)])
    return preloaded.run(
        "shared",
        [*preloaded.PROGRAM, before + PROGRAM],
        folder=folder,
        max_seconds=MAX_SECONDS,
        variables={"PYTHONPATH": path} | variables,
    )


def notices(folder: Path, value: float = 2.0, before: str = "", **variables: str) -> str:
    """Run the program, which must print the value; return its notices."""
    finished = run(folder, before, **variables)
    assert finished.returncode == 0, finished.stderr
    assert float(finished.stdout) == value
    return finished.stderr


def code(folder: Path) -> list[Path]:
    return sorted((folder / "__pycache__").glob("machine_code-*/*/*.nb?"))


def test_processes_that_start_together_share_their_code(folder: Path) -> None:
    with ThreadPoolExecutor(3) as threads:
        list(threads.map(notices, [folder] * 3))
    assert len(code(folder)) == 2
    assert notices(folder) == ""


def test_code_of_older_sources_is_neither_used_nor_kept(folder: Path) -> None:
    notices(folder)
    before = code(folder)
    (folder / "helper.py").write_text(HELPER.replace("1.0", "3.0"))
    notices(folder, 6.0)
    assert code(folder)
    assert not set(before) & set(code(folder))


SLOWLY_COMPILED = """
import time
from numba.extending import overload

def factor():
    return 1.0

@overload(factor)
def compiled_factor():
    time.sleep(2.5)
    return lambda: 1.0
"""


def test_a_notice_on_stderr_says_what_takes_seconds_to_compile(folder: Path) -> None:
    (folder / "helper.py").write_text(SLOWLY_COMPILED)
    (notice,) = notices(folder).splitlines()
    assert "compiling last for this machine, once" in notice
    # Kept code takes no notice.
    assert notices(folder) == ""


READ_ONLY = """
import pathlib
make = pathlib.Path.mkdir
def refuse(path, *arguments, **names):
    if {folder!r} in str(path):
        raise PermissionError
    make(path, *arguments, **names)
pathlib.Path.mkdir = refuse
"""


@pytest.mark.parametrize("home", [True, False])
def test_code_compiled_beforehand_is_read_where_it_cannot_be_written(
    folder: Path, tmp_path: Path, home: bool
) -> None:
    """A container's user reads what its image holds.

    This holds whether or not the user's cache can be written to.
    """
    notices(folder)
    # Root can write everywhere, so that folders must refuse to be made.
    read_only = READ_ONLY.format(folder=str(folder))
    cache = tmp_path / "home" if home else folder / "entry.py" / "home"
    assert notices(folder, before=read_only, XDG_CACHE_HOME=str(cache)) == ""
    assert home == any(tmp_path.glob("home/**/*.nbc"))


NO_TEMPORARY_FOLDER = """
import tempfile
def refuse():
    raise FileNotFoundError
tempfile.gettempdir = refuse
"""


def test_without_any_folder_to_write_to_entries_run_with_a_warning(folder: Path) -> None:
    """A read-only container without a folder for temporary files plays, too."""
    notices(folder)
    read_only = READ_ONLY.format(folder=str(folder))
    cache = folder / "entry.py" / "home"
    warning = notices(folder, before=read_only + NO_TEMPORARY_FOLDER, XDG_CACHE_HOME=str(cache))
    assert "compiled code cannot be kept" in warning


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_code_that_is_cut_off_ends_in_an_error_until_it_is_deleted(
    folder: Path, suffix: str
) -> None:
    notices(folder)
    (damaged,) = (path for path in code(folder) if path.suffix == suffix)
    damaged.write_bytes(damaged.read_bytes()[: damaged.stat().st_size // 2])
    failed = run(folder)
    assert failed.returncode == 1
    assert "numba" in failed.stderr
    assert "Error" in failed.stderr.splitlines()[-1]
    (machine_code,) = (folder / "__pycache__").glob("machine_code-*")
    shutil.rmtree(machine_code)
    notices(folder)
