"""Results on validation seeds, with which ``leaderboard.score`` compares policies in development.

They are the ends of the score and the best rule. Nothing is ranked on these seeds.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

from baselines.comparators import CAUSAL, comparators
from baselines.policy_spec import PolicySpec
from leaderboard.family import family_task
from leaderboard.pack import Board, boards, returns_text, write_shipped
from leaderboard.pieces import Piece, attempt
from leaderboard.policies import named
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Result, ResultError, Task
from leaderboard.scoring import VALIDATION_FOLDER, VALIDATION_SEEDS
from leaderboard.seeds import tuning_seeds
from leaderboard.standings import best_rule
from turning_env import IDS, MODEL_VERSION, Scenario


def write(results: Path) -> Iterator[Path]:
    """Play the ends and the best rule of each leaderboard; yield the files that have changed.

    It takes some minutes. ``results`` are those that ship: they tell which rule is the best.
    """
    for board in boards():
        task = task_of(board, VALIDATION_SEEDS)
        played = [_play(name, task) for name in names_to_play(board, results)]
        text = returns_text(
            board.env_id, played, versions=versions(result.policy for result in played)
        )
        yield from write_shipped({VALIDATION_FOLDER / board.file_name: text})


def versions(policies: Iterable[PolicySpec]) -> dict[str, int]:
    """Return the versions of the model and of each policy, on which the returns depend."""
    return {"model": MODEL_VERSION} | {policy.name: policy.version for policy in policies}


def task_of(board: Board, seeds: int) -> Task:
    """Return the task on a leaderboard's first validation seeds or jobs."""
    if board.family is not None:
        return family_task(board.family, "validation", seeds)
    scenario = Scenario.load(IDS[board.env_id])
    return Task(env_id=board.env_id, scenario=scenario, seeds=tuning_seeds(seeds))


def names_to_play(board: Board, results: Path) -> list[str]:
    """Return the names of the policies that play: the score's ends, and the best rule."""
    leaderboard = read_leaderboard(board.folder(results))
    scenario = leaderboard.task.scenario
    fixed = comparators(scenario, on_family=board.family is not None).fixed
    best = best_rule(leaderboard.standings)
    # A set removes the rule that is an end itself.
    chosen = {fixed, CAUSAL}
    if best is not None:
        chosen.add(best.name)
    return sorted(chosen)


def _play(name: str, task: Task) -> Result:
    """Play a policy on a task."""
    (policy,) = named([name], task)
    episodes = attempt(Piece(policy, task.scenario, task.seeds))
    if isinstance(episodes, ResultError):
        raise episodes
    return Result.of(task, policy, episodes)
