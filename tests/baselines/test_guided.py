import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from baselines.guided import (
    HISTORY,
    START_SHARE,
    GuidedPolicy,
    GuidedRule,
    decision_space,
    feature_space,
)
from tests.turning_env.playing import changed
from turning_env import Family, FamilyVectorEnv
from turning_env.scoring.policy import Policy

FAMILY = Family.load("unmodelled")


def lathes(*jobs):
    """Environments of some training jobs, and their nominal models."""
    env = FamilyVectorEnv(len(jobs), FAMILY, autoreset_mode=AutoresetMode.DISABLED)
    return env, env.reset(seed=list(jobs))[0], [FAMILY.job(job).scenario.nominal() for job in jobs]


class Constant(Policy):
    """A guide that always decides the same; it keeps the features that it was shown."""

    def __init__(self, *decision):
        self.decision, self.shown = decision, []

    def reset(self, mask):
        self.shown.clear()

    def act(self, observations):
        self.shown.append(observations)
        return np.tile(np.float32(self.decision), (len(observations), 1))


def test_decisions_limit_the_speed_and_the_used_life():
    speeds, lives = [], []
    for decision in ((-1.0, -1.0), (0.2, 0.0)):
        env, observations, models = lathes(7)
        policy = GuidedPolicy(Constant(*decision), models)
        fastest, longest = 0.0, 0.0
        for step in range(1500):
            observations, *_, infos = env.step(policy.act(observations))
            if step > 20:  # the job starts at a speed of its own
                fastest = max(fastest, infos["cutting_speed"][0])
            longest = max(longest, infos["used_life"][0])
        speeds.append(fastest / (START_SHARE * models[0].machine.cutting_speed_max))
        lives.append(longest)
    limits = 0.8 * np.exp([-0.6, 0.12])
    np.testing.assert_array_less(speeds, limits + 1e-6)
    assert lives[0] < lives[1]


def test_a_batch_decides_as_its_environments_alone_and_as_often_as_it_should():
    guide, jobs = Constant(0.1, 0.1), (5, 9)
    env, observations, models = lathes(*jobs)
    policy, alone = (
        GuidedPolicy(guide, models),
        [GuidedPolicy(Constant(0.1, 0.1), [model]) for model in models],
    )
    for _ in range(90):
        actions = policy.act(observations)
        each = [single.act(observations[[i]])[0] for i, single in enumerate(alone)]
        np.testing.assert_array_equal(actions, each)
        observations, *_ = env.step(actions)
    assert len(guide.shown) == 3
    space = feature_space(len(FAMILY.context_names))
    assert all(space.contains(row) for shown in guide.shown for row in shown)
    assert decision_space().shape == (2,)


def test_it_remembers_the_edge_that_broke():
    env, observations, models = lathes(2)  # a bar of adhesive steel, which notches edges
    rule = GuidedRule(models)
    history, used = {"edges_broken": 0.0}, 0.0
    while history["edges_broken"] == 0.0:
        history = dict(zip(HISTORY, rule.features(observations)[0, -len(HISTORY) :], strict=True))
        observations, *_, infos = env.step(rule.act(observations))
        used = max(used, infos["used_life"][0])
    assert history["edges_broken"] == np.float32(1 / 3)
    assert history["heat_at_breakage"] < 1.0
    assert history["life_at_breakage"] == pytest.approx(used, rel=0.03)  # by the measured wear


def test_a_lathe_of_ones_own_has_the_context_of_a_job_that_is_alike():
    job = FAMILY.job(5)
    _, observations, models = lathes(5)
    mean, spread = FAMILY.context_scale
    numbers = dict(zip(FAMILY.context_names, job.context * spread + mean, strict=True))
    context = FAMILY.context_of(
        job.scenario, {name: numbers[name] for name in FAMILY.shown}
    ).astype(np.float32)
    guides = Constant(0.0, 0.0), Constant(0.0, 0.0)
    GuidedPolicy(guides[0], models).act(observations)
    GuidedPolicy(guides[1], models, context[np.newaxis]).act(observations[:, : -len(context)])
    np.testing.assert_allclose(guides[1].shown[0], guides[0].shown[0], atol=1e-6)
    own = changed(models[0], control={"edge_changes": "automatic"})
    assert GuidedPolicy(guides[1], [own], context[np.newaxis]).act(
        observations[:, : -len(context)]
    ).shape == (1, 2)
    with pytest.raises(ValueError, match="stiffness"):
        FAMILY.context_of(job.scenario, {"heat": 0.5})
