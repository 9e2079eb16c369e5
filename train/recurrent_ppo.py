"""Train an agent with recurrent PPO, whose LSTM remembers earlier observations.

    python -m train.recurrent_ppo --seed 0

One command trains for one training seed. The same command resumes an interrupted training, and
does nothing if training is finished. Files: see ``train/training.py``. (Hochreiter and
Schmidhuber 1997, doi 10.1162/neco.1997.9.8.1735; Schulman et al. 2017, arXiv 1707.06347.)
"""

import sys
from typing import Any

import torch
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv

from train.actor import Actor
from train.ppo import settings
from train.run import Run
from train.training import Algorithm, command_line


class RecurrentActor(Actor):
    """An LSTM of one layer, followed by layers.

    The memory holds the LSTM's hidden state and its cell state side by side.
    """

    def __init__(self, policy: RecurrentActorCriticPolicy) -> None:
        super().__init__()
        self.lstm = policy.lstm_actor
        self.layers = torch.nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net)
        self.memory_size = 2 * self.lstm.hidden_size

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        # The LSTM expects a time axis in front of observations, and a layer axis before states.
        hidden, cell = (state.contiguous() for state in memory.unsqueeze(0).chunk(2, dim=2))
        output, (hidden, cell) = self.lstm(observation.unsqueeze(0), (hidden, cell))
        action = self.layers(output.squeeze(0)).clamp(-1.0, 1.0)
        return action, torch.cat((hidden, cell), dim=2).squeeze(0)


def new_model(run: Run, vec_env: VecEnv) -> RecurrentPPO:
    """Return an untrained model."""
    p = run.parameters
    arguments = settings(run)
    arguments["policy_kwargs"]["lstm_hidden_size"] = p["lstm_hidden_size"]
    arguments["policy_kwargs"]["enable_critic_lstm"] = p["enable_critic_lstm"]
    return RecurrentPPO("MlpLstmPolicy", vec_env, **arguments)


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 1_200_000,  # environment steps of the whole training
    "num_envs": 64,  # environments side by side
    "n_steps": 64,  # steps per environment between updates
    "batch_size": 1024,
    "n_epochs": 4,
    "gamma": 0.8,  # as for PPO
    "gae_lambda": 0.95,
    "learning_rate": 1e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "clip_range": 0.2,
    "ent_coef": 0.0,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
    "lstm_hidden_size": 32,  # of the LSTM
    "enable_critic_lstm": True,  # otherwise it sees the present observation only
    "net_arch": [64],  # behind the LSTM, for policy and value function each
    "activation_fn": "relu",  # or "tanh"
    "log_std_init": -1.0,
    "reward_scale": 0.3333333333,  # factor on rewards [s]
    "belief": False,  # shows the estimates of the optimisers' filter: baselines/belief.py
    "derived": False,  # shows the inputs of baselines/derived_observation.py
    "load_target": False,  # actions are load targets: baselines/load_target.py
    "position": False,  # tells the position along the bar: train/terms.py
    "frames": 1,  # successive observations that the agent sees
    "life_price": "flat",  # charge for the edge's life: "flat", "marginal" (p(D)) or "end"
}

SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "gamma": FloatDistribution(0.5, 0.999),
    "n_epochs": IntDistribution(2, 8),
    "lstm_hidden_size": CategoricalDistribution([16, 32, 64]),
}

ALGORITHM = Algorithm(
    name="recurrent_ppo",
    model=RecurrentPPO,
    new_model=new_model,
    network=RecurrentActor,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("rewards",),
    # The states of the LSTMs at the end of the last rollout, from which the next one goes on.
    extra_state=("_last_lstm_states",),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
