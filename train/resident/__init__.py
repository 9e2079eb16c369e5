"""PPO whose rollouts, advantages and updates stay on the device on which the lathes are: ``docs/accelerator.md``."""
