"""Train a network to act as ``self_tuning`` does, by DAgger, for one training seed.

    python -m train.dagger --env RoughTurning-Family-v1 --scenario shop --seed 0

The student sees the observation with the belief of a filter (``baselines/belief.py``). The teacher
is the best rule (``baselines/self_tuning.py``) on the same filter, so it follows all that the
student does and says in every state how it would act there. Neither sees the hidden state, and the
student is shown no rewards. After a first part in which the teacher acts, the student acts, and its
own states are added to the dataset: it learns to correct its own errors (Ross et al. 2011,
"A reduction of imitation learning to no-regret online learning", arXiv 1011.0686).

Successive states are nearly the same, so the teacher, which costs more than lathe, filter and
network, is asked in every ``label_every``-th step. Errors count by what they cost: speed or feed
above the teacher's overloads the edge, below it only loses metal. The student is an average of the
network over its last updates.

The same command resumes an interrupted training, and does nothing if training is finished. The
dataset is a file of the run's folder until then. A training that is resumed without it collects
another one. The network is fitted on a GPU if there is one.
"""

import math
import sys
from collections.abc import Callable
from copy import deepcopy
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import torch
from numpy.typing import NDArray
from optuna.distributions import FloatDistribution
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import MaybeCallback, Schedule
from stable_baselines3.common.utils import LinearSchedule, get_device
from stable_baselines3.common.vec_env import VecEnv

from baselines.belief import Belief, with_belief
from baselines.models import edge_value
from baselines.models.load_filter import records
from baselines.self_tuning import RULES, SelfTuning
from train.actor import Feedforward
from train.run import Run
from train.training import ACTIVATIONS, Algorithm, command_line
from turning_env import Family, Reading, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.policy import Actions, Observations

Tensor = torch.Tensor

CONTINUOUS = 2
"""Entries of an action that are changes of speed and feed; the next one changes the edge."""
DATASET = "dataset.bin"
"""Name of the dataset's file in a run's folder."""


class Teacher(SelfTuning):
    """``self_tuning`` on a belief that others see, too.

    Args:
        scenarios: nominal model of each environment.

    Attributes:
        belief: the belief, which alone learns from observations.
    """

    def __init__(self, scenarios: list[Scenario]) -> None:
        parameters = RULES["self_tuning"].fixed
        super().__init__(scenarios, len(scenarios), **parameters)
        self.belief = Belief(scenarios, learns_laws=True)
        self._filter = self.belief.filter
        # ``assign`` changes the numbers in here, which other sums of the rule read.
        self._scenario = self.belief.scenario
        self._severity = parameters["severity"]

    def _observe(self, reading: Reading) -> None:
        """Leave learning to the belief."""

    def begin(self, jobs: dict[int, Scenario]) -> None:
        """Begin jobs, given by their nominal models, in the environments that are the keys."""
        for env_index, nominal in jobs.items():
            self.belief.replace_model(env_index, nominal)
            numbers = edge_value.life_numbers(nominal, self._severity)
            self._parameters[env_index] = records([numbers])[0]
        self._times = self._times_ahead()
        self._moments = self._drive_moments()


class TaughtVecEnv(RoughTurningVecEnv):
    """Training jobs of a family with beliefs and a teacher, behind Stable-Baselines3's ``VecEnv``.

    See ``RoughTurningVecEnv`` for the arguments.
    """

    def __init__(
        self,
        family: Family,
        num_envs: int,
        reward_scale: float = 1.0,
        wrapper: Callable[[Any], Any] | None = None,
    ) -> None:
        # No wrapper: the teacher reads plain observations, and beliefs are added here.
        super().__init__(family, num_envs, reward_scale)
        self.observation_space = with_belief(self.observation_space)

    def reset(self) -> NDArray[np.float32]:
        """Return first observations with beliefs; see ``RoughTurningVecEnv.reset``."""
        observations = super().reset()
        self._teacher = Teacher([self._nominal(index) for index in range(self.num_envs)])
        self._teacher.reset(np.ones(self.num_envs, np.bool_))
        return self._with_belief(observations)

    def step_wait(self) -> Any:
        observations, rewards, ended, infos = super().step_wait()
        if ended.any():
            ended_envs = np.flatnonzero(ended).tolist()
            self._teacher.begin({index: self._nominal(index) for index in ended_envs})
        return self._with_belief(observations), rewards, ended, infos

    def labels(self) -> Actions:
        """Return the teacher's actions for the last observations."""
        # Without the numbers of nominal models, which it knows.
        return self._teacher.act(self._observations[:, : self._teacher.belief.entries])

    def _with_belief(self, observations: Observations) -> Observations:
        """Keep observations for ``labels``, and return them with the teacher's belief behind them.

        The shape is (num_envs, entries).
        """
        self._observations = observations
        return np.concatenate([observations, self._teacher.belief.observe(observations)], axis=1)

    def _nominal(self, env_index: int) -> Scenario:
        """Return the nominal model of an environment's present job."""
        nominal: Scenario = self.vector_env.job(env_index).scenario.nominal()
        return nominal


class Student(BasePolicy):
    """A network that returns changes of speed and feed, and whether to change the edge.

    The last output is the log odds of a change. ``average`` plays: it is the mean of the network
    over its last updates.
    """

    def __init__(
        self,
        observation_space: Any,
        action_space: Any,
        net_arch: list[int],
        activation_fn: type[torch.nn.Module],
        **options: Any,
    ) -> None:
        super().__init__(observation_space, action_space, **options)
        layers: list[torch.nn.Module] = []
        entries = observation_space.shape[0]
        for units in net_arch:
            layers += [torch.nn.Linear(entries, units), activation_fn()]
            entries = units
        layers.append(torch.nn.Linear(entries, action_space.shape[0]))
        self.network = torch.nn.Sequential(*layers)
        self.average = deepcopy(self.network).requires_grad_(False)
        self.optimizer = self.new_optimizer()

    def new_optimizer(self) -> torch.optim.Optimizer:
        """Return an optimizer without moments; its learning rate is set before every fit."""
        return torch.optim.Adam(self.network.parameters(), fused=True)

    def _predict(self, observation: Any, deterministic: bool = False) -> Tensor:
        actions: Tensor = self.average(observation).clamp(-1.0, 1.0)
        return actions

    def follow(self, decay: float) -> None:
        """Let the average follow the network, with a share ``decay`` of its own left."""
        with torch.no_grad():
            torch._foreach_lerp_(
                list(self.average.parameters()), list(self.network.parameters()), 1.0 - decay
            )


@dataclass(frozen=True)
class ImitationPlan:
    """The course of a training."""

    n_steps: int = 1000
    """Steps per environment between fits."""
    label_every: int = 4
    """Steps between two questions to the teacher."""
    teacher_steps: int = 4000
    """Steps per environment in which the teacher acts, from the start on."""
    teacher_share: float = 0.0
    """Share of the environments in which it acts later [-]."""
    n_updates: int = 400
    """Updates per fit."""
    batch_size: int = 4096
    """Samples per update."""
    average_decay: float = 0.998
    """Share of the averaged network that an update leaves [-]."""


@dataclass(frozen=True)
class ErrorCosts:
    """The costs of a student's errors [-]."""

    excess_weight: float = 2.0
    """Factor on the loss where speed or feed is above the teacher's."""
    change_weight: float = 1.0
    """Factor on the loss of the change of the edge."""
    change_odds: float = 5.0
    """Factor on the loss where the teacher changes the edge, which is rare."""
    tolerance: float = 0.1
    """Error of an action from which the loss grows in proportion to it, not to its square."""

    def loss(self, outputs: Tensor, labels: Tensor) -> Tensor:
        """Return the mean loss of outputs for labels, both of shape (samples, actions)."""
        wanted = labels[:, :CONTINUOUS]
        errors = outputs[:, :CONTINUOUS] - wanted
        # Actions are clipped: beyond a limit that the teacher also wants, there is no error.
        is_beyond = (wanted.abs() >= 1.0) & (errors * wanted > 0.0)
        sizes = errors.abs() / self.tolerance
        losses = torch.where(sizes < 1.0, 0.5 * sizes.square(), sizes - 0.5)
        losses = losses * torch.where(errors > 0.0, self.excess_weight, 1.0)
        losses = losses.masked_fill(is_beyond, 0.0)

        changes = (labels[:, CONTINUOUS] > 0.0).float()
        change_losses = torch.nn.functional.binary_cross_entropy_with_logits(
            outputs[:, CONTINUOUS], changes, weight=1.0 + (self.change_odds - 1.0) * changes
        )
        return self.tolerance * losses.sum(dim=1).mean() + self.change_weight * change_losses


class Dagger(BaseAlgorithm):
    """The algorithm, as a subclass of Stable-Baselines3's base class, which saves and logs.

    Args:
        policy: class of the policy.
        env: environments.
        learning_rate: step size of Adam, or a schedule.
        dataset: path of the file of all samples so far.
        max_samples: largest number of samples.
        plan: the course of the training.
        costs: the costs of errors.
        options: further options of the base class.
    """

    policy: Any
    env: Any
    count: int = 0
    """Number of samples in the dataset."""

    def __init__(
        self,
        policy: type[BasePolicy] = Student,
        env: TaughtVecEnv | None = None,
        learning_rate: float | Schedule = 1e-3,
        *,
        dataset: str = DATASET,
        max_samples: int = 1_000_000,
        plan: ImitationPlan = ImitationPlan(),
        costs: ErrorCosts = ErrorCosts(),
        _init_setup_model: bool = True,
        **options: Any,
    ) -> None:
        super().__init__(
            policy, env, learning_rate, support_multi_env=True, monitor_wrapper=False, **options
        )
        self.dataset = dataset
        self.max_samples = max_samples
        self.plan = plan
        self.costs = costs
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        """Make the policy; Stable-Baselines3 calls this at the end of its constructors."""
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        self.policy = self.policy_class(
            self.observation_space, self.action_space, **self.policy_kwargs
        )

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "samples", "player"]

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 5,
        tb_log_name: str = "dagger",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Play and fit until ``total_timesteps`` environment steps have been taken."""
        total_timesteps, callbacks = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        self.policy.to(get_device("auto"))
        # A resumed optimizer takes its moments there, too.
        self.policy.optimizer.load_state_dict(self.policy.optimizer.state_dict())
        self.open_dataset()
        callbacks.on_training_start(locals(), globals())
        while self.num_timesteps < total_timesteps:
            callbacks.on_rollout_start()
            self.play(callbacks)
            self._update_current_progress_remaining(self.num_timesteps, total_timesteps)
            self.fit()
            self.logger.dump(self.num_timesteps)
            callbacks.on_rollout_end()
        callbacks.on_training_end()
        self.policy.to("cpu")
        # The finished agent needs neither these nor the moments of the gradients.
        del self.samples, self.player
        self.policy.optimizer = self.policy.new_optimizer()
        Path(self.dataset).unlink()
        return self

    @property
    def entries(self) -> int:
        """Number of entries of an observation with its belief."""
        return math.prod(self.observation_space.shape or ())

    def open_dataset(self) -> None:
        """Open the dataset's file, shape (max_samples, entries + actions), or make an empty one.

        Its columns: observation, label.
        """
        path = Path(self.dataset)
        if not path.exists():
            self.count = 0
        shape = (self.max_samples, self.entries + math.prod(self.action_space.shape or ()))
        mode: Literal["r+", "w+"] = "r+" if path.exists() else "w+"
        # Half precision is finer than the noise of the sensors. The file is sparse at first.
        rows = np.memmap(path, np.float16, mode=mode, shape=shape)
        self.samples = torch.from_numpy(rows)

    def play(self, callbacks: BaseCallback) -> None:
        """Play ``n_steps`` in each environment and add the labelled ones to the dataset."""
        # So small a network is quicker on the processor that has the environments.
        self.player = deepcopy(self.policy.average).cpu()
        # The teacher acts in all environments at first, later in the first few of them.
        teaching_steps = self.plan.teacher_steps * self.n_envs
        teaches = np.arange(self.n_envs) < self.plan.teacher_share * self.n_envs
        for step in range(self.plan.n_steps):
            all_teach = self.num_timesteps < teaching_steps
            observations: Any = self._last_obs
            is_labelled = step % self.plan.label_every == 0
            if is_labelled or all_teach or teaches.any():
                labels = self.env.labels()
            if is_labelled:
                self.add(observations, labels)
            if all_teach:
                actions = labels
            else:
                actions = self.act(observations)
                if teaches.any():
                    actions[teaches] = labels[teaches]
            self._last_obs, _, _, infos = self.env.step(actions)
            self._update_info_buffer(infos)
            self.num_timesteps += self.n_envs
            callbacks.on_step()

    def act(self, observations: Any) -> Actions:
        """Return the student's actions."""
        with torch.no_grad():
            outputs = self.player(torch.from_numpy(observations))
        actions: Actions = outputs.clamp(-1.0, 1.0).numpy()
        return actions

    def add(self, observations: Observations, labels: Actions) -> None:
        """Add samples to the dataset, as long as there is room."""
        rows = torch.from_numpy(np.concatenate([observations, labels], axis=1))
        rows = rows[: self.max_samples - self.count]
        self.samples[self.count : self.count + len(rows)] = rows.half()
        self.count += len(rows)

    def fit(self) -> None:
        """Update the network ``n_updates`` times with samples of the dataset."""
        policy = self.policy
        self._update_learning_rate(policy.optimizer)
        # Copied to a GPU if there is one.
        samples = self.samples[: self.count].to(policy.device)
        for _ in range(self.plan.n_updates):
            chosen = torch.randint(self.count, (self.plan.batch_size,))
            batch = samples[chosen.to(policy.device)].float()
            outputs = policy.network(batch[:, : self.entries])
            loss: Any = self.costs.loss(outputs, batch[:, self.entries :])
            policy.optimizer.zero_grad()
            loss.backward()
            policy.optimizer.step()
            policy.follow(self.plan.average_decay)
        self.logger.record("train/loss", loss.item())


def new_model(run: Run, vec_env: VecEnv) -> Dagger:
    """Return an untrained model."""
    p = run.parameters
    assert isinstance(vec_env, TaughtVecEnv)
    # Both are rounded up: -(-a // b).
    rounds = -(-p["total_timesteps"] // (p["n_steps"] * p["num_envs"]))
    labels_per_round = -(-p["n_steps"] // p["label_every"]) * p["num_envs"]
    return Dagger(
        Student,
        vec_env,
        # It falls linearly over the whole training.
        learning_rate=LinearSchedule(
            start=p["learning_rate"], end=p["final_learning_rate"], end_fraction=1.0
        ),
        dataset=str(run.folder / DATASET),
        max_samples=rounds * labels_per_round,
        plan=from_hyperparameters(ImitationPlan, p),
        costs=from_hyperparameters(ErrorCosts, p),
        policy_kwargs={
            "net_arch": p["net_arch"],
            "activation_fn": ACTIVATIONS[p["activation_fn"]],
        },
        stats_window_size=p["num_envs"],
        tensorboard_log=str(run.folder / "tensorboard"),
        seed=run.seed,
    )


def from_hyperparameters(record: type[Any], parameters: dict[str, Any]) -> Any:
    """Return a ``record``, such as ``ImitationPlan``, with the hyperparameters as its fields.

    ``parameters`` may hold others, too, which are left out.
    """
    return record(**{field.name: parameters[field.name] for field in fields(record)})


def network(policy: Student) -> Feedforward:
    """Return the agent of a trained policy."""
    return Feedforward(policy.average)


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 6_144_000,  # environment steps of the whole training, some 1,600 jobs
    "num_envs": 256,  # jobs side by side
    "learning_rate": 1e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "net_arch": [384, 384],
    "activation_fn": "relu",  # or "tanh"
    "reward_scale": 1.0,  # factor on rewards [s], which teach nothing here
    "belief": True,  # shows the estimates of the optimisers' filter: baselines/belief.py
}
DEFAULTS |= asdict(ImitationPlan()) | asdict(ErrorCosts())

SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "excess_weight": FloatDistribution(1.0, 5.0, log=True),
}

ALGORITHM = Algorithm(
    name="dagger",
    model=Dagger,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("rule's actions",),
    vec_env=TaughtVecEnv,
    single_scenarios=False,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
