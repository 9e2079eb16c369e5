"""skrl: PPO on the vector environment.

    python -m examples.skrl_ppo --total-timesteps 200000
    python -m examples.skrl_ppo --env RoughTurning-Family-v1 --gamma 0.997 --reward-scale 0.05

skrl expects the next episode's first observation at the end of an episode, so the autoreset mode
must be SAME_STEP.
"""

import math
import sys
from collections.abc import Sequence

import gymnasium
import torch
from skrl.agents.torch import ExperimentCfg
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.trainers.torch import SequentialTrainer, SequentialTrainerCfg
from skrl.utils import set_seed
from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

import turning_env  # noqa: F401 - registers the ids
from examples.shared import of_tensors, parser, run, score

N_STEPS = 64  # steps per environment between updates


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    options = parser("skrl_ppo", __doc__, 200_000, num_envs=64, ids=True).parse_args(arguments)
    set_seed(options.seed)
    envs = wrap_env(
        gymnasium.make_vec(options.env, options.num_envs, autoreset_mode="SameStep"),
        wrapper="gymnasium",
    )
    spaces = {
        "observation_space": envs.observation_space,
        "action_space": envs.action_space,
        "device": "cpu",
    }
    layers = [{"name": "net", "input": "OBSERVATIONS", "layers": [64, 64], "activations": "relu"}]
    policy = gaussian_model(**spaces, network=layers, output="ACTIONS", initial_log_std=-1.0)
    value = deterministic_model(**spaces, network=layers, output="ONE")
    cfg = PPO_CFG(
        rollouts=N_STEPS,
        learning_epochs=5,
        mini_batches=8,
        discount_factor=options.gamma,
        experiment=ExperimentCfg(write_interval=0, checkpoint_interval=0),
    )
    # A truncated episode would go on: its last reward gets the value of its last observation.
    cfg.time_limit_bootstrap = True
    cfg.rewards_shaper = lambda rewards, *_: rewards * options.reward_scale
    memory = RandomMemory(memory_size=N_STEPS, num_envs=options.num_envs, device="cpu")
    agent = PPO(models={"policy": policy, "value": value}, memory=memory, cfg=cfg, **spaces)

    updates = math.ceil(options.total_timesteps / (N_STEPS * options.num_envs))
    trainer_cfg = SequentialTrainerCfg(timesteps=updates * N_STEPS, headless=True)
    SequentialTrainer(env=envs, agents=agent, cfg=trainer_cfg).train()
    policy.eval()

    def mean(observations: torch.Tensor) -> torch.Tensor:
        _, outputs = policy.act({"observations": observations}, role="policy")
        actions: torch.Tensor = outputs["mean_actions"]
        return actions

    result = score(of_tensors(mean), options.tuning_seeds, options.env)
    print(f"PPO after {options.total_timesteps} steps: {result}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
