"""The process that runs a stranger's network. It holds that file, observations and actions alone.

It starts with an empty environment and confines itself (``confinement.py``) before it sees the
file. It imports nothing of the environment that is played, which it must not know. ``sandbox.py``
is the parent, which starts ``main``; ``messages.py`` has the messages of both. A network that
enters a leaderboard has more checks: ``network.py``.
"""

import json
import socket
from typing import Any, Protocol

import numpy as np

from leaderboard.agents import confinement, onnx_session
from leaderboard.agents.messages import (
    ANSWER,
    ANY,
    ERROR,
    MAX_REQUEST,
    MEASURES,
    RESET,
    SIZES,
    Connection,
    Outline,
    is_short,
)
from leaderboard.agents.onnx_session import Floats, OnnxPolicy

_ALL_INSIDE = (
    "all must be inside the file: export it with torch.onnx.export(..., external_data=False)"
)


class Network(Protocol):
    """A network from a file, in the process that runs it: how it is checked and how it acts."""

    def read(self, content: bytes) -> Outline:
        """Take a file's content and return its outline, or raise ValueError if it is refused."""

    def session(self) -> Any:
        """Return ONNX Runtime's session of the file; it is called once, before the first policy.

        Raise ValueError if the file is refused.
        """

    def act(self, policy: OnnxPolicy, observations: Floats, call: int) -> Floats:
        """Return a policy's actions, or raise ValueError if they are refused.

        ``call`` counts the calls of the policy from 0 on.
        """


class PlainNetwork:
    """Any network with the inputs and outputs of a policy."""

    def read(self, content: bytes) -> Outline:
        """Return the outline, or raise ValueError if ONNX Runtime cannot run the file."""
        try:
            self._session = onnx_session.session_of(content)
        except ValueError as error:
            if "external" in str(error).lower():
                raise ValueError(f"keeps its weights in another file, but {_ALL_INSIDE}") from error
            raise
        onnx_session.check_inputs(self._session)
        properties = self._session.get_modelmeta().custom_metadata_map
        return Outline(
            # Other libraries may write anything there.
            properties=properties if is_short(properties) else {},
            inputs={node.name: _entries(node.shape) for node in self._session.get_inputs()},
            outputs={node.name: _entries(node.shape) for node in self._session.get_outputs()},
        )

    def session(self) -> Any:
        """Return the session."""
        return self._session

    def act(self, policy: OnnxPolicy, observations: Floats, call: int) -> Floats:
        """Return the actions as they are, which are checked by the parent."""
        return policy.act(observations)


def _entries(shape: Any) -> int:
    size = shape[-1] if shape else ANY
    return size if isinstance(size, int) else ANY


def main(memory: int, computing: int, strict: bool) -> None:
    """Run a network with the inputs and outputs of a policy: any, or a ``strict`` one of them.

    See ``sandbox.Sandbox`` for the limits ``memory`` [MiB] and ``computing`` [s], and for
    ``strict``.
    """
    network: Network = PlainNetwork()
    if strict:
        # It imports the package onnx, which other networks do without.
        from leaderboard.agents.network import StrictNetwork

        network = StrictNetwork()
    run(network, memory, computing)


def run(network: Network, memory: int, computing: int) -> None:
    """Serve the parent process over the socket on standard input.

    ``memory`` [MiB] and ``computing`` [s of processor time] are limits.
    """
    parent = Connection(socket.socket(fileno=0))
    try:
        _open_what_is_needed()
        measures = confinement.limit(memory, computing)
        parent.send(MEASURES, ",".join(measures).encode())
        _serve(parent, network)
    except EOFError:
        return
    except MemoryError:
        parent.send(ERROR, f"needs more than the {memory} MiB of memory that it may have".encode())
    except ValueError as error:
        parent.send(ERROR, onnx_session.first_line(error).encode())
    except Exception as error:
        parent.send(ERROR, f"{type(error).__name__}: {error}"[:500].encode())


def _open_what_is_needed() -> None:
    """Load libraries, and have them open what they need, while files can still be opened."""
    onnx_session.runtime()
    np.random.default_rng().permutation(2)


def _serve(parent: Connection, network: Network) -> None:
    """Send the outline of a file, then make policies of its network, and answer for them.

    Each ``SIZES`` makes a new policy, which takes the place of the last.
    """
    _, content = parent.receive(MAX_REQUEST)
    outline = network.read(content)
    parent.send(ANSWER, json.dumps(outline._asdict()).encode())
    del content
    session = None
    while True:
        kind, content = parent.receive(MAX_REQUEST)
        if kind == SIZES:
            if session is None:  # the parent has accepted the outline
                session = network.session()
            num_envs, memory_size = np.frombuffer(content, np.int64).tolist()
            policy = OnnxPolicy(session, memory_size, num_envs)
            calls = 0
            parent.send(ANSWER)
        elif kind == RESET:
            policy.reset(np.frombuffer(content, np.bool_))
        else:
            observations = np.frombuffer(content, np.float32).reshape(num_envs, -1)
            actions = network.act(policy, observations, calls)
            calls += 1
            parent.send(ANSWER, _as_bytes(actions, num_envs))


def _as_bytes(actions: Floats, num_envs: int) -> bytes:
    if actions.ndim != 2 or len(actions) != num_envs or actions.dtype != np.float32:
        raise ValueError(
            f"gives actions that are {actions.dtype} of shape {actions.shape}, "
            f"but must be float32 of shape ({num_envs}, actions): {onnx_session.EXPORT}"
        )
    return np.ascontiguousarray(actions).tobytes()
