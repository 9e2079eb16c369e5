"""Train one recurrent agent for all lathes of a family with gradients of their machining models, for one training seed.

    python -m train.family_gradient --seed 0
    python -m train.family_gradient --seed 0 --minutes 50 --device cuda --set num_envs=4096 --set batch_envs=2048

The agent sees observations with the nominal model's context, and how wrong that may be: some jobs have a part of their errors
only. Its teacher is privileged, as in ``train/analytic_gradient.py``: it evaluates every job's true machining models at the
hidden state, and prices its edges' life by that job's laws.

With ``--minutes``, training also ends, and the learning rate falls, by the clock. The same command resumes an interrupted
training, and does nothing if training is finished. The folder of the run holds ``run.json``, ``checkpoint.zip``,
``learning_curve.csv`` and ``policy.zip``. The last is a pickle: load only your own. ``python -m train.export`` writes it as ONNX.
"""

import argparse
import csv
import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.models.edge_value import Worth
from train.actor import Actor
from train.analytic_actor import ACTUAL, GruActor
from train.edge_worths import LIVES, worths
from train.family_actor import FamilyActor, JobFilter
from train.job_optimum import SET_POINT
from train.law_errors import error_prior
from train.model_gain import Hindsight, ModelGain, Truth
from train.run import Run, hyperparameters, overrides, warn_of_pickle
from turning_env import FAMILY_ID, Family, FamilyVectorEnv
from turning_env.console import described, exits
from turning_env.files import exclusive_lock, replace_file
from turning_env.scenario.family import CHUNK
from turning_env.scenario.plan import Columns, Section
from turning_env.scoring.family import truthful
from turning_env.scoring.seeds import TUNING_START

Tensor = torch.Tensor
Numbers = NDArray[np.int64]

NAME = "family_gradient"
SEED_STRIDE = 1_000_000
"""The n-th job that training seed s starts is that of seed s * SEED_STRIDE + n."""
SEEDS = TUNING_START // SEED_STRIDE
CURVE_COLUMNS = ("steps", "wall_time", "reward", "gain")
"""Columns of the learning curve: environment steps, seconds of training, and of the last rollout the mean reward and the
teacher's mean gain [s per step]."""
CHECKPOINT_EVERY = 120.0
"""Time between checkpoints [s]."""
_WORTHS_AT_ONCE = 32


class Lathes:
    """The true scenarios of a split's jobs as arrays, with the prices of their time and edge life."""

    def __init__(self, family: Family, split: str = "train", device: str = "cpu") -> None:
        jobs = family.jobs if split == "train" else family.held_out_jobs
        drawn = [family.draw(split, chunk).true for chunk in range(-(-jobs // CHUNK))]
        self._table, self._device = _joined(drawn), device
        count = len(drawn) * CHUNK
        self._known = np.zeros(count, np.bool_)
        self._prices = Worth(np.zeros(count), np.zeros((count, LIVES)))  # type: ignore[arg-type]

    def scenarios(self, numbers: Numbers) -> Columns:
        """Return the true scenarios of jobs by number."""
        return Columns(_rows(self._table, numbers))

    def prices(self, numbers: Numbers) -> Worth:
        """Return the prices of time and life of jobs by number."""
        missing = np.unique(numbers[~self._known[numbers]])
        for first in range(0, len(missing), _WORTHS_AT_ONCE):
            chosen = missing[first : first + _WORTHS_AT_ONCE]
            found = worths(self.scenarios(chosen), len(chosen), self._device)
            self._prices.time[chosen], self._prices.life[chosen] = found  # type: ignore[index]
            self._known[chosen] = True
        return Worth(self._prices.time[numbers], self._prices.life[numbers])  # type: ignore[index]


def _joined(sections: Sequence[Section]) -> dict[str, Any]:
    """Return sections of one kind as a nested table, with their arrays joined."""
    table: dict[str, Any] = {}
    for name, value in sections[0]:
        values = [getattr(each, name) for each in sections]
        if isinstance(value, Section) and name != "nominal_model":
            table[name] = _joined(values)
        elif name != "nominal_model":
            table[name] = np.concatenate(values) if isinstance(value, np.ndarray) else value
    return table


def _rows(table: dict[str, Any], numbers: Numbers) -> dict[str, Any]:
    def chosen(value: Any) -> Any:
        return value[numbers] if isinstance(value, np.ndarray) else value

    return {name: _rows(value, numbers) if isinstance(value, dict) else chosen(value) for name, value in table.items()}


@dataclass
class Rollout:
    """Observations and hidden states of all steps; fields of shape (steps, num_envs, ...)."""

    memory: Tensor
    """Memory before the first step, shape (num_envs, memory_size)."""
    begins: Tensor
    """1 where an episode begins, shape (steps, num_envs, 1)."""
    observations: Tensor
    """Observations with the tracker's readings, shape (steps, num_envs, entries)."""
    valid: Tensor
    """1 where the job is that of the first step, shape (steps, num_envs)."""
    hidden: list[NDArray[Any]]
    """Arguments of ``Truth`` after the scenario; their last axis is num_envs."""
    jobs: Numbers
    """The jobs' numbers at the first step, shape (num_envs,)."""
    reward: float
    """Mean reward per step [s]."""


class Teacher:
    """The mean gain of rollouts as a function of an agent's parameters."""

    def __init__(self, actor: GruActor, lathes: Lathes, saturation_price: float, device: str) -> None:
        self.actor, self.lathes = actor, lathes
        self._saturation_price, self._device = saturation_price, device

    def __call__(self, rollout: Rollout, envs: Tensor) -> Tensor:
        """Return the mean gain per step [s] of some environments."""
        chosen, device, commands = envs.numpy(), self._device, self.actor.commands
        scenarios = self.lathes.scenarios(rollout.jobs[chosen])
        truth = Truth(scenarios, *(each[..., chosen] for each in rollout.hidden), device=device)
        model = ModelGain(scenarios, self.lathes.prices(rollout.jobs[chosen]), device)
        low, reachable = self._log_ranges(scenarios, len(chosen))

        envs = envs.to(device)
        observations = rollout.observations[:, envs]
        unbounded = self.actor.unroll_seen(observations, rollout.memory[envs], rollout.begins[:, envs])
        target = self.actor.bounded(unbounded, observations)
        speed, feed = commands.speed_and_feed(observations, ACTUAL)
        log_speed, log_feed = (log + offset for log, offset in zip(commands.commanded(target, observations), low, strict=True))
        log_speed = log_speed - torch.relu(log_speed - reachable).detach()
        gain: Tensor
        gain, going_on = model(log_speed, log_feed, speed * low[0].exp(), feed * low[1].exp(), truth)
        gain = gain * (1.0 - truth.changed) + model.edge_change_gain(target[..., -1], going_on)
        beyond = unbounded[..., : commands.targets] - self.actor.held(unbounded, observations)
        gain = gain - self._saturation_price * beyond.square().sum(dim=-1)
        valid = rollout.valid[:, envs]
        return (gain * valid).sum() / valid.sum()

    def _log_ranges(self, scenarios: Columns, count: int) -> tuple[Tensor, Tensor]:
        """Return the logarithms of lowest speed and feed over those of ``commands``, and of the highest speed; (num_envs,)."""
        machine = scenarios.machine
        values = (machine.cutting_speed_min, machine.feed_min, scenarios.cutting_speed_max)
        logs = torch.tensor(np.stack([np.broadcast_to(np.log(each), count) for each in values]), dtype=torch.float32)
        logs = logs.to(self._device)
        return logs[:2] - self.actor.commands.low.unsqueeze(-1), logs[2]


class Training:
    """A training under way: environments, agent, optimiser and random generators.

    Raises:
        ValueError: the family's jobs differ in what the agent takes as the same.
    """

    def __init__(self, run: Run, device: str, threads: int = 1) -> None:
        p = self.parameters = run.parameters
        self.run, self.device, self._threads = run, device, threads
        torch.manual_seed(run.seed)
        self.generator = np.random.default_rng(run.seed)
        self.family = family = truthful(Family.load(p["family"]), errors=p["errors"])
        self.lathes = Lathes(family, device=device)
        check_alike(self.lathes.scenarios(np.arange(family.jobs)))
        self.actor = FamilyActor(run.scenario, p["context"], p["cells"], p["width"]).to(device)
        self.teacher = Teacher(self.actor, self.lathes, p["saturation_price"], device)
        self.optimiser = torch.optim.Adam(self.actor.parameters(), lr=p["learning_rate"])
        self.env = FamilyVectorEnv(p["num_envs"], family, autoreset_mode=AutoresetMode.SAME_STEP, threads=threads)
        self.hindsight = Hindsight()
        self.memory = torch.zeros(p["num_envs"], self.actor.memory_size, device=device)
        self.started, self.steps, self.seconds = 0, 0, 0.0
        self.rows: list[dict[str, float]] = []
        self.begins = np.zeros(p["num_envs"], np.bool_)
        self.restart(np.ones(p["num_envs"], np.bool_))

    def restart(self, mask: NDArray[np.bool_]) -> None:
        """Start the next jobs in the environments of the mask, shape (num_envs,)."""
        seeds = self.run.seed * SEED_STRIDE + self.started + np.cumsum(mask) - 1
        self.started += int(mask.sum())
        self.observations, infos = self.env.reset(seed=seeds.tolist(), options={"reset_mask": mask})
        self.jobs = infos["job"]
        self.hindsight.see_start(infos)
        self.begins = self.begins | mask

    def collect(self) -> Rollout:
        """Play a rollout with the agent."""
        p, device = self.parameters, self.device
        mask = self.generator.random(p["num_envs"]) < p["rollout"] / p["restart_steps"]
        if mask.any() and self.steps:
            self.restart(mask)
        jobs, start, steps, reward = self.jobs, self.memory, [], 0.0
        valid = np.ones(p["num_envs"], np.bool_)
        keeps_edge = self.generator.random(p["num_envs"]) < p["keeps_edge"]
        for _ in range(p["rollout"]):
            errors = self.family.error(self.jobs).astype(np.float32)
            seen = torch.from_numpy(np.column_stack([self.observations, errors])).to(device)
            begins = torch.from_numpy(self.begins).to(device, torch.float32).unsqueeze(-1)
            with torch.no_grad():
                seen, memory = self.actor.see(seen, self.memory * (1.0 - begins))
                actions, self.memory = self.actor.respond(seen, memory)
                actions = (actions + p["exploration"] * torch.randn_like(actions)).clamp(-1.0, 1.0).cpu().numpy()
            actions[keeps_edge, -1] = -1.0
            was_valid = valid
            self.observations, rewards, terminated, truncated, infos = self.env.step(actions)
            self.begins, self.jobs = terminated | truncated, infos["job"]
            self.hindsight.see_step(infos, actions[:, -1] > 0.0)
            valid = valid & ~self.begins
            see = self.hindsight
            steps.append((begins, seen, torch.from_numpy(was_valid), see.before, see.after, see.changed, see.failed))
            reward += float(rewards.mean()) / p["rollout"]
        self.steps += p["rollout"] * p["num_envs"]
        begun, observed, counted, *hidden = zip(*steps, strict=True)
        were_valid = torch.stack(counted).to(device, torch.float32)
        states = [np.stack(each) for each in hidden]
        return Rollout(start, torch.stack(begun), torch.stack(observed), were_valid, states, jobs, reward)

    def learn(self, rollout: Rollout, progress: float) -> float:
        """Learn from a rollout at a share of the training; return its mean gain per step [s]."""
        p, gains = self.parameters, []
        rate = p["learning_rate"] + (p["final_learning_rate"] - p["learning_rate"]) * min(progress, 1.0)
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        for _ in range(p["epochs"]):
            for envs in torch.randperm(p["num_envs"]).split(p["batch_envs"]):  # type: ignore[no-untyped-call]
                gain = self.teacher(rollout, envs)
                self.optimiser.zero_grad()
                (-gain).backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(self.actor.parameters(), p["max_gradient_norm"])
                self.optimiser.step()
                gains.append(gain.detach())
        return float(torch.stack(gains).mean())

    def train(self, minutes: float = np.inf) -> None:
        """Train to the end, or until so many minutes of training are over; write curve, checkpoints and the finished agent."""
        p, total = self.parameters, self.parameters["steps"]
        saved = time.monotonic()
        begun = saved - self.seconds
        bar = tqdm(total=total, initial=self.steps, unit="step", unit_scale=True, desc=self.run.label, disable=None)
        progress = 0.0
        while progress < 1.0:
            rollout = self.collect()
            progress = max(self.steps / total, self.seconds / (60.0 * minutes))
            gain = self.learn(rollout, progress)
            now = time.monotonic()
            self.seconds = now - begun
            self.rows.append(dict(zip(CURVE_COLUMNS, (self.steps, self.seconds, rollout.reward, gain), strict=True)))
            bar.set_postfix_str(f"reward {3600.0 * rollout.reward / self.env.scenario.control.interval:.0f} s/h", refresh=False)
            bar.update(p["rollout"] * p["num_envs"])
            if now - saved > CHECKPOINT_EVERY:
                self.save()
                saved = now
        bar.close()
        replace_file(self.run.learning_curve, self._write_curve)
        replace_file(self.run.policy, lambda path: torch.save(self.actor.state_dict(), path))
        self.run.checkpoint.unlink(missing_ok=True)

    def _write_curve(self, path: Path) -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, CURVE_COLUMNS)
            writer.writeheader()
            writer.writerows(self.rows[:: max(1, len(self.rows) // 200)] + self.rows[-1:])

    _PLAIN = ("env", "hindsight", "started", "steps", "seconds", "rows", "begins", "observations", "jobs", "memory", "generator")

    def save(self) -> None:
        """Write the checkpoint and the learning curve."""
        state = {
            "plain": {name: getattr(self, name) for name in self._PLAIN},
            "actor": self.actor.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "random": (torch.get_rng_state(), torch.cuda.get_rng_state_all()),
        }
        replace_file(self.run.checkpoint, lambda path: torch.save(state, path))
        replace_file(self.run.learning_curve, self._write_curve)

    def resume(self) -> None:
        """Continue from the checkpoint.

        Raises:
            ValueError: the checkpoint is damaged.
        """
        path = self.run.checkpoint
        warn_of_pickle(path)
        try:
            state = torch.load(path, map_location=self.device, weights_only=False)
        except Exception as error:  # garbled bytes can raise anything
            raise ValueError(f"{path} cannot be read: {error}; delete it to begin the training anew") from error
        for name, value in state["plain"].items():
            setattr(self, name, value)
        self.actor.load_state_dict(state["actor"])
        self.optimiser.load_state_dict(state["optimiser"])
        general, cuda = state["random"]
        torch.set_rng_state(general.cpu())
        if cuda and self.device != "cpu":
            torch.cuda.set_rng_state_all([each.cpu() for each in cuda])


def check_alike(scenarios: Columns) -> None:
    """Check that all jobs share the values that the agent assumes to be constant.

    Raises:
        ValueError: ranges of speed or feed have different ratios, or edges are not changed on command.
    """
    control, machine = scenarios.control, scenarios.machine
    if control.edge_changes != "commanded" or control.action != "incremental":
        raise ValueError(
            "the family's base must have control.edge_changes 'commanded' and control.action 'incremental', "
            f"but has {control.edge_changes!r} and {control.action!r}"
        )
    for name in ("cutting_speed", "feed"):
        ratio = np.asarray(getattr(machine, f"{name}_max") / getattr(machine, f"{name}_min"))
        if np.ptp(ratio) > 1e-6 * ratio.max():
            raise ValueError(
                f"machine.{name}_max / {name}_min is {ratio.min():g} to {ratio.max():g}, but must be the same in all jobs"
            )
    for field in JobFilter.ALIKE:
        value = np.asarray(attrgetter(field)(scenarios))
        if np.ptp(value) > 0.0:
            raise ValueError(f"{field} is {value.min():g} to {value.max():g}, but must be the same in all jobs")


def plan(family: Family, seed: int, runs: Path, command: str, given: dict[str, Any]) -> Run:
    """Return the run of a training seed, in its own folder below ``runs``."""
    parameters = hyperparameters(NAME, FAMILY_ID) | given
    mixed = truthful(family, errors=parameters["errors"])
    contexts = np.concatenate([mixed.context(mixed.draw("train", chunk)) for chunk in range(-(-family.jobs // CHUNK))])
    mean, spread = mixed.context_scale
    numbers = {"mean": mean, "spread": spread, "low": contexts.min(axis=0), "high": contexts.max(axis=0)}
    names = list(mixed.context_names)
    speed, feed = (mean[names.index(name)] for name in SET_POINT)
    numbers["error_mean"], numbers["error_factor"] = error_prior(family, (speed, feed))
    context = {"names": names} | {name: values.tolist() for name, values in numbers.items()}
    parameters |= {"family": family.portable(), "context": context}
    folder = runs / FAMILY_ID / family.name / f"{NAME}-seed{seed}"
    return Run(NAME, FAMILY_ID, family.job(0).scenario, seed, parameters, command, folder)


def train(run: Run, device: str = "cpu", threads: int = 1, minutes: float = np.inf) -> Path:
    """Train or resume, unless training is finished; return the path of the finished agent.

    Raises:
        ValueError: the folder holds a run with other settings or unreadable files, another process trains in it, the family's
            jobs differ in what the agent takes as the same, the device cannot be used, or the seed is not for training.
    """
    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise ValueError(f"device is {device!r}, which PyTorch cannot use here: {str(error).splitlines()[0]}") from error
    if run.seed not in range(SEEDS):
        raise ValueError(f"the training seed is {run.seed}, but must be 0 to {SEEDS - 1}")
    with exclusive_lock(run.folder, False):
        run.begin()
        if not run.policy.exists():
            torch.set_num_threads(threads)
            training = Training(run, device, threads)
            if run.checkpoint.exists():
                training.resume()
            training.train(minutes)
    return run.policy


def load_actor(path: Path) -> Actor:
    """Load the finished agent of a run of your own."""
    run = Run.read(path.parent)
    p = run.parameters
    actor = FamilyActor(run.scenario, p["context"], p["cells"], p["width"])
    actor.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    return actor.eval()


ALGORITHM = SimpleNamespace(name=NAME, title="analytic gradients on a family", actor=load_actor)


@exits(ValueError, interrupted="interrupted: run the same command again to resume from the last checkpoint")
def main(arguments: Sequence[str] | None = None) -> int:
    """Train one agent for one training seed; return the exit status."""
    parser = argparse.ArgumentParser(prog=f"python -m train.{NAME}", **described(__doc__))
    parser.add_argument("--family", default="shop", help="family, or its TOML file (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="training seed (default: %(default)s)")
    parser.add_argument(
        "--minutes", type=float, default=np.inf, help="minutes of training after which it ends (default: no limit)"
    )
    parser.add_argument("--device", default="cpu", help="device of network and gradients, such as cuda (default: %(default)s)")
    parser.add_argument(
        "--threads", type=int, default=1, help="threads of the environments and of PyTorch (default: %(default)s)"
    )
    set_help = f"set a hyperparameter of train/hyperparameters/{NAME}.toml; repeat the option to set several"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=set_help)
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    command = f"python -m train.{NAME} {shlex.join(sys.argv[1:] if arguments is None else arguments)}".strip()
    run = plan(Family.load(parsed.family), parsed.seed, parsed.runs, command, overrides(NAME, parsed.set))
    print(train(run, parsed.device, parsed.threads, parsed.minutes))
    return 0


if __name__ == "__main__":
    sys.exit(main())
