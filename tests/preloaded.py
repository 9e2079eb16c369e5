"""Run ``python -m`` and ``python -W error -c`` in forks of a process that has imported libraries.

A process of its own imports them for one to four seconds, which is most of what a command of a
page costs. A fork has them from the start, and nothing of this project: it imports that from the
folder in which it runs, as any process does. Warnings while they are imported are no errors of a
program; the suite itself imports them with warnings as errors.

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
import types
import warnings
from importlib import import_module
from pathlib import Path

SHARED = ("gymnasium", "numba", "numpy", "pydantic")
# The first optimiser of a process imports torch._dynamo, for more than a second.
TRAINING = (*SHARED, "onnx", "stable_baselines3", "torch", "torch._dynamo")
LIBRARIES = {
    "baselines": SHARED,
    "leaderboard": SHARED,
    "train": TRAINING,
    "turning_env": SHARED,
}
"""Libraries to import before a fork, by the package of its program."""
MODULE = [sys.executable, "-m"]
PROGRAM = [sys.executable, "-W", "error", "-c"]


def libraries_of(words: list[str]) -> tuple[str, ...] | None:
    """Return the libraries of a command; None if it is to run in a process of its own."""
    if words[:2] == MODULE and len(words) > 2:
        package, _, _ = words[2].partition(".")
        return LIBRARIES.get(package)
    if words[:-1] == PROGRAM:
        return TRAINING if "import torch" in words[-1] else SHARED
    return None


def run(
    words: list[str], libraries: tuple[str, ...], folder: Path, max_seconds: float
) -> "subprocess.CompletedProcess[str]":
    """Run a command in a folder, in a fork that has its libraries; see ``libraries_of``.

    Its status is that of SIGALRM if it takes more than ``max_seconds`` [s].
    """
    variables = dict(os.environ)
    # pytest sets another with every test.
    variables.pop("PYTEST_CURRENT_TEST", None)
    server = started(libraries, tuple(sorted(variables.items())))
    with tempfile.TemporaryDirectory() as outputs:
        request = {
            "words": words[1:],
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
    """Answer requests until there are none; in each fork, return the arguments of its Python."""
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


def act(arguments: list[str]) -> None:
    """Do what Python does with these arguments."""
    if arguments[0] == "-m":
        sys.argv = arguments[1:]
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
    else:
        warnings.simplefilter("error")
        sys.argv = ["-c"]
        main = types.ModuleType("__main__")
        sys.modules["__main__"] = main
        exec(compile(arguments[-1], "<string>", "exec"), vars(main))


if __name__ == "__main__":
    _, *names = sys.argv
    # The folder of this file.
    del sys.path[0]
    for name in names:
        import_module(name)
    # What was imported stays shared between the forks.
    gc.collect()
    gc.freeze()
    requested = serve()
    if requested:
        act(requested)
