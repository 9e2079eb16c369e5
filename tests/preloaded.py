"""Run Python's commands in forks of processes that have imported libraries.

A process of its own imports them for one to four seconds, which is most of what a command of a
page costs. A fork has them from the start, and nothing of this project: it imports that from the
folder in which it runs, as any process does. Warnings while they are imported are no errors of a
program; the suite itself imports them with warnings as errors.

As a program, this module is a process that forks, or a stand-in for Python: what other programs,
such as ``make``, start in its place.
"""

import atexit
import contextlib
import functools
import gc
import json
import os
import runpy
import select
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import types
import warnings
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

LIBRARIES = {
    "shared": ("gymnasium", "numba", "numpy", "pydantic"),
    # The first optimiser of a process imports torch._dynamo, for more than a second, and the first
    # export networkx.
    "training": ("networkx", "onnx", "onnxscript", "stable_baselines3", "torch", "torch._dynamo"),
}
"""Libraries that a process imports before it forks, by the name of the process."""
PROCESSES = {
    "baselines": "shared",
    "leaderboard": "shared",
    "train": "training",
    "turning_env": "shared",
    "turning_shop": "shared",
}
"""The process that is forked for a command, by the package of its program."""
MODULE = "-m"
PROGRAM = ["-W", "error", "-c"]


def process_of(arguments: list[str]) -> str | None:
    """Return the process to fork for Python's arguments; None if Python itself has to run them."""
    if arguments[:1] == [MODULE] and len(arguments) > 1:
        package, _, _ = arguments[1].partition(".")
        return PROCESSES.get(package)
    if arguments[:-1] == PROGRAM:
        learns = any(name in arguments[-1] for name in ("import torch", "stable_baselines3"))
        return "training" if learns else "shared"
    return None


def run(
    process: str,
    arguments: list[str],
    folder: Path,
    max_seconds: float,
    variables: Mapping[str, str] = MappingProxyType({}),
) -> "subprocess.CompletedProcess[str]":
    """Run Python's arguments in a folder, in a fork of a process; see ``process_of``.

    ``variables`` are set beside those of this process. The status is that of SIGALRM if the command
    takes more than ``max_seconds`` [s].
    """
    with (
        open(os.devnull) as nothing,
        tempfile.TemporaryFile("w+", encoding="utf-8") as output,
        tempfile.TemporaryFile("w+", encoding="utf-8") as errors,
    ):
        status = request(
            address=Path(addresses(), process),
            arguments=arguments,
            folder=folder,
            variables=_own_variables() | dict(variables),
            max_seconds=max_seconds,
            streams=[nothing, output, errors],
        )
        output.seek(0)
        errors.seek(0)
        return subprocess.CompletedProcess(arguments, status, output.read(), errors.read())


def write_stand_in(path: Path, max_seconds: float) -> None:
    """Write a program that does what this Python does, in a fork if ``process_of`` names one."""
    # Without site-packages, Python starts in some milliseconds.
    words = [sys.executable, "-I", "-S", __file__, "python"]
    words += [sys.executable, addresses(), str(max_seconds)]
    path.write_text(f'#!/bin/sh\nexec {shlex.join(words)} "$@"\n')
    path.chmod(0o755)


def addresses() -> str:
    """Return the folder of the sockets of the processes, which have this process's variables."""
    return _started(tuple(sorted(_own_variables().items())))


def _own_variables() -> dict[str, str]:
    variables = dict(os.environ)
    # pytest sets another with every test.
    variables.pop("PYTEST_CURRENT_TEST", None)
    return variables


@functools.cache
def _started(variables: tuple[tuple[str, str], ...]) -> str:
    """Start the processes, which import their libraries when first asked for a fork."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    for name in LIBRARIES:
        listening = socket.socket(socket.AF_UNIX)
        listening.bind(str(Path(folder.name, name)))
        listening.listen()
        server = subprocess.Popen(
            [sys.executable, __file__, "serve", str(listening.fileno()), name],
            env=dict(variables),
            stdin=subprocess.PIPE,
            pass_fds=[listening.fileno()],
        )
        listening.close()
        # It ends at the end of its input.
        atexit.register(server.communicate)
    return folder.name


def request(
    address: Path,
    arguments: list[str],
    folder: Path,
    variables: dict[str, str],
    max_seconds: float,
    streams: list[IO[Any]],
) -> int:
    """Have a process at an address fork, and return the status of the command in the fork."""
    message = {
        "arguments": arguments,
        "folder": str(folder),
        "variables": variables,
        "max_seconds": max_seconds,
    }
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(address))
        socket.send_fds(connection, [b"\n"], [stream.fileno() for stream in streams])
        with connection.makefile("rw", encoding="utf-8") as lines:
            print(json.dumps(message), file=lines, flush=True)
            return int(lines.readline())


def python(
    executable: str, folder_of_addresses: str, max_seconds: str, arguments: list[str]
) -> None:
    """Do what an executable does with these arguments, in a fork if ``process_of`` names one."""
    process = process_of(arguments)
    if process is None:
        os.execv(executable, [executable, *arguments])
    status = request(
        address=Path(folder_of_addresses, process),
        arguments=arguments,
        folder=Path.cwd(),
        variables=dict(os.environ),
        max_seconds=float(max_seconds),
        streams=[sys.stdin, sys.stdout, sys.stderr],
    )
    # A shell adds 128 to the number of a signal.
    sys.exit(status if status >= 0 else 128 - status)


def serve(listening: socket.socket, name: str) -> list[str]:
    """Fork for every request until the input ends; return the arguments in each fork."""
    while True:
        ready, _, _ = select.select([listening, sys.stdin], [], [])
        # Without this wait, the forks' processor time is missing in that of the suite.
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG) != (0, 0):
                pass
        if sys.stdin in ready:
            return []
        connection, _ = listening.accept()
        import_libraries(name)
        with connection:
            if os.fork() == 0:
                listening.close()
                return answer(connection)


@functools.cache
def import_libraries(name: str) -> None:
    """Import the libraries of a process."""
    for library in LIBRARIES["shared"] + LIBRARIES[name]:
        import_module(library)
    # What was imported stays shared between the forks.
    gc.collect()
    gc.freeze()


def answer(connection: socket.socket) -> list[str]:
    """Fork for a request, wait for the fork and send its status; return the arguments in it."""
    _, streams, _, _ = socket.recv_fds(connection, 1, 3)
    with connection.makefile("rw", encoding="utf-8") as lines:
        message = json.loads(lines.readline())
        child = os.fork()
        if child != 0:
            _, status = os.waitpid(child, 0)
            print(os.waitstatus_to_exitcode(status), file=lines, flush=True)
            os._exit(0)
    signal.setitimer(signal.ITIMER_REAL, message["max_seconds"])
    prepare(message["folder"], message["variables"], streams)
    return list(message["arguments"])


def prepare(folder: str, variables: dict[str, str], streams: list[int]) -> None:
    """Give a fork the folder, the variables and the streams of a process of its own."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(variables)
    # python -m and -c look for modules in their folder first.
    python_path = variables.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:0] = [folder, *filter(None, python_path)]
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    # The process's own may have been files where these are pipes.
    sys.stdin = os.fdopen(0, closefd=False)
    sys.stdout = os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)


def act(arguments: list[str]) -> None:
    """Do what Python does with these arguments."""
    if arguments[0] == MODULE:
        # The first is "-m" while Python looks for the module, and then its path.
        sys.argv = [MODULE, *arguments[2:]]
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
    else:
        warnings.simplefilter("error")
        sys.argv = ["-c"]
        main = types.ModuleType("__main__")
        sys.modules["__main__"] = main
        exec(compile(arguments[-1], "<string>", "exec"), vars(main))


if __name__ == "__main__":
    _, mode, *words = sys.argv
    if mode == "python":
        python(words[0], words[1], words[2], words[3:])
    # The folder of this file.
    del sys.path[0]
    requested = serve(socket.socket(fileno=int(words[0])), words[1])
    if requested:
        act(requested)
