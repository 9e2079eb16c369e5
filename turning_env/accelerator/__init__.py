"""The same transition on an NVIDIA GPU: ``docs/accelerator.md`` says how to use it, and what has been tested.

import torch
from turning_env.accelerator import AcceleratedLathes

lathes = AcceleratedLathes(65536, "rough_turning")
lathes.reset(seed=0)
observations = torch.as_tensor(lathes.observations, device="cuda")  # the same memory
lathes.step(torch.zeros(65536, 2, device="cuda"))
"""

from turning_env.accelerator.lathes import AcceleratedLathes
from turning_env.accelerator.target import NoAcceleratorError, need_accelerator

__all__ = ["AcceleratedLathes", "NoAcceleratorError", "need_accelerator"]
