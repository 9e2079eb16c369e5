"""Load an agent's ONNX file, which may come from anywhere, and play it in a process of its own, without PyTorch.

from pathlib import Path
from train.agents import onnx_policy

agent = onnx_policy.load(Path("ppo-seed0.onnx"))
policy = agent.make(1)
"""

from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from train.agents import agent_file
from train.agents.agent_file import AgentFile
from train.agents.sandbox import LIMITS, GuardedPolicy, Limits, TooSlow, examined
from turning_env.scoring.policy import PolicySpec

_examined = lru_cache(64)(examined)
"""One file plays many scenarios."""


@dataclass(frozen=True)
class _Maker:
    """Makes policies of a file. To another process it travels as the file."""

    file: AgentFile
    limits: Limits

    def __call__(self, num_envs: int) -> GuardedPolicy:
        return GuardedPolicy(self.file, num_envs, self.limits)


def load(path: Path, limits: Limits = LIMITS) -> PolicySpec:
    """Load an agent from its file, which may come from anywhere: it is checked, can run no code, and plays within limits.

    Args:
        path: the file.
        limits: what it may use each time it plays.

    Raises:
        TooSlow: it gives no actions in time.
        ValueError: it is not an agent's file, or one that is not trusted; says why.
        OSError: it cannot be read.
        ModuleNotFoundError: what runs such files is not installed.
    """
    for name in ("onnx", "onnxruntime"):  # of the process that looks at the file and plays it
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    content = agent_file.read_content(path)
    try:
        file = _examined(content)
    except TooSlow as error:
        raise TooSlow(f"{path}: {error}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return agent_file.trained_policy(file.metadata, file.metadata.trained_steps, file.digest, _Maker(file, limits))
