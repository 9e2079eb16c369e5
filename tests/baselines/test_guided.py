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
from turning_env.policy import Policy

FAMILY = Family.load("unmodelled")


def environments(*jobs):
    """Return environments of training jobs, and their first observations."""
    env = FamilyVectorEnv(len(jobs), FAMILY, autoreset_mode=AutoresetMode.DISABLED)
    observations, _ = env.reset(seed=list(jobs))
    return env, observations


def nominal_models(*jobs):
    """Return the nominal models of training jobs."""
    return [FAMILY.job(job).scenario.nominal() for job in jobs]


class Constant(Policy):
    """A guide that always decides the same; it keeps the features that it was shown."""

    def __init__(self, speed, life):
        self.decision = np.float32([speed, life])
        self.shown = []

    def reset(self, mask):
        self.shown.clear()

    def act(self, observations):
        self.shown.append(observations)
        return np.tile(self.decision, (len(observations), 1))


@pytest.mark.slow
def test_decisions_limit_the_speed_and_the_used_life():
    speeds = []
    lives = []
    for guide in (Constant(-1.0, -1.0), Constant(0.2, 0.0)):
        env, observations = environments(10)
        models = nominal_models(10)
        policy = GuidedPolicy(guide, models)
        fastest = 0.0
        longest = 0.0
        for step in range(1500):
            observations, *_, infos = env.step(policy.act(observations))
            if step > 20:  # the job starts at a speed of its own
                fastest = max(fastest, infos["cutting_speed"][0])
            longest = max(longest, infos["used_life"][0])
        highest_start = START_SHARE * models[0].machine.cutting_speed_max
        speeds.append(fastest / highest_start)
        lives.append(longest)
    limits = 0.8 * np.exp([-0.6, 0.12])
    np.testing.assert_array_less(speeds, limits + 1e-6)
    assert lives[0] < lives[1]


def test_a_batch_decides_as_its_environments_alone_and_as_often_as_it_should():
    guide = Constant(0.1, 0.1)
    env, observations = environments(5, 9)
    models = nominal_models(5, 9)
    policy = GuidedPolicy(guide, models)
    singles = [GuidedPolicy(Constant(0.1, 0.1), [model]) for model in models]
    for _ in range(90):
        actions = policy.act(observations)
        for index, single in enumerate(singles):
            action = single.act(observations[[index]])[0]
            np.testing.assert_array_equal(action, actions[index])
        observations, *_ = env.step(actions)
    assert len(guide.shown) == 3
    space = feature_space(len(FAMILY.context_names))
    for features in np.concatenate(guide.shown):
        assert features in space
    assert decision_space().shape == (2,)


def test_it_remembers_the_edge_that_broke():
    env, observations = environments(9)  # on this lathe, the first edge breaks early
    models = nominal_models(9)
    rule = GuidedRule(models)
    history = {"edges_broken": 0.0}
    used = 0.0
    while history["edges_broken"] == 0.0:
        features = rule.features(observations)[0]
        history = dict(zip(HISTORY, features[-len(HISTORY) :], strict=True))
        observations, *_, infos = env.step(rule.act(observations))
        used = max(used, infos["used_life"][0])
    assert history["edges_broken"] == np.float32(1 / 3)
    assert history["heat_at_breakage"] < 1.0
    assert history["life_at_breakage"] == pytest.approx(used, rel=0.03)  # by the measured wear


def numbers_shown(job):
    """Return the numbers of a job that its family shows, from its context."""
    mean, spread = FAMILY.context_scale
    values = job.context * spread + mean
    numbers = dict(zip(FAMILY.context_names, values, strict=True))
    return {name: numbers[name] for name in FAMILY.shown}


def test_a_lathe_of_ones_own_has_the_context_of_a_job_that_is_alike():
    job = FAMILY.job(5)
    _, observations = environments(5)
    models = nominal_models(5)
    context = FAMILY.context_of(job.scenario, numbers_shown(job)).astype(np.float32)
    without_context = observations[:, : -len(context)]
    guide = Constant(0.0, 0.0)
    guide_of_own = Constant(0.0, 0.0)
    GuidedPolicy(guide, models).act(observations)
    GuidedPolicy(guide_of_own, models, context[np.newaxis]).act(without_context)
    np.testing.assert_allclose(guide_of_own.shown[0], guide.shown[0], atol=1e-6)


def test_a_guide_plays_a_lathe_that_changes_edges_by_itself():
    job = FAMILY.job(5)
    _, observations = environments(5)
    (model,) = nominal_models(5)
    context = FAMILY.context_of(job.scenario, numbers_shown(job)).astype(np.float32)
    without_context = observations[:, : -len(context)]
    automatic = changed(model, control={"edge_changes": "automatic"})
    policy = GuidedPolicy(Constant(0.0, 0.0), [automatic], context[np.newaxis])
    assert policy.act(without_context).shape == (1, 2)


def test_a_number_that_a_context_lacks_is_named():
    with pytest.raises(ValueError, match="stiffness"):
        FAMILY.context_of(FAMILY.job(5).scenario, {"adhesion": 0.5})
