"""Agents and results that come with the project: one's own agents stand beside them under names of their own."""

import hashlib
from functools import cache
from pathlib import Path

from leaderboard.result import MANIFEST_FILE, Manifest, Task, read_part, result_folder, write_whole
from train.agents.agent_file import ONNX_SUFFIX
from turning_env.scoring.policy import PolicySpec

RESULTS = Path(__file__).parent / "results"
AGENTS = Path(__file__).parents[1] / "agents"


def agent_files(folder: Path) -> dict[str, Path]:
    """Return the agents' files in a folder and those below it, by their SHA-256."""
    return {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in sorted(folder.rglob(f"*{ONNX_SUFFIX}"))}


@cache
def agents() -> dict[str, str]:
    """Return the name of each agent that comes with the project, by its file's SHA-256."""
    return {digest: path.stem.rpartition("-seed")[0] for digest, path in agent_files(AGENTS).items()}


def is_own(policy: PolicySpec) -> bool:
    """Return whether a policy is an agent or code that does not come with the project."""
    return policy.kind == "agent" and policy.sha256 not in agents()


def start_results(folder: Path, task: Task) -> None:
    """Copy the results that come with the project into a folder that has no manifest yet, if they are on this task."""
    source = result_folder(RESULTS, task.env_id, task.scenario.name)
    manifest = source / MANIFEST_FILE
    if (folder / MANIFEST_FILE).exists() or not manifest.is_file() or read_part(Manifest, manifest).task.digest != task.digest:
        return
    for path in [*(each for each in source.glob("[!.]*.xz") if not (folder / each.name).exists()), manifest]:
        write_whole(folder / path.name, path.read_bytes())
