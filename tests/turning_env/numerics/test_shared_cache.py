"""Machine code on disk: what several processes keep there at a time is each one's own, and what is damaged is made anew."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.walking import MAX, ROOT
from turning_env import RoughTurningEnv, RoughTurningVectorEnv
from turning_env.batch import driver
from turning_env.family_env import FamilyEnv, FamilyVectorEnv

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled"),
]

# The package without its __init__.py, whose imports take longer than all else here.
BARE = f"""
import sys, types
package = sys.modules["turning_env"] = types.ModuleType("turning_env")
package.__path__ = [{str(ROOT / "turning_env")!r}]
"""
MODULE = f"""{BARE}
from turning_env.numerics.compilation import compiled_entry

@compiled_entry
def last(values):
    return values[values.shape[0] - 1]
"""
# Compiled for types of different widths, beginning with another one in each process.
PROGRAM = """
import sys, numpy as np
from entry import last
types = ["u1", "i4", "f8"]
first = int(sys.argv[1])
for name in types[first:] + types[:first]:
    assert last(np.arange(100, 110).astype(name)) == 109, name
print(len(last.stats.cache_hits), len(last.stats.cache_misses))
"""


def run(folder: Path, first: int, program: str = PROGRAM, **more: str) -> "subprocess.Popen[str]":
    variables = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])} | more
    return subprocess.Popen(
        [sys.executable, "-c", program, str(first)],
        cwd=folder,
        env=variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finished(process: "subprocess.Popen[str]") -> tuple[str, str]:
    out, error = process.communicate(timeout=MAX)
    assert process.returncode == 0, error
    return out, error


def test_processes_that_compile_at_the_same_time_keep_all_that_they_made(tmp_path: Path) -> None:
    (tmp_path / "entry.py").write_text(MODULE)
    outs = [finished(process)[0] for process in [run(tmp_path, first) for first in range(3)]]
    assert sum(int(out.split()[1]) for out in outs) == 3  # others wait for what one compiles
    assert len(list((tmp_path / "__pycache__").glob("*.nbc"))) == 3
    assert finished(run(tmp_path, 0))[0] == "3 0\n"


SLOW_MODULE = f"""{BARE}
import time
from numba.extending import overload
from turning_env.numerics.compilation import compiled_entry

def slow(): ...

@overload(slow)
def type_of_slow():
    print("compiling", flush=True)
    time.sleep(SECONDS)
    raise ValueError

@compiled_entry
def entry():
    slow()
"""
SLOW_PROGRAM = """
import time
from entry import entry
try:
    entry()
except ValueError:
    print("failed", flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize(("seconds", "last"), [(600, "compiling\n"), (0, "failed\n")])
def test_a_compilation_that_is_killed_or_fails_lets_others_compile(tmp_path: Path, seconds: int, last: str) -> None:
    """The first process is killed while it compiles, or fails and lives on."""
    (tmp_path / "entry.py").write_text(SLOW_MODULE.replace("SECONDS", str(seconds)))
    with run(tmp_path, 0, program=SLOW_PROGRAM) as first:
        assert first.stdout is not None
        for line in first.stdout:
            if line == last:
                break
        if seconds:
            first.kill()
        with run(tmp_path, 0, program=SLOW_PROGRAM) as second:
            assert second.stdout is not None
            assert second.stdout.readline() == "compiling\n"
            second.kill()
        first.kill()


@pytest.mark.parametrize("writable", [False, True])
def test_what_was_compiled_beforehand_is_read_where_it_cannot_be_written(tmp_path: Path, writable: bool) -> None:
    """A container's user reads what its image holds, whether or not another folder can be written."""
    (tmp_path / "entry.py").write_text(MODULE)
    finished(run(tmp_path, 0))
    # Root can write everywhere, so the locators are told that they cannot.
    code = "from numba.core import caching\ndef refuse(locator): raise PermissionError\n"
    for name in ("InTree", "UserWide")[: 1 if writable else 2]:
        code += f"caching.{name}CacheLocator.ensure_cache_path = refuse\n"
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(code)
    path = os.pathsep.join(map(str, (site, tmp_path, ROOT)))
    assert finished(run(tmp_path, 0, XDG_CACHE_HOME=str(tmp_path / "home"), PYTHONPATH=path))[0] == "3 0\n"


def test_where_no_folder_can_be_written_it_goes_without(tmp_path: Path) -> None:
    (tmp_path / "entry.py").write_text(MODULE)
    (tmp_path / "__pycache__").touch()  # no folder, so not even root can write in it
    nowhere = str(tmp_path / "entry.py" / "home")
    out, error = finished(run(tmp_path, 0, HOME=nowhere, XDG_CACHE_HOME=nowhere))
    assert out == "0 3\n"
    assert error.count("compiled code cannot be kept in") == 1


def test_where_there_is_no_room_it_goes_on(tmp_path: Path) -> None:
    (tmp_path / "entry.py").write_text(MODULE)
    code = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"  # as a full disk: EFBIG for ENOSPC
    (tmp_path / "sitecustomize.py").write_text(code + "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n")
    out, error = finished(run(tmp_path, 0))
    assert out == "0 3\n"
    assert "compiled code cannot be kept in" in error
    (tmp_path / "sitecustomize.py").unlink()
    assert finished(run(tmp_path, 0))[0] == "0 3\n"
    assert finished(run(tmp_path, 0))[0] == "3 0\n"


def test_what_is_damaged_is_made_anew(tmp_path: Path) -> None:
    (tmp_path / "entry.py").write_text(MODULE)
    finished(run(tmp_path, 0))
    for ending in ("nbc", "nbi"):
        for path in (tmp_path / "__pycache__").glob(f"*.{ending}"):
            path.write_bytes(path.read_bytes()[:50])
        out, error = finished(run(tmp_path, 0))
        assert int(out.split()[1]) > 0
        assert "cannot be read" in error
    assert finished(run(tmp_path, 0))[0] == "3 0\n"


@pytest.mark.parametrize("entry", [driver.start_episodes, driver.step_blocks], ids=lambda entry: entry.__name__)
def test_an_entry_takes_records_of_one_type_whatever_is_played(entry):
    """Numba's names of machine code would clash between processes otherwise: see ``compiled_entry``. A family adds its jobs."""
    for env in (
        RoughTurningEnv(),
        RoughTurningEnv("batch_casting"),
        RoughTurningVectorEnv(3),
        RoughTurningVectorEnv(1024, "shift"),
        FamilyEnv(),
        FamilyVectorEnv(3),
    ):
        env.reset(seed=0)
        env.step(env.action_space.sample())
    assert len({signature[:2] for signature in entry.signatures}) == 1
    assert len({signature[2] for signature in entry.signatures}) == len(entry.signatures) == 2
