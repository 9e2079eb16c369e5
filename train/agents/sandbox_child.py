"""The process in which a stranger's network is looked at and run. It holds that file, observations and actions, and nothing else.

It is started afresh, with none of the environment's variables, and limits itself before it sees the file: in memory and
computing time, to writing no file, and to opening nothing, neither files nor connections. It imports nothing of the
environment, which it must not know. See ``onnx_guard.py`` for the other side, which starts ``main``.
"""

import contextlib
import json
import socket

import numpy as np

from train.agents import wire as onnx_wire
from train.agents.wire import Wire

CHECK, PLAY = "check", "play"
"""What a child is for: to look at a file, or to act by it."""
_MAX_ASKED = 2**31
_SURE = 2
"""So many first actions are checked."""
_RARELY = 32
"""Of later ones, one of so many, which no network can foresee."""


def main(purpose: str, memory: int, computing: int) -> None:
    """Serve the process that has started this one, by the socket that is its standard input, until that is closed.

    Args:
        purpose: ``CHECK`` or ``PLAY``.
        memory: MiB that may be used.
        computing: seconds of processor time that may be used.
    """
    wire = Wire(socket.socket(fileno=0))
    try:
        from train.agents import session as onnx_session

        onnx_session.runtime()  # before nothing can be opened any more
        if purpose == CHECK:
            from train.agents import graph as plain_graph  # noqa: F401
        limit(memory, computing)
        try:
            (_check if purpose == CHECK else _play)(wire)
        except ValueError as error:
            wire.send(onnx_wire.ERROR, onnx_session.first_line(error).encode())
    except EOFError:
        return
    except MemoryError:
        wire.send(onnx_wire.ERROR, f"needs more than the {memory} MiB of memory that it may have".encode())
    except Exception as error:
        wire.send(onnx_wire.ERROR, f"{type(error).__name__}: {error}"[:500].encode())


def limit(memory: int, computing: int) -> None:
    """Allow this process so many MiB of memory and seconds of processor time, and to open or write nothing."""
    try:
        import resource
    except ImportError:  # not on Windows: there the waiting process alone sees to the time
        return
    np.random.default_rng().permutation(2)  # what it needs to open, if anything, is opened
    limits = {
        resource.RLIMIT_AS: (memory * 2**20, memory * 2**20),
        resource.RLIMIT_CPU: (computing, computing + 5),  # ended at the first by a signal that says why
        resource.RLIMIT_CORE: (0, 0),
        resource.RLIMIT_FSIZE: (0, 0),
        resource.RLIMIT_NOFILE: (3, 3),
    }
    for what, most in limits.items():
        with contextlib.suppress(ValueError, OSError):  # where a system lacks one: macOS has none of memory
            resource.setrlimit(what, most)


def _check(wire: Wire) -> None:
    """Say what a file says of itself; if that is right, see that it can be run."""
    from train.agents import graph as plain_graph
    from train.agents import session as onnx_session

    _, content = wire.receive(plain_graph.MAX_BYTES + 1)
    model, outline = plain_graph.read(content)
    wire.send(onnx_wire.ANSWER, json.dumps(outline._asdict()).encode())
    wire.receive(0)
    plain_graph.check_sizes(model)
    del model
    memory_size = outline.inputs.get("memory", 0)
    onnx_session.tried(content, outline.inputs["observation"], outline.outputs["action"], memory_size)
    wire.send(onnx_wire.ANSWER)


def _play(wire: Wire) -> None:
    """Act on observations."""
    from train.agents.session import OnnxPolicy, session_of

    _, content = wire.receive(_MAX_ASKED)
    session = session_of(content)
    _, told = wire.receive(24)
    lanes, entries, memory_size = (int(number) for number in np.frombuffer(told, np.int64))
    policy = OnnxPolicy(session, memory_size, lanes)
    wire.send(onnx_wire.ANSWER)
    generator, acts = np.random.default_rng(), 0
    while True:
        kind, told = wire.receive(_MAX_ASKED)
        if kind == onnx_wire.RESET:
            policy.reset(np.frombuffer(told, np.bool_))
            continue
        observations = np.frombuffer(told, np.float32).reshape(lanes, entries)
        acts += 1
        checked = acts <= _SURE or generator.integers(_RARELY) == 0
        actions = policy.act_checked(observations, generator) if checked else policy.act(observations)
        wire.send(onnx_wire.ANSWER, np.ascontiguousarray(actions, np.float32).tobytes())
