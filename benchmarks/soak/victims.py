"""Programs that are killed: small ones of each kind that runs long. Each fills one folder, and can be started again in it."""

from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from baselines.tune import __main__ as rule_tuning
from leaderboard import __main__ as board
from train import ppo, tune
from train.run import Run
from train.training import train
from turning_env import Scenario
from turning_env.files import replace_file

SCENARIO = Scenario.model_validate({"name": "short", "tool": {"wear_criterion": 0.1}, "control": {"time_limit": 2.0}})
RULES = ("constant_force_limit", "programmed_feed", "fuzzy_override", "omative", "tmac")
_SMALL = {"num_envs": 8, "rollout": 64, "batch_size": 256, "epochs": 2}


class Victim(NamedTuple):
    """A program to be killed."""

    name: str
    work: Callable[[Path], int]
    """Fills a folder, or goes on to; returns the exit status."""


def training(folder: Path) -> int:
    """A training of PPO of a few seconds, with eight checkpoints."""
    run = Run.plan("ppo", "RoughTurning-v0", SCENARIO, 0, folder, "soak", _SMALL | {"steps": 4096})
    train(run, ppo.ALGORITHM, checkpoint_every=512)
    return 0


def tuning_of_rules(folder: Path) -> int:
    """A search for the parameters of two rules."""
    from baselines import tuned

    tuned.FOLDER = folder / "tuned"
    words = ["--scenario", str(_scenario(folder)), "--rules", "fixed_tuned", "rescaled_grid_search"]
    return rule_tuning.main([*words, "--trials", "10", "--seeds", "4"])


def tuning_of_an_agent(folder: Path) -> int:
    """A search for PPO's hyperparameters, which trains an agent for each setting."""
    words = ["--algorithm", "ppo", "--scenario", str(_scenario(folder)), "--steps", "4096", "--trials", "3"]
    with redirect_stdout(StringIO()) as said:
        status = tune.main([*words, "--runs", str(folder / "runs")])
    best = said.getvalue().partition(": ")[2]  # without the command, which names the folder, and the trial's number
    replace_file(folder / "best.txt", lambda path: path.write_text(best, "utf-8"))
    return status


def leaderboard(folder: Path, *more: str) -> int:
    """A run of the leaderboard with a few rules."""
    words = ["run", "--results", str(folder / "results"), "--env", "RoughTurning-Override-v0", "--draws", "16"]
    return board.main([*words, "--policies", *RULES, *more])


def leaderboard_in_two_processes(folder: Path) -> int:
    """The same by two processes."""
    return leaderboard(folder, "--jobs", "2")


def leaderboard_on(address: str) -> Callable[[Path], int]:
    """The same by the workers of a Dask cluster."""
    return _OnCluster(address)


class _OnCluster:  # a class, as it travels to another process
    def __init__(self, address: str) -> None:
        self._address = address

    def __call__(self, folder: Path) -> int:
        return leaderboard(folder, "--scheduler", self._address)


def _scenario(folder: Path) -> Path:
    path = folder.parent / "short.toml"  # beside the folders, as what is written names it
    SCENARIO.save(path)
    return path


VICTIMS: tuple[Victim, ...] = (
    Victim("training", training),
    Victim("tuning of rules", tuning_of_rules),
    Victim("tuning of an agent", tuning_of_an_agent),
    Victim("leaderboard", leaderboard),
    Victim("leaderboard, 2 processes", leaderboard_in_two_processes),
)
