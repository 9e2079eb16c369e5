"""Load an agent's ONNX file, which may come from anywhere, and play it in a process of its own, without PyTorch.

from pathlib import Path
from train.agents import onnx_policy

agent = onnx_policy.load(Path("ppo-seed0.onnx"))
policy = agent.make(1)
"""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from train.agents import agent_file
from train.agents.agent_file import AgentFile
from train.agents.sandbox import LIMITS, GuardedPolicy, Limits, TooSlow, examined
from turning_env.scoring.policy import PolicyFactory, PolicySpec

Found = TypeVar("Found")


@lru_cache(64)
def _examined(content: bytes) -> AgentFile:
    """Examine a file once, as it plays many scenarios."""
    return examined(content)[0]


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
    file = _look(path, _examined)
    return _spec(file, _Maker(file, limits))


@contextmanager
def opened(path: Path, limits: Limits) -> Iterator[PolicySpec]:
    """Load an agent that plays one thing after another, all in the one process that checks its file; raises as ``load``.

    Args:
        path: the file.
        limits: what that process may use for all of it.
    """
    file, process = _look(path, lambda content: examined(content, limits))
    with closing(process):
        yield _spec(file, lambda num_envs: GuardedPolicy(file, num_envs, process=process))


@contextmanager
def in_one_process(make: PolicyFactory, plays: int) -> Iterator[PolicyFactory]:
    """Let an agent from a file play several things, one after another, in one process; another policy plays as ever.

    Args:
        make: makes the policy.
        plays: number of things; the process may use as much as one each.
    """
    if not isinstance(make, _Maker):
        yield make
        return
    file, limits = make.file, replace(make.limits, computing=plays * make.limits.computing)
    process = GuardedPolicy(file, 1, limits).process
    with closing(process):
        yield lambda num_envs: GuardedPolicy(file, num_envs, process=process)


def _look(path: Path, look: Callable[[bytes], Found]) -> Found:
    """Return what a look at a file's content finds; errors name the path."""
    for name in ("onnx", "onnxruntime"):  # of the process that looks at the file and plays it
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    content = agent_file.read_content(path)
    try:
        return look(content)
    except TooSlow as error:
        raise TooSlow(f"{path}: {error}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _spec(file: AgentFile, make: PolicyFactory) -> PolicySpec:
    return agent_file.trained_policy(file.metadata, file.metadata.trained_steps, file.digest, make)
