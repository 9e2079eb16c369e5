"""Train an agent with lathes, network and updates on one device.

    python -m train.resident --device cuda --lanes 16384 --rollout 32 --batch-size 65536 --out my-agents

writes ``my-agents/resident_ppo-seed0.onnx``, which ``leaderboard run --agents`` takes. A training is short and is not resumed.
"""

import argparse
import shlex
import sys
from pathlib import Path

import torch
from tqdm import tqdm

from train import export
from train.resident.lathes import lathes_on
from train.resident.ppo import Learner
from train.run import Run, hyperparameters
from train.training import SEEDS
from turning_env import IDS, Scenario
from turning_env.console import described, exits
from turning_env.files import replace_file

NAME = "resident_ppo"
OPTIONS = ("intervals", "lanes", "rollout", "batch_size", "epochs")
"""Of PPO's hyperparameters, those that may be given: many lanes want long batches and short rollouts."""


@exits(ValueError, RuntimeError, interrupted="interrupted: nothing is written")
def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    program = "python -m train.resident"
    parser = argparse.ArgumentParser(
        prog=program,
        **described(__doc__),
    )
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cuda", help="where (default: %(default)s)")
    parser.add_argument("--env", default="RoughTurning-v0", choices=list(IDS), help="environment id (default: %(default)s)")
    parser.add_argument("--scenario", help="preset or TOML file (default: the id's preset)")
    parser.add_argument("--seed", type=int, default=0, help="training seed (default: %(default)s)")
    for name in OPTIONS:
        parser.add_argument(f"--{name.replace('_', '-')}", type=int, help="default: PPO's hyperparameter file's")
    parser.add_argument("--out", type=Path, default=Path("my-agents"), help="folder of the agent (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    given = {name: getattr(parsed, name) for name in OPTIONS if getattr(parsed, name) is not None}
    for name, value in given.items():
        if value < 1:
            parser.error(f"--{name.replace('_', '-')} is {value}, but must be at least 1")
    if not 0 <= parsed.seed < SEEDS:
        parser.error(f"--seed is {parsed.seed}, but must be 0 to {SEEDS - 1}")
    command = f"{program} {shlex.join(sys.argv[1:] if arguments is None else arguments)}".strip()
    parameters = hyperparameters("ppo", parsed.env) | given
    scenario = Scenario.load(parsed.scenario or IDS[parsed.env])
    print(train(Run(NAME, parsed.env, scenario, parsed.seed, parameters, command, parsed.out), parsed.device))
    return 0


def train(run: Run, device: str) -> Path:
    """Train a run's agent on a device; return the path of its ONNX file.

    Raises:
        NoAcceleratorError: the device is missing.
        ValueError: the agent cannot be written as ONNX.
        OSError: its file cannot be written.
    """
    torch.set_num_threads(1)
    learner = Learner(lathes_on(device, run.scenario, run.parameters["lanes"]), run.parameters, run.seed)
    total = run.parameters["intervals"]
    with tqdm(total=total, unit="interval", unit_scale=True, desc=run.label, dynamic_ncols=True, disable=None) as bar:
        for progress in learner.learn(total):
            bar.update(min(progress.intervals, total) - bar.n)
            bar.set_postfix_str(f"return per episode {progress.mean_return:.0f} s", refresh=False)
    learner.lathes.wait()
    with torch.no_grad():
        content = export.to_onnx(learner.network.actor().cpu(), export.metadata(run))
    path = run.folder / f"{run.algorithm}-seed{run.seed}.onnx"
    replace_file(path, lambda partial: partial.write_bytes(content))
    return path


if __name__ == "__main__":
    sys.exit(main())
