"""The ablation's lathes charge what they should, its agents play as they were trained, and its table comes whole."""

from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import ablation
from benchmarks.ablation import FRAMES, VARIANTS, ChargedAtEnd, Played, PricedByLeft, Stacked, StackedActor, edge_price
from tests.train.small import PARAMETERS, SCENARIO
from tests.turning_env.playing import changed
from train.actor import ActorPolicy
from train.run import Run, hyperparameters
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

# Of its edges some wear out, some break, and some last till the end.
MIXED = changed(SCENARIO, tool={"edge_strength": 1500.0, "edge_strength_spread": 0.3}, control={"time_limit": 0.3})
NUM_ENVS = 8


@pytest.mark.parametrize("lathes", [ChargedAtEnd, PricedByLeft])
def test_what_is_learned_from_adds_up_over_an_edge(lathes: type[RoughTurningVecEnv]) -> None:
    ours, single = lathes(MIXED, NUM_ENVS, 0.5), RoughTurningVectorEnv(NUM_ENVS, MIXED, "SameStep")
    ours.seed(5)
    ours.reset()
    single.reset(seed=5)
    generator = np.random.default_rng(1)
    learned, kinds = np.zeros(NUM_ENVS), set()
    for _ in range(400):
        actions = generator.uniform(-0.5, 1.0, (NUM_ENVS, 2)).astype(np.float32)
        _, rewards, dones, infos = ours.step(actions)
        *_, terminated, truncated, terms = single.step(actions)
        learned += rewards / 0.5
        for index in np.flatnonzero(dones):
            used, broken = (terms["final_info"][name][index] for name in ("used_life", "broken"))
            kinds.add("unfinished" if truncated[index] else "broken" if broken else "worn")
            counted = 1.0 if terminated[index] else used
            if isinstance(ours, PricedByLeft):
                more = ours.potential(counted)
            else:  # what an edge has cost, if it is still in use, is still to be paid
                more = edge_price(MIXED) * used if truncated[index] else 0.0
            assert learned[index] == pytest.approx(infos[index]["episode"]["r"] + more, rel=1e-4, abs=1e-2)
            learned[index] = 0.0
    assert kinds == {"unfinished", "broken", "worn"}


def test_a_fresh_edge_is_dear_and_a_worn_one_cheap_where_life_is_priced_by_what_is_left() -> None:
    lathes = PricedByLeft(Scenario(), 1)
    fresh, worn = (lathes.potential(np.array([low, low + 0.1])) for low in (0.0, 0.9))
    assert fresh[1] < fresh[0]  # pays more than the flat price
    assert worn[1] > worn[0]


class Shown(torch.nn.Module):
    """Layers that keep what they are shown."""

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        self.last = observations
        return observations[:, :2]


def test_history_is_what_was_seen_since_the_episode_began_in_training_and_in_play() -> None:
    """An actor's layers are shown what the lathes of its training show."""
    lathes, plain = Stacked(MIXED, NUM_ENVS), RoughTurningVecEnv(MIXED, NUM_ENVS)
    shown = Shown()
    policy = ActorPolicy(StackedActor(shown, entries=11), NUM_ENVS)
    lathes.seed(3)
    plain.seed(3)
    observations, single = lathes.reset().copy(), plain.reset()
    assert lathes.observation_space.shape == (FRAMES * 11,)
    generator, ends = np.random.default_rng(1), 0
    for _ in range(200):
        assert lathes.observation_space.contains(observations[0])
        policy.act(single)
        np.testing.assert_array_equal(shown.last.numpy(), observations)
        actions = generator.uniform(-0.5, 1.0, (NUM_ENVS, 2)).astype(np.float32)
        before = observations
        observations, _, dones, infos = lathes.step(actions)
        single, _, _, plain_infos = plain.step(actions)
        policy.reset(dones)
        for index in np.flatnonzero(dones):
            ends += 1
            last = np.concatenate([before[index, 11:], plain_infos[index]["terminal_observation"]])
            np.testing.assert_array_equal(infos[index]["terminal_observation"], last)
            assert not observations[index, :-11].any()
    assert ends > 3


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings of some hundred intervals, on edges that wear out soon."""
    known = hyperparameters("ppo", ablation.ENV_ID) | PARAMETERS["ppo"] | {"rollout": 32, "batch_size": 64}
    monkeypatch.setattr("train.run.hyperparameters", lambda algorithm, env_id: known)
    monkeypatch.setattr(ablation, "IDS", {ablation.ENV_ID: SCENARIO})
    monkeypatch.setattr(ablation, "NUM_SEEDS", 3)


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_every_variant_is_trained_played_and_tabled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "docs" / "ablation.md"
    arguments = ["--steps", "300", "--runs", str(tmp_path / "runs"), "--out", str(out)]
    assert ablation.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" | ")[0][2:] for line in lines[2:]] == [variant.title for variant in VARIANTS.values()]
    assert all(line.count("|") == lines[0].count("|") for line in lines)
    written = out.read_text("utf-8")
    assert "\n".join(lines) in written
    assert f"python -m benchmarks.ablation {' '.join(arguments)}" in written
    scenarios = {name: Run.read(ablation_folder(tmp_path, name)).scenario for name in VARIANTS}
    assert scenarios["set_point"].control.action == "set_point"
    assert scenarios["as_it_is"] == SCENARIO


def ablation_folder(folder: Path, name: str) -> Path:
    """Where a variant's first training is kept."""
    return folder / "runs" / "ablation" / name / ablation.ENV_ID / SCENARIO.name / "ppo-seed0"


def test_differences_are_paired_by_draw() -> None:
    """Draws differ by far more than the variants do."""
    draws = np.linspace(-500.0, 500.0, 40)
    rows = [
        Played(name, {"return": np.stack([draws + more, draws + more + 2.0])} | dict.fromkeys(COUNTS, np.ones((2, 40))), 7.0)
        for name, more in (("as_it_is", 0.0), ("discount_0.5", 30.0))
    ]
    first, second = (line.split(" | ") for line in ablation.table(rows)[2:])
    assert (first[2], second[2]) == ("", "30.0 (28.0 to 32.0)")
    assert first[1].startswith("1 (-")
    assert second[3:] == ["100.00", "100.0", "7 |"]


COUNTS = ("severe_overload_time", "engaged_time", "edges_broken", "edges_used")
