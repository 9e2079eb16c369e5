"""PPO: train one agent for one training seed.

    python -m train.ppo --seed 0
    python -m train.ppo --env RoughTurning-v0 --scenario forging --seed 1 --intervals 8000000

A run's folder holds ``run.json`` (what was asked for), ``checkpoint.zip`` (everything needed to go on exactly where it stopped),
``policy.zip`` (the finished agent) and TensorBoard logs. Running the same command again resumes an interrupted
training, and does nothing if it is finished. Only load such files from your own trainings: they are pickles, which can run code.
"""

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule
from tqdm import tqdm

from train.run import Run
from train.vec_env import RoughTurningVecEnv
from turning_env import IDS, Scenario
from turning_env.draws import TUNING_START
from turning_env.files import replace_file

SEED_STRIDE = 1_000_000
"""Lane i of training seed s plays the episodes of seed s * SEED_STRIDE + i, so that no two trainings share bars."""

ACTIVATIONS = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}


class Progress(BaseCallback):
    """Shows a progress bar, and keeps a checkpoint before each rollout that is due one."""

    def __init__(self, run: Run, checkpoint_every: int) -> None:
        super().__init__()
        self.run, self.checkpoint_every = run, checkpoint_every
        self.bar: Any = None
        self.last_checkpoint = 0

    def _on_training_start(self) -> None:
        self.last_checkpoint = self.num_timesteps
        total = self.run.parameters["intervals"]
        self.bar = tqdm(total=total, initial=self.num_timesteps, unit="interval", unit_scale=True, desc=self.run.label)

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.last_checkpoint >= self.checkpoint_every:
            self.last_checkpoint = self.num_timesteps
            save_checkpoint(self.model, self.run)

    def _on_step(self) -> bool:
        # The last rollout is finished whole, a little beyond what was asked for.
        self.bar.update(min(self.num_timesteps, self.bar.total) - self.bar.n)
        return True

    def _on_rollout_end(self) -> None:
        if self.model.ep_info_buffer:
            mean_return = np.mean([episode["r"] for episode in self.model.ep_info_buffer])
            self.bar.set_postfix_str(f"return per edge {mean_return:.0f} s")

    def _on_training_end(self) -> None:
        self.bar.close()


def save_checkpoint(model: Any, run: Run) -> None:
    """Write the model with the lathes and all generators' states beside it: all of it or nothing."""
    model.lathes = model.get_env()
    model.generator_states = (torch.get_rng_state(), np.random.get_state())  # noqa: NPY002 - SB3 shuffles with it
    replace_file(run.checkpoint, model.save)


def load_checkpoint(run: Run) -> PPO:
    """The model of the last checkpoint, ready to go on as if it had never stopped."""
    model = PPO.load(run.checkpoint, device="cpu")
    model.set_env(model.lathes, force_reset=False)  # type: ignore[attr-defined]
    torch_state, numpy_state = model.generator_states  # type: ignore[attr-defined]
    torch.set_rng_state(torch_state)
    np.random.set_state(numpy_state)  # noqa: NPY002
    return model


def new_model(run: Run) -> PPO:
    """An untrained model on freshly seeded lathes."""
    p = run.parameters
    env = RoughTurningVecEnv(run.scenario, p["lanes"], p["reward_scale"])
    model = PPO(
        "MlpPolicy",
        env,
        learning_rate=LinearSchedule(p["learning_rate"], p["final_learning_rate"], 1.0),
        n_steps=p["rollout"],
        batch_size=p["batch_size"],
        n_epochs=p["epochs"],
        gamma=p["discount"],
        gae_lambda=p["gae_lambda"],
        clip_range=p["clip_range"],
        ent_coef=p["entropy_coefficient"],
        vf_coef=p["value_coefficient"],
        max_grad_norm=p["max_gradient_norm"],
        policy_kwargs={
            "net_arch": p["hidden_layers"],
            "activation_fn": ACTIVATIONS[p["activation"]],
            "log_std_init": p["initial_log_deviation"],
        },
        tensorboard_log=str(run.folder / "tensorboard"),
        seed=run.seed,
        device="cpu",
    )
    env.seed(run.seed * SEED_STRIDE)
    return model


def train(run: Run, checkpoint_every: int = 500_000) -> Path:
    """Train, or resume, or find the work done; return the path of the finished agent.

    Args:
        run: what to train; its folder is made if need be.
        checkpoint_every: environment steps between checkpoints.

    Raises:
        ValueError: the folder holds a run of other settings.
    """
    run.begin()
    if run.policy.exists():
        return run.policy
    torch.set_num_threads(1)
    resumed = run.checkpoint.exists()
    model = load_checkpoint(run) if resumed else new_model(run)
    model.learn(
        run.parameters["intervals"] - model.num_timesteps,
        callback=Progress(run, checkpoint_every),
        log_interval=5,
        tb_log_name="ppo",
        reset_num_timesteps=not resumed,
    )
    model.env = None
    for name in ("lathes", "generator_states"):
        model.__dict__.pop(name, None)
    replace_file(run.policy, model.save)
    run.checkpoint.unlink(missing_ok=True)
    return run.policy


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.ppo", description="Train a PPO agent.")
    parser.add_argument("--env", default="RoughTurning-v0", choices=list(IDS), help="environment id")
    parser.add_argument("--scenario", help="preset or TOML file (default: the id's preset)")
    parser.add_argument("--seed", type=int, default=0, help="training seed")
    parser.add_argument("--intervals", type=int, help="environment steps (default: the hyperparameter file's)")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs")
    parsed = parser.parse_args(arguments)
    if not 0 <= parsed.seed < TUNING_START // SEED_STRIDE:
        parser.error(f"--seed is {parsed.seed}, but must be 0 to {TUNING_START // SEED_STRIDE - 1}")
    if parsed.intervals is not None and parsed.intervals < 1:
        parser.error(f"--intervals is {parsed.intervals}, but must be at least 1")
    command = "python -m train.ppo " + shlex.join(sys.argv[1:] if arguments is None else arguments)
    try:
        scenario = Scenario.load(parsed.scenario or IDS[parsed.env])
        overrides = {} if parsed.intervals is None else {"intervals": parsed.intervals}
        run = Run.plan("ppo", parsed.env, scenario, parsed.seed, parsed.runs, command.strip(), overrides)
        path = train(run)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: run the same command again to resume from the last checkpoint", file=sys.stderr)
        return 130
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
