"""Train a linear policy without memory by CMA-ES, for one training seed.

    python -m train.linear_cma_es --seed 0

The action is W x + c, clipped, with the observation x. An evolution strategy searches the numbers
of W and c: it plays whole episodes with each candidate and keeps the mean and covariance of those
that return most (Hansen 2016, "The CMA evolution strategy: a tutorial", arXiv 1604.00772; library:
cmaes). There is neither a network nor a gradient, so a learner that does not return more has
learned nothing that its task needs a network for. The search starts at a fixed speed and feed: with
W = 0 at those of the program, on a family at the nominal optimum of each job
(``train/linear_start.py``).

All candidates of a generation play the same episodes, so that luck decides little between them. The
agent is the mean of the last generation. The same command resumes an interrupted training, and does
nothing if training is finished. Files: see ``train/training.py``.
"""

import math
import pickle
import sys
from typing import Any, Self

import numpy as np
import torch
from cmaes import CMA
from numpy.typing import NDArray
from optuna.distributions import FloatDistribution, IntDistribution
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import MaybeCallback
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from train.actor import Feedforward
from train.linear_start import nominal_optimum
from train.run import Run
from train.training import SEED_STRIDE, Algorithm, command_line
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

Array = NDArray[np.float64]


class GroupedVecEnv(RoughTurningVecEnv):
    """Environments in groups of equal seeds: each group plays the same episodes."""

    def seed_groups(self, first_seed: int, group_size: int) -> None:
        """Let the next reset start the seeds from ``first_seed`` on in every group."""
        self._seeds = [first_seed + index % group_size for index in range(self.num_envs)]


class LinearPolicy(BasePolicy):
    """A linear function of the observation, clipped to -1..1."""

    def __init__(self, observation_space: Any, action_space: Any, **options: Any) -> None:
        super().__init__(observation_space, action_space, **options)
        self.action_net = torch.nn.Linear(observation_space.shape[0], action_space.shape[0])
        torch.nn.init.zeros_(self.action_net.weight)
        torch.nn.init.zeros_(self.action_net.bias)

    def set_weights(self, matrix: Array, constants: Array) -> None:
        """Set W, shape (actions, entries), and c, shape (actions,)."""
        self.action_net.weight.data = torch.from_numpy(matrix).float()
        self.action_net.bias.data = torch.from_numpy(constants).float()

    def _predict(self, observation: Any, deterministic: bool = False) -> torch.Tensor:
        actions: torch.Tensor = self.action_net(observation).clamp(-1.0, 1.0)
        return actions


class LinearCmaEs(BaseAlgorithm):
    """The algorithm, as a subclass of Stable-Baselines3's base class, which saves and logs.

    Args:
        policy: class of the policy.
        env: environments; their number is a multiple of the population's size.
        population_size: candidates of a generation.
        sigma: initial standard deviation of the policy's numbers [-].
        first_seed: seed of the first episode; later ones follow.
        episode_steps: steps of an episode that count; the rest is cut off. 0: all count.
        options: further options of the base class.
    """

    policy: Any
    env: Any
    search: Any = None
    """The strategy's state; None before training."""

    def __init__(
        self,
        policy: type[BasePolicy] = LinearPolicy,
        env: GroupedVecEnv | None = None,
        *,
        population_size: int = 16,
        sigma: float = 0.3,
        first_seed: int = 0,
        episode_steps: int = 0,
        _init_setup_model: bool = True,
        **options: Any,
    ) -> None:
        super().__init__(
            policy,
            env,
            learning_rate=0.0,
            support_multi_env=True,
            monitor_wrapper=False,
            **options,
        )
        self.population_size = population_size
        self.sigma = sigma
        self.next_seed = first_seed
        self.episode_steps = episode_steps
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        self.set_random_seed(self.seed)
        self.policy = LinearPolicy(self.observation_space, self.action_space)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy"], []

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 5,
        tb_log_name: str = "linear_cma_es",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Play generations until ``total_timesteps`` environment steps have been taken."""
        total_timesteps, callbacks = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        if self.search is None:
            start = parameters_to_vector(self.policy.parameters()).detach().double().numpy()
            self.search = CMA(mean=start, sigma=self.sigma, population_size=self.population_size)
        callbacks.on_training_start(locals(), globals())
        while self.num_timesteps < total_timesteps:
            callbacks.on_rollout_start()
            self.search.reseed_rng(self.next_seed)
            candidates = np.stack([self.search.ask() for _ in range(self.population_size)])
            returns = self.play(candidates, callbacks)
            # The strategy minimises.
            self.search.tell(list(zip(candidates, -returns, strict=True)))
            # A checkpoint keeps one half of the covariance, which changes last bits, and no random
            # generator. With a copy and a seed in every generation, a resumed search is the same as
            # an uninterrupted one.
            self.search = pickle.loads(pickle.dumps(self.search))
            mean = torch.from_numpy(self.search.mean).float()
            vector_to_parameters(mean, self.policy.parameters())
            self.logger.record("train/best_return", returns.max())
            self.logger.dump(self.num_timesteps)
            callbacks.on_rollout_end()
        callbacks.on_training_end()
        return self

    def play(self, candidates: Array, callbacks: BaseCallback) -> Array:
        """Return each candidate's mean return, of one episode in each of its environments [s]."""
        group_size = self.n_envs // self.population_size
        self.env.seed_groups(self.next_seed, group_size)
        self.next_seed += group_size
        observations = self.env.reset()
        entries = observations.shape[1]
        # ``parameters_to_vector``: the matrix, row by row, then the constants.
        numbers = candidates.astype(np.float32)
        constants = numbers[:, np.newaxis, -self.policy.action_net.out_features :]
        matrices = numbers[:, : -constants.shape[2]].reshape(len(numbers), -1, entries)
        transposed = matrices.transpose(0, 2, 1)

        max_steps = self.episode_steps or math.inf
        steps = 0
        returns = np.zeros(self.n_envs)
        going_on = np.ones(self.n_envs, np.bool_)
        while going_on.any() and steps < max_steps:
            grouped = observations.reshape(self.population_size, group_size, entries)
            actions = np.clip(grouped @ transposed + constants, -1.0, 1.0)
            observations, rewards, ended, _ = self.env.step(actions.reshape(self.n_envs, -1))
            # Environments go on with another episode at the end of one. Only the first counts.
            returns += np.where(going_on, rewards, 0.0)
            going_on &= ~ended
            steps += 1
            self.num_timesteps += self.n_envs
            callbacks.on_step()
        self.ep_info_buffer.extend(  # type: ignore[union-attr]
            {"r": episode_return, "l": steps} for episode_return in returns.tolist()
        )
        return np.asarray(returns.reshape(self.population_size, group_size).mean(axis=1))


def new_model(run: Run, vec_env: VecEnv) -> LinearCmaEs:
    """Return an untrained model.

    Raise ValueError if ``num_envs`` is no multiple of ``population_size``.
    """
    p = run.parameters
    assert isinstance(vec_env, GroupedVecEnv)
    if p["num_envs"] % p["population_size"]:
        raise ValueError(
            f"num_envs is {p['num_envs']}, "
            f"but must be a multiple of population_size, {p['population_size']}"
        )
    model = LinearCmaEs(
        LinearPolicy,
        vec_env,
        population_size=p["population_size"],
        sigma=p["sigma"],
        first_seed=run.seed * SEED_STRIDE,
        episode_steps=p["episode_steps"],
        tensorboard_log=str(run.folder / "tensorboard"),
        seed=run.seed,
    )
    if starts_at_nominal_optimum(run):
        assert run.family is not None
        model.policy.set_weights(*nominal_optimum(run.family))
    return model


def starts_at_nominal_optimum(run: Run) -> bool:
    """Return whether the search starts at the nominal optimum of a family's jobs.

    It does if actions are the environment's incremental ones, the agent sees the context behind a
    plain observation, and no other start is stated.
    """
    p = run.parameters
    sees_context = run.family is not None and not p["hides_context"]
    plain = not (p["belief"] or p["derived"] or p["load_target"]) and p["frames"] == 1
    is_stated = bool(p.get("initial_actions"))
    return sees_context and plain and not is_stated and run.scenario.control.action == "incremental"


def network(policy: LinearPolicy) -> Feedforward:
    """Return the agent of a trained policy."""
    return Feedforward(policy.action_net)


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 40_000_000,  # environment steps of the whole training
    # Environments side by side: population_size times the episodes that each candidate plays.
    "num_envs": 128,
    "population_size": 16,  # candidates of a generation
    "sigma": 0.3,  # initial standard deviation of the policy's numbers
    "episode_steps": 0,  # steps of an episode that count, the rest is cut off; 0: all
    "reward_scale": 1.0,  # factor on rewards [s]
    "belief": False,  # shows the estimates of the optimisers' filter: baselines/belief.py
    "derived": False,  # shows the inputs of baselines/derived_observation.py
    "load_target": False,  # actions are load targets: baselines/load_target.py
    "position": False,  # tells the position along the bar: train/terms.py
    "frames": 1,  # successive observations that the agent sees
    "hides_context": False,  # hides the numbers of a family's nominal models
}

SEARCH = {
    "sigma": FloatDistribution(0.05, 1.0, log=True),
    "population_size": IntDistribution(8, 32, step=8),
}

ALGORITHM = Algorithm(
    name="linear_cma_es",
    model=LinearCmaEs,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("rewards",),
    vec_env=GroupedVecEnv,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
