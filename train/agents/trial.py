"""Try an agent's network: its actions must be in range, reproducible, and independent of the other environments in the batch."""

from typing import Any

import numpy as np

from turning_env.scoring.onnx_session import Floats, OnnxPolicy, session_of

TOLERANCE = 1e-4
"""Largest difference of an environment's action when other environments are in the batch: sums may be taken in another order."""
_NUM_ENVS = 8  # with which a network is tried


def act_checked(policy: OnnxPolicy, observations: Floats, generator: np.random.Generator) -> Floats:
    """Act, and check that actions are reproducible and independent of the other environments in the batch.

    Raises:
        ValueError: they are not, or the observations have another shape or type.
    """
    before = policy.memory
    actions = policy.act(observations)
    again, _ = policy.run(observations, before)
    if again.tobytes() != actions.tobytes():
        raise ValueError("gives other actions for the same observations")
    if len(observations) > 1:
        for part in np.array_split(generator.permutation(len(observations)), 2):
            alone = policy.run(observations[part], before[part])
            for mine, its in zip((actions, policy.memory), alone, strict=True):
                if not np.allclose(mine[part], its, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True):
                    raise ValueError("an environment's actions or memory depend on the other environments in the batch")
    return actions


def tried(content: bytes, entries: int, actions: int, memory_size: int) -> Any:
    """Return the session of a file's content after a trial on zeros and on observations of order one.

    Raises:
        ValueError: ONNX Runtime cannot run it, its outputs are not actions, or they are not reproducible.
    """
    session, generator = session_of(content), np.random.default_rng(0)
    sampled = generator.uniform(-1.0, 1.0, (2, _NUM_ENVS, entries)).astype(np.float32)
    for given in (np.zeros((2, 2, entries), np.float32), sampled):
        policy = OnnxPolicy(session, memory_size, given.shape[1])
        for observations in given:  # the second time with a memory
            check_actions(act_checked(policy, observations, generator), (len(observations), actions))
    return session


def check_actions(actions: Floats, shape: tuple[int, int]) -> None:
    """Check that actions have the shape and lie in -1 to 1.

    Raises:
        ValueError: they are not.
    """
    if actions.shape != shape or actions.dtype != np.float32 or not (np.abs(actions) <= 1.0).all():
        wrong = actions[~(np.abs(actions) <= 1.0).all(axis=1)] if actions.shape == shape else actions
        many = f"{shape[0]} actions" if shape[0] != 2 else "two actions"
        raise ValueError(f"acts {wrong[:1].tolist()}, which are not {many} of {shape[1]} numbers in -1 to 1")
