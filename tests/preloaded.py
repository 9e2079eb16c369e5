"""Run ``python -m`` in forks of a process that has imported other projects' libraries.

A process of its own imports them for one to four seconds, which is most of what a command of a
page costs. A fork has them from the start, and nothing of this project: it imports that from the
folder in which it runs, as any process does.

As a program, this module is that process. It reads a request a line, and answers with the exit
status.
"""

import atexit
import functools
import gc
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

SHARED = ("gymnasium", "numba", "numpy", "pydantic")
TRAINING = (*SHARED, "onnx", "stable_baselines3", "torch")
LIBRARIES = {
    "baselines": SHARED,
    "leaderboard": SHARED,
    "train": TRAINING,
    "turning_env": SHARED,
}
"""Libraries to import before a fork, by the package of its program."""


def is_served(words: list[str]) -> bool:
    """Return whether a command runs a module whose libraries are known."""
    if len(words) < 3 or words[:2] != [sys.executable, "-m"]:
        return False
    package, _, _ = words[2].partition(".")
    return package in LIBRARIES


def run(words: list[str], folder: Path, max_seconds: float) -> "subprocess.CompletedProcess[str]":
    """Run ``python -m MODULE ...`` in a folder, in a fork; see ``is_served``.

    Its status is that of SIGALRM if it takes more than ``max_seconds`` [s].
    """
    package, _, _ = words[2].partition(".")
    variables = dict(os.environ)
    # pytest sets another with every test.
    variables.pop("PYTEST_CURRENT_TEST", None)
    server = started(LIBRARIES[package], tuple(sorted(variables.items())))
    with tempfile.TemporaryDirectory() as outputs:
        request = {
            "words": words[2:],
            "folder": str(folder),
            "outputs": outputs,
            "max_seconds": max_seconds,
        }
        assert server.stdin is not None
        assert server.stdout is not None
        try:
            print(json.dumps(request), file=server.stdin, flush=True)
            status = int(server.stdout.readline())
        except BaseException:
            # A later request must not read the answer to this one.
            server.kill()
            started.cache_clear()
            raise
        return subprocess.CompletedProcess(
            words,
            status,
            stdout=Path(outputs, "stdout").read_text("utf-8"),
            stderr=Path(outputs, "stderr").read_text("utf-8"),
        )


@functools.cache
def started(
    libraries: tuple[str, ...], variables: tuple[tuple[str, str], ...]
) -> "subprocess.Popen[str]":
    """Return a process that has imported libraries, with these environment variables."""
    server = subprocess.Popen(
        [sys.executable, __file__, *libraries],
        env=dict(variables),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    # It ends at the end of its requests.
    atexit.register(server.communicate)
    return server


def serve() -> list[str]:
    """Answer requests until there are none; in each fork, return its module and arguments."""
    for line in sys.stdin:
        request = json.loads(line)
        child = os.fork()
        if child == 0:
            signal.setitimer(signal.ITIMER_REAL, request["max_seconds"])
            prepare(Path(request["folder"]), Path(request["outputs"]))
            return list(request["words"])
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)
    return []


def prepare(folder: Path, outputs: Path) -> None:
    """Give a fork the folder and the streams of a process of its own."""
    os.chdir(folder)
    # python -m starts with the folder.
    sys.path.insert(0, str(folder))
    redirect(0, Path(os.devnull), os.O_RDONLY)
    redirect(1, outputs / "stdout", os.O_WRONLY | os.O_CREAT)
    redirect(2, outputs / "stderr", os.O_WRONLY | os.O_CREAT)


def redirect(stream: int, path: Path, flags: int) -> None:
    """Let the number of a stream stand for a file."""
    opened = os.open(path, flags)
    os.dup2(opened, stream)
    os.close(opened)


if __name__ == "__main__":
    _, *libraries = sys.argv
    # The folder of this file.
    del sys.path[0]
    for name in libraries:
        import_module(name)
    # What was imported stays shared between the forks.
    gc.collect()
    gc.freeze()
    requested = serve()
    if requested:
        sys.argv = requested
        runpy.run_module(requested[0], run_name="__main__", alter_sys=True)
