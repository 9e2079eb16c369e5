"""Load an agent's ONNX file, which may come from anywhere, and play it without PyTorch.

    from pathlib import Path
    from leaderboard.agents import onnx_policy

    agent = onnx_policy.load(Path("ppo-seed0.onnx"))
    policy = agent.make(1)

The file is played in a sandbox (``sandbox.py``), which checks its network; ``agent_file.py`` checks
its metadata. This side never looks into the file itself.
"""

from contextlib import closing
from functools import lru_cache
from pathlib import Path

from baselines.policy_spec import PolicySpec
from leaderboard.agents import agent_file, sandbox
from leaderboard.agents.agent_file import AgentFile, trained_policy
from leaderboard.agents.sandbox import (
    LIMITS,
    AgentFileError,
    GuardedPolicy,
    PolicyMaker,
    ProcessLimits,
    Sandbox,
)


def load(path: Path, limits: ProcessLimits = LIMITS) -> PolicySpec:
    """Load an agent from its file, which may come from anywhere.

    The file is checked, can run no code, and each play has limits. Errors of the agent's policies
    are AgentFileErrors, too.

    Raises:
        AgentTimeoutError: the agent gives no actions in time; this is an AgentFileError.
        AgentFileError: the file is refused or cannot be read.
        ModuleNotFoundError: onnx or onnxruntime is not installed.
    """
    sandbox.require("onnx", "onnxruntime")
    try:
        content = agent_file.read_content(path)
    except ValueError as error:  # it names the file
        raise AgentFileError(str(error)) from error
    try:
        file = _checked(content)
    except AgentFileError as error:
        raise type(error)(f"{path}: {error}") from error
    # Every policy has a process of its own, which checks the file again.
    make = PolicyMaker(content, limits, strict=True)
    return trained_policy(file.metadata, file.metadata.trained_steps, file.digest, make)


@lru_cache(64)
def _checked(content: bytes) -> AgentFile:
    """Check a file once, as it plays many scenarios."""
    with closing(Sandbox(content, strict=True)) as opened:
        try:
            file = agent_file.of_outline(content, opened.outline)
        except ValueError as error:
            raise AgentFileError(str(error)) from error
        GuardedPolicy(opened, num_envs=1)  # tries the network
        return file
