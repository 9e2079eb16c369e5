"""The process that checks and runs a network that enters a leaderboard.

Its parent is ``onnx_policy.py``. The process checks the file before anything runs it, and the
network's actions while it plays. ``leaderboard/agents/sandbox_child.py`` confines the process and
exchanges its messages.
"""

from typing import Any

import numpy as np

from leaderboard.agents import network, sandbox_child
from leaderboard.agents.onnx_session import Floats, OnnxPolicy
from leaderboard.agents.sandbox_child import Outline

# The first actions are checked, and then one of so many at random, which no network can foresee.
_FIRST_CHECKS = 2
_CHECK_EVERY = 32


class CheckedNetwork:
    """A network that is plain arithmetic of moderate size, and acts reproducibly."""

    def read(self, content: bytes) -> Outline:
        """Return the outline, or raise ValueError if the file is not plain arithmetic."""
        self._content = content
        self._model, self._outline = network.read(content)
        return self._outline

    def session(self) -> Any:
        """Return the session. Raise ValueError if sizes are too large, or a trial fails."""
        network.check_sizes(self._model)
        del self._model
        self._generator = np.random.default_rng()
        outline = self._outline
        return network.session_after_trial(
            self._content,
            entries=outline.inputs["observation"],
            actions=outline.outputs["action"],
            memory_size=outline.inputs.get("memory", 0),
        )

    def act(self, policy: OnnxPolicy, observations: Floats, call: int) -> Floats:
        """Return a policy's actions, and check some of them.

        Raises:
            ValueError: actions depend on more than the observations.
        """
        if call < _FIRST_CHECKS or self._generator.integers(_CHECK_EVERY) == 0:
            return network.act_checked(policy, observations, self._generator)
        return policy.act(observations)


def main(memory: int, computing: int) -> None:
    """Serve the parent process; ``memory`` [MiB] and ``computing`` [s] are limits."""
    sandbox_child.run(CheckedNetwork(), memory, computing)
