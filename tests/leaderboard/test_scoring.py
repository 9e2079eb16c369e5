"""The score of every kind of policy that a user may have."""

import json
import lzma
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers import NormalizeObservation, RescaleAction
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize

from baselines.catalogue import spec
from baselines.comparators import CAUSAL, comparators
from leaderboard.__main__ import main
from leaderboard.adapt import as_factory
from leaderboard.pack import Board, boards, contents
from leaderboard.play import play
from leaderboard.policies import named as named_policies
from leaderboard.scoring import (
    FOLDER,
    VALIDATION_FOLDER,
    VALIDATION_SEEDS,
    Score,
    compare,
    score,
    shipped,
    shipped_validation,
)
from leaderboard.seeds import tuning_seeds
from leaderboard.standings import Played
from leaderboard.statistics import Estimate
from leaderboard.validation import task_of, versions
from turning_env import FAMILY_ID, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.scenario.family import families

ROOT = Path(__file__).parents[2]
OVERRIDE = "RoughTurning-Override-v1"
PAPER = "RoughTurning-Paper-v0"  # an episode has few steps


def full_feed(observations: Any) -> Any:
    return np.full((len(observations), 2), 0.1, np.float32)


def named(name: str, policies: Sequence[Any]) -> Any:
    """Return the one with a name among results or comparisons."""
    (policy,) = (policy for policy in policies if policy.name == name)
    return policy


def episodes_of(result: Played) -> dict[str, Any]:
    """Return the episodes of a rule."""
    return {name: values[0] for name, values in result.episodes.items()}


class Counting:
    """A policy with a memory: the steps since the last reset."""

    def __init__(self) -> None:
        self.steps = np.zeros(0)

    def reset(self, mask: Any) -> None:
        steps = self.steps if len(self.steps) else np.zeros(len(mask))
        self.steps = np.where(mask, 0.0, steps)

    def act(self, observations: Any) -> Any:
        self.steps += 1
        return full_feed(observations)


class Full(torch.nn.Module):
    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return 0.1 + 0.0 * observations[:, :2]


class Alternating:
    """Alternates between two actions in every episode."""

    def __init__(self) -> None:
        self.steps = np.zeros((0, 1))

    def reset(self, mask: Any) -> None:
        if not len(self.steps):
            self.steps = np.zeros((len(mask), 1))
        self.steps[mask] = 0.0

    def act(self, observations: Any) -> Any:
        self.steps = self.steps + 1.0
        return np.repeat(0.25 * (self.steps % 2), 2, axis=1).astype(np.float32)


class AlternatingModule(torch.nn.Module):
    """The same with a memory that counts steps, in double precision."""

    memory_size = 1

    def __init__(self) -> None:
        super().__init__()
        self.step = torch.nn.Parameter(torch.ones(1, dtype=torch.float64))

    def forward(self, observations: Any, memory: Any) -> Any:
        steps = memory + self.step
        return (0.25 * (steps % 2)).expand(-1, 2), steps


class ActionsAndValues(torch.nn.Module):
    def forward(self, observations: Any) -> Any:
        return observations[:, :2], observations[:, 2]


class ShrinkingMemory(torch.nn.Module):
    memory_size = 3

    def forward(self, observations: Any, memory: Any) -> Any:
        return observations[:, :2], memory[:, :2]


class ForgottenMemory(torch.nn.Module):
    memory_size = 3

    def forward(self, observations: Any, memory: Any) -> Any:
        return observations[:, :2]


@pytest.fixture(scope="module")
def expected() -> Score:
    return score(full_feed, PAPER, seeds=4)


@pytest.mark.slow
def test_the_files_in_the_package_hold_the_results_that_ship() -> None:
    expected = contents(ROOT / "leaderboard" / "results")
    assert {path.name for path in FOLDER.iterdir()} == {path.name for path in expected}
    for path, content in expected.items():
        assert lzma.decompress(path.read_bytes()).decode() == content, path.name


@pytest.mark.parametrize(
    "policy",
    [Counting, Counting(), Full(), f"{__name__}:full_feed"],
    ids=["class", "object", "torch", "name"],
)
def test_every_kind_of_policy_plays_alike(policy: Any, expected: Score) -> None:
    played = score(policy, PAPER, seeds=4)
    assert played.episodes["return"].tolist() == expected.episodes["return"].tolist()


def test_a_module_with_a_memory_remembers_within_episodes() -> None:
    assert returns_of(AlternatingModule()) == returns_of(Alternating())


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (ActionsAndValues(), "ActionsAndValues returns a tuple of 2, but must return a tensor"),
        (ForgottenMemory(), "has a memory_size, but returns a Tensor"),
        (ShrinkingMemory(), r"of shape \(2, 3\), .* but returns one of shape \(2, 2\)"),
    ],
)
def test_a_module_that_returns_something_else_is_refused(
    module: torch.nn.Module, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        score(module, PAPER, seeds=2)


def test_a_module_acts_in_evaluation_mode_and_trains_on_afterwards() -> None:
    """Dropout and batch normalisation act as in the exported file."""
    module = torch.nn.Sequential(
        torch.nn.BatchNorm1d(11), torch.nn.Dropout(0.5), torch.nn.Linear(11, 2)
    )
    module[0].eval()  # a layer that is frozen in training
    returns = returns_of(module)
    assert [layer.training for layer in module] == [False, True, True]
    assert returns == returns_of(module.eval())


@pytest.mark.slow
def test_a_file_that_ships_reaches_the_return_that_ships() -> None:
    agent = ROOT / "agents" / OVERRIDE / "override" / "ppo-seed0.onnx"
    played = score(agent, OVERRIDE, seeds=8)
    ppo = named("ppo", shipped(OVERRIDE))
    assert played.episodes["return"] == pytest.approx(ppo.returns[0, :8], abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("family", families())
def test_a_family_is_scored_on_unseen_jobs(family: str) -> None:
    """Observations hold the nominal model's numbers; `idle` gets the return that ships."""
    # It does the same on all tasks whose actions are those of a family, such as `shift`.
    idle = spec("idle", Scenario.load("shift")).make(3)
    shapes = set()

    def act(observations: Any) -> Any:
        shapes.add(observations.shape)
        return idle.act(observations)

    played = score(act, FAMILY_ID, seeds=3, family=family)
    space = gymnasium.make(FAMILY_ID, family=family).observation_space
    assert space.shape is not None
    assert shapes == {(3, *space.shape)}
    result = named("idle", shipped(f"{FAMILY_ID}-{family}"))
    np.testing.assert_allclose(played.episodes["return"], result.returns[0, :3], atol=0.01)


def test_the_same_episodes_are_no_better_and_no_worse() -> None:
    name = "rescaled_grid_search"
    others = shipped("RoughTurning-v0", 16)
    episodes = episodes_of(named(name, others))
    scored = compare("RoughTurning-v0", episodes, Scenario.load("rough_turning"), others)
    same = named(name, scored.others)
    assert scored.standing.ahead_of(same) == Estimate(0.0, 0.0, 0.0)
    assert same.mean_return.estimate == scored.mean_return
    assert same.feasible == scored.feasible
    ranked = [other.name for other in scored.others if other.kind != "oracle"]
    assert scored.rank is not None
    assert ranked[scored.rank - 1] == name
    assert scored.ranked == len(ranked) + 1
    assert str(scored).startswith(f"rank {scored.rank} of {scored.ranked}, return ")


def test_the_table_has_a_line_for_each_policy_in_the_order_of_ranks() -> None:
    others = shipped(OVERRIDE, 64)
    scored = compare(
        OVERRIDE, episodes_of(named("omative", others)), Scenario.load("override"), others
    )
    header, *lines = scored.table().splitlines()
    assert header.split()[:3] == ["rank", "policy", "return"]
    assert len(lines) == len(scored.others) + 1
    for rank, line in enumerate(lines[: scored.ranked], start=1):
        assert line.split()[0] == str(rank)
    assert scored.rank is not None
    assert "-> this policy" in lines[scored.rank - 1]


def full_override(observations: Any) -> Any:
    return np.ones((len(observations), 1), np.float32)


def test_validation_plays_the_tuning_seeds_and_has_no_rank_on_the_leaderboard() -> None:
    scored = score(full_override, OVERRIDE, seeds=2, split="validation")
    expected = play(as_factory(full_override), Scenario.load("override"), tuning_seeds(2))
    assert scored.episodes["return"].tolist() == expected["return"].tolist()
    assert scored.rank is None
    assert str(scored).startswith("return ")
    assert "-> this policy" in scored.table()


@pytest.mark.slow
def test_validation_scores_between_the_ends_and_compares_with_the_best_rule() -> None:
    rule = spec("override_tuned", Scenario.load("override"))
    scored = score(rule, OVERRIDE, seeds=4, split="validation")
    assert scored.score is not None
    assert scored.score.value == pytest.approx(0.0, abs=0.1)
    best = named("constant_power_lead", scored.others)
    assert scored.standing.ahead_of(best).value < 0.0
    assert f"against {best.name}" in str(scored)
    names = [line.split()[0] for line in scored.table().splitlines()[1:]]
    # The rule itself is there, too, with returns that are rounded.
    assert sorted(names) == ["->", "causal", "constant_power_lead", "override_tuned"]
    assert names[0] == best.name
    assert names[-1] == "causal"


@pytest.mark.slow
def test_a_validation_score_has_a_rank_among_those_on_these_seeds() -> None:
    rule = spec("one_line_law", Scenario.load("override"))
    scored = score(rule, OVERRIDE, seeds=4, split="validation")
    assert scored.rank is None
    assert scored.validation_rank == 2
    assert "rank 2 of 3 on them, with constant_power_lead and override_tuned" in str(scored)
    assert scored.numbers()["validation_rank"] == 2


def test_a_validation_score_says_that_it_has_no_rank() -> None:
    without_others = score(full_override, OVERRIDE, VALIDATION_SEEDS + 1, split="validation")
    assert without_others.validation_rank is None
    assert "no rank: no policy that ships has played them all" in str(without_others)
    # On Paper, leaderboards rank rules alone.
    learned = score(full_feed, PAPER, seeds=2, split="validation")
    assert learned.validation_rank is None
    assert "no rank: the leaderboard ranks rules only" in str(learned)
    assert "on them" not in str(learned)


def test_more_validation_seeds_than_have_been_played_are_compared_with_nothing() -> None:
    assert shipped_validation(OVERRIDE, VALIDATION_SEEDS + 1) == ()
    assert shipped_validation("RoughTurning-Family-v1-mine", 8) == ()


@pytest.mark.parametrize("board", boards(), ids=lambda board: board.file_name)
def test_results_on_validation_seeds_are_of_the_present_versions(board: Board) -> None:
    board_name = board.file_name.removesuffix(".json.xz")
    results = shipped_validation(board_name, VALIDATION_SEEDS)
    assert results, f"play {board_name}: python -m leaderboard pack --validation"
    for result in results:
        assert result.returns.shape == (1, VALIDATION_SEEDS)
    task = task_of(board, seeds=2)
    policies = named_policies([result.name for result in results], task)
    text = lzma.decompress((VALIDATION_FOLDER / board.file_name).read_bytes())
    assert json.loads(text)["versions"] == versions(policies)
    fixed = comparators(task.scenario, on_family=board.family is not None).fixed
    assert {fixed, CAUSAL} <= {result.name for result in results}


def test_the_default_says_that_it_plays_held_out_seeds(expected: Score) -> None:
    assert expected.split == "held_out"
    assert str(expected).splitlines()[-1].startswith("held-out seeds: ")


def test_an_unknown_split_is_refused() -> None:
    with pytest.raises(ValueError, match="split is 'train'"):
        score(full_feed, PAPER, split="train")  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_rule_is_scored_by_its_spec() -> None:
    rule = spec("constant_power_lead", Scenario.load("override"))
    scored = score(rule, OVERRIDE, seeds=2)
    shipped_result = named("constant_power_lead", shipped(OVERRIDE, 2))
    np.testing.assert_allclose(scored.episodes["return"], shipped_result.returns[0], atol=0.01)


def test_a_rule_for_one_scenario_is_refused_on_a_family() -> None:
    rule = spec("predictive", Scenario())
    with pytest.raises(TypeError, match="plays one scenario"):
        score(rule, FAMILY_ID, seeds=2)


class ReturnsPair:
    def reset(self, mask: Any) -> None: ...

    def act(self, observations: Any) -> Any:
        return full_override(observations), None


class Regression:
    def predict(self, inputs: Any) -> Any: ...


class NeedsSize:
    def __init__(self, num_envs: int) -> None: ...


@pytest.mark.parametrize(
    ("policy", "error", "message"),
    [
        pytest.param(NeedsSize, TypeError, "object of NeedsSize.*num_envs", id="a class"),
        pytest.param(3, TypeError, "int", id="a number"),
        pytest.param("missing.onnx", FileNotFoundError, "missing.onnx", id="a missing file"),
        pytest.param(
            ROOT / "agents" / FAMILY_ID / "shop" / "ppo_load_target-seed0.onnx",
            ValueError,
            "derived and load_target, .* leaderboard run --agents",
            id="a file with wrappers",
        ),
        pytest.param(ROOT, ValueError, r"folder: .*train\.export", id="a folder"),
        pytest.param(Regression(), TypeError, "Regression is no policy", id="no model of SB3"),
        pytest.param(str(ROOT / "README.md"), ValueError, "README.md", id="no network"),
        pytest.param("missing", ValueError, "no such file: .*module:object", id="a bare name"),
        pytest.param("rule.py", ValueError, "such as rule:policy", id="a Python file"),
        pytest.param("rule.py:act", ValueError, "such as rule:act", id="a file and a name"),
        pytest.param(f"{__name__}:absent", ValueError, "absent", id="a missing name"),
        pytest.param(full_feed, ValueError, "shape", id="actions of another task"),
        pytest.param(lambda observations: None, ValueError, "returned None", id="no actions"),
        pytest.param(
            lambda observations: full_override(observations)[:, 0],
            ValueError,
            r"an array of shape \(2,\), but must return .*shape \(2, ",
            id="actions without a row per environment",
        ),
        pytest.param(
            lambda observations: (full_override(observations), None),
            ValueError,
            r"a tuple \(ndarray, NoneType\).*model\.predict\(observations",
            id="what predict returns",
        ),
        pytest.param(
            ReturnsPair(),
            ValueError,
            r"a tuple \(ndarray, NoneType\).*model\.predict\(observations",
            id="an object that returns what predict does",
        ),
    ],
)
def test_a_policy_that_cannot_play_is_refused(
    policy: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        score(policy, OVERRIDE, seeds=2)


def test_an_unknown_id_is_refused() -> None:
    with pytest.raises(ValueError, match="did you mean RoughTurning-v0"):
        score(full_feed, "RoughTurning-v1", split="validation")


@pytest.mark.parametrize("split", ["held_out", "validation"])
@pytest.mark.parametrize(
    ("env_id", "family", "message"),
    [
        pytest.param("CartPole-v1", None, "no id that can be scored", id="a foreign id"),
        pytest.param("RoughTurning-Shft-v0", None, "mean RoughTurning-Shift-v0", id="an error"),
        pytest.param("unmodelled", None, "family='unmodelled'", id="a family as the id"),
        pytest.param("RoughTurning-v0", "shop", "RoughTurning-Family-v1", id="a family unused"),
        pytest.param(None, None, "None is no id", id="no id"),
    ],
)
def test_a_task_that_cannot_be_scored_is_refused(
    env_id: Any, family: str | None, message: str, split: Any
) -> None:
    with pytest.raises(ValueError, match=message):
        score(full_feed, env_id, 2, family, split=split)


def test_a_number_of_seeds_that_the_leaderboard_has_not_is_refused() -> None:
    with pytest.raises(ValueError, match="2 to 64"):
        score(full_feed, OVERRIDE, seeds=1)
    with pytest.raises(ValueError, match="seeds is '8', but must be a whole number"):
        score(full_feed, OVERRIDE, seeds="8")  # type: ignore[arg-type]


def test_a_model_as_a_zip_file_is_sent_to_the_export(tmp_path: Path) -> None:
    (tmp_path / "me.zip").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"python -m train\.export"):
        score(tmp_path / "me.zip", OVERRIDE, 2)


def test_agents_of_the_published_simulation_are_not_ranked(expected: Score) -> None:
    assert expected.rank is None
    assert "no rank: the leaderboard ranks rules only" in str(expected)
    first = shipped(PAPER, 4)[0]
    episodes = {**first.episodes, "return": np.full((1, 4), 647.0)}
    gaming = Played(name="gaming", kind="agent", episodes=episodes)
    others = [*shipped(PAPER, 4), gaming]
    scored = compare(PAPER, expected.episodes, Scenario.load("paper"), others)
    assert scored.rank is None
    assert scored.ranked == expected.ranked
    *_, last_ranked = (line for line in scored.table().splitlines() if line[:4].strip().isdigit())
    assert last_ranked.split()[0] == str(scored.ranked)
    assert named("gaming", scored.others).unranked is not None
    (line,) = (line for line in scored.table().splitlines() if " gaming " in line)
    assert line.endswith("not ranked")


def test_small_returns_have_decimals() -> None:
    others = shipped(OVERRIDE, 64)
    episodes = episodes_of(named("omative", others))
    episodes["return"] = episodes["return"] + 0.1
    scored = compare(OVERRIDE, episodes, Scenario.load("override"), others)
    ahead = scored.standing.ahead_of(named("modified_fuzzy_override", scored.others))
    assert f"{ahead.value:+.2f} s" in scored.table()
    assert f"{scored.overload.severe_share:.2%}" in scored.load()


def test_the_share_of_severe_overload_is_called_severe() -> None:
    others = shipped("RoughTurning-v0", 16)
    episodes = episodes_of(named("grid_search", others))
    scored = compare("RoughTurning-v0", episodes, Scenario.load("rough_turning"), others)
    assert scored.overload.feasibility == "infeasible"
    assert f"{scored.overload.severe_share:.1%} of cutting time in severe overload" in str(scored)


def learned(env: Any, **options: Any) -> PPO:
    return PPO(
        "MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1, seed=1, device="cpu", **options
    ).learn(32)


def returns_of(policy: Any) -> list[float]:
    """Return the returns of a policy on the first seeds of a task."""
    returns: list[float] = score(policy, PAPER, seeds=4).episodes["return"].tolist()
    return returns


@pytest.mark.slow
def test_a_normalised_model_is_scored_with_its_statistics_or_refused(tmp_path: Path) -> None:
    env = VecNormalize(RoughTurningVecEnv("paper", 2))
    model = learned(env)

    def normalised(observations: Any) -> Any:
        return model.predict(env.normalize_obs(observations), deterministic=True)[0]

    def plain(observations: Any) -> Any:
        return model.predict(observations, deterministic=True)[0]

    returns = returns_of(model)
    assert returns == returns_of(normalised)
    assert returns != returns_of(plain)
    model.save(tmp_path / "mine.zip")
    with pytest.raises(ValueError, match="VecNormalize, whose statistics its file does not hold"):
        returns_of(PPO.load(tmp_path / "mine.zip"))
    # Another environment does not hold them either.
    with pytest.raises(ValueError, match="VecNormalize, whose statistics its file does not hold"):
        returns_of(PPO.load(tmp_path / "mine.zip", env=RoughTurningVecEnv("paper", 2)))
    env.save(str(tmp_path / "statistics.pkl"))
    loaded = VecNormalize.load(str(tmp_path / "statistics.pkl"), RoughTurningVecEnv("paper", 2))
    assert returns_of(PPO.load(tmp_path / "mine.zip", env=loaded)) == returns


@pytest.mark.slow
def test_the_policy_of_a_model_plays_on_plain_observations_with_a_notice() -> None:
    model = PPO(
        "MlpPolicy",
        RoughTurningVecEnv("paper", 2),
        seed=1,
        device="cpu",
    )
    with pytest.warns(UserWarning, match="ActorCriticPolicy does not say whether VecNormalize"):
        returns = returns_of(model.policy)
    assert returns == returns_of(model)


@pytest.mark.slow
def test_a_model_that_was_trained_on_named_entries_is_refused() -> None:
    env = DummyVecEnv([lambda: ByName(gymnasium.make(PAPER))])
    model = PPO("MultiInputPolicy", env, device="cpu")
    with pytest.raises(ValueError, match="of the kind Dict"):
        score(model, PAPER, seeds=2)


class ByName(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Gives observations as a dictionary of one entry."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Dict({"all": env.observation_space})

    def observation(self, observation: Any) -> Any:
        return {"all": observation}


class Halved(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Changes observations, but not their space."""

    def observation(self, observation: Any) -> Any:
        return 0.5 * observation


def stacked_frames() -> Any:
    return VecFrameStack(RoughTurningVecEnv("paper", 2), 4)


def normalised_in_each_environment() -> Any:
    return DummyVecEnv([lambda: NormalizeObservation(gymnasium.make(PAPER))])


def halved() -> Any:
    return DummyVecEnv([lambda: Halved(gymnasium.make(PAPER))])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make_env", "message"),
    [
        (stacked_frames, "behind VecFrameStack.* an object with reset and act"),
        (normalised_in_each_environment, "NormalizeObservation"),
        (halved, "Halved"),
    ],
)
def test_a_model_behind_a_wrapper_that_changes_observations_is_refused(
    make_env: Any, message: str
) -> None:
    model = PPO("MlpPolicy", make_env(), device="cpu")
    with pytest.raises(ValueError, match=message):
        score(model, PAPER, seeds=4)


def rescaled_actions() -> Any:
    rescaled = RescaleAction(gymnasium.make(PAPER), np.float32(0), np.float32(1))
    return DummyVecEnv([lambda: rescaled])


def numbered_actions() -> Any:
    return DummyVecEnv([lambda: Numbered(gymnasium.make(PAPER))])


class Numbered(gymnasium.ActionWrapper[Any, Any, Any]):
    """Takes one of two actions, by its number."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.action_space = gymnasium.spaces.Discrete(2)

    def action(self, action: Any) -> Any:
        return np.full(2, action, np.float32)


@pytest.mark.parametrize(
    ("make_env", "message"),
    [
        (rescaled_actions, r"actions Box\(0.0, 1.0, .* in -1\.\.1"),
        (numbered_actions, r"actions Discrete\(2\)"),
    ],
)
@pytest.mark.slow
def test_a_model_behind_a_wrapper_that_changes_actions_is_refused(
    make_env: Any, message: str
) -> None:
    model = PPO("MlpPolicy", make_env(), device="cpu")
    with pytest.raises(ValueError, match=message):
        score(model, PAPER, seeds=4)


@pytest.mark.parametrize(
    ("make_env", "message"),
    [(stacked_frames, "44 entries"), (normalised_in_each_environment, "NormalizeObservation")],
)
def test_the_file_of_a_model_with_another_space_is_refused(
    make_env: Any, message: str, tmp_path: Path
) -> None:
    PPO("MlpPolicy", make_env(), device="cpu").save(tmp_path / "mine.zip")
    with pytest.raises(ValueError, match=message):
        score(PPO.load(tmp_path / "mine.zip"), PAPER, seeds=4)


def adds_shapes_that_do_not_fit(observations: Any) -> Any:
    return np.zeros(2) + np.zeros(3)


def test_an_error_in_own_code_is_placed(capsys: pytest.CaptureFixture[str]) -> None:
    name = f"{__name__}:adds_shapes_that_do_not_fit"
    line = adds_shapes_that_do_not_fit.__code__.co_firstlineno + 1
    assert main(["score", name, "--env", PAPER, "--seeds", "2", "--split", "validation"]) == 2
    assert f"(test_scoring.py, line {line})" in capsys.readouterr().err


def test_the_command_prints_the_score(expected: Score, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["score", f"{__name__}:full_feed", "--env", PAPER, "--seeds", "4", "--json"]
    assert main(words) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["mean_return"]["value"] == expected.mean_return.value
    assert printed["ranked"] == expected.ranked
    assert main([*words, "--split", "validation"]) == 0
    assert json.loads(capsys.readouterr().out)["split"] == "validation"
