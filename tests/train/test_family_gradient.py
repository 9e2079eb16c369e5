"""One agent for all lathes: its teacher, its training, and what it becomes for one scenario."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import tomli_w
import torch
from numpy.typing import NDArray

from baselines.models import edge_value
from baselines.models.edge_value import Worth
from baselines.models.kalman_steps import DEPTH, HARDNESS
from baselines.models.load_filter import LAW_ERRORS, LoadFilter, Uncertainty
from tests.train import onnx_agents
from tests.turning_env.test_family_env import BRIEF
from train import export, family_actor, family_gradient, job_optimum, newton_search
from train.agents import agent_file, bake
from train.edge_worths import worths
from train.family_actor import HISTORY, LAWS, PLACE, STATES, TAYLOR, Estimate, FamilyActor, JobFilter, Linear, Place
from train.family_gradient import ALGORITHM, SEEDS, Lathes, Training, main, plan, train
from train.law_errors import ERRORS, LOADS
from train.model_gain import FIELDS, ModelGain, Truth
from train.run import Run
from turning_env import Family, FamilyVectorEnv, Scenario, read
from turning_env.physics.quantities import OBS, layout
from turning_env.scenario.plan import MIDDLE, Columns, columns_of, plan_of
from turning_env.scoring.onnx_session import OnnxPolicy, session_of

pytestmark = pytest.mark.slow

FAMILY = Family.load(BRIEF)
SHARED = [*range(HISTORY), LAWS, *range(LAWS + LOADS[0], STATES)]
"""States that the compiled filter has, too."""
SMALL = {"steps": 4 * 16 * 8, "num_envs": 8, "rollout": 16, "batch_envs": 4, "cells": 8, "width": 8, "restart_steps": 40}


def small_run(runs: Path, seed: int = 3, **changes: Any) -> Run:
    return plan(FAMILY, seed, runs, "a command", SMALL | changes)


def filter_of(family: Family) -> JobFilter:
    return JobFilter(family.job(0).scenario, context_of(family))


def context_of(family: Family) -> dict[str, Any]:
    context: dict[str, Any] = plan(family, 0, Path("unused"), "a command", {}).parameters["context"]
    return context


def told_of(tracker: JobFilter, family: Family, count: int) -> dict[str, torch.Tensor]:
    """The numbers of the first jobs' contexts by name, not standardised."""
    observations, _ = FamilyVectorEnv(count, family).reset(seed=list(range(count)))
    entries = len(layout(family.job(0).scenario))
    context = torch.from_numpy(observations[:, entries:]).double() * tracker._told_spread + tracker._told_mean
    return dict(zip(family.context_names, context.unbind(dim=-1), strict=True))


def doubted(observations: NDArray[np.float32], doubt: float = 1.0) -> torch.Tensor:
    return torch.from_numpy(np.pad(observations, ((0, 0), (0, 1)), constant_values=doubt))


def test_the_gain_of_many_jobs_is_that_of_each() -> None:
    random, steps, numbers = np.random.default_rng(0), 3, np.array([3, 60, 17])
    lathes = Lathes(FAMILY)
    scenarios, prices = lathes.scenarios(numbers), Worth(random.random(3), 500.0 * random.random((3, 5)))  # type: ignore[arg-type]
    path = 50.0 + 5.0 * random.random((steps + 1, 3))
    states = np.stack(
        [
            *(path, random.uniform(1, 6, path.shape), random.uniform(0.8, 1.3, path.shape)),
            *(random.random(path.shape), random.uniform(0, 2000, path.shape)),
        ],
        1,
    )
    assert states.shape[1] == len(FIELDS)
    changed, failed = random.random((2, steps, 3)) < 0.3
    hidden = states[:-1], states[1:], changed, failed & changed
    logs = torch.tensor(np.log(random.uniform([[50], [0.1]], [[250], [0.5]], (steps, 2, 3))), dtype=torch.float32)
    now = torch.tensor(random.uniform([[50], [0.1]], [[250], [0.5]], (steps, 2, 3)), dtype=torch.float32)

    def gain(model: ModelGain, truth: Truth, envs: slice) -> list[torch.Tensor]:
        given = logs[..., envs].clone().requires_grad_()
        speed, feed = now[:, 0, envs], now[:, 1, envs]
        found, going_on = model(given[:, 0], given[:, 1], speed, feed, truth)
        (slope,) = torch.autograd.grad(found.sum(), given)
        return [found, going_on, slope[:, 0], slope[:, 1]]

    together = gain(ModelGain(scenarios, prices), Truth(scenarios, *hidden), slice(3))
    for i, number in enumerate(numbers.tolist()):
        scenario, one = FAMILY.job(number).scenario, slice(i, i + 1)
        own = Worth(prices.time[i], prices.life[i])  # type: ignore[index]
        apart = gain(ModelGain(scenario, own), Truth(scenario, *(each[..., one] for each in hidden)), one)
        for mine, its in zip(apart, together, strict=True):
            torch.testing.assert_close(mine, its[:, one], rtol=1e-5, atol=1e-5)


def test_many_prices_are_those_of_each_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edge_value, "_SETTINGS", (12, 16))
    for number in (3, 60):
        job = FAMILY.job(number).scenario
        scenario = job.model_copy(update={"spindle": job.spindle.model_copy(update={"idle_torque": 0.0, "max_speed": 0.0})})
        single = edge_value.worth_of_lots.__wrapped__(scenario, scenario.economics.overload_price, (1.0,))[0]
        columns = Columns(scenario.model_dump(exclude={"name", "nominal_model"}))
        many = worths(columns, 1, grid=(12, 16), lives=len(edge_value.USED_LIVES))
        assert float(many.time[0]) == pytest.approx(single.time, abs=2e-3)  # type: ignore[index]
        np.testing.assert_allclose(many.life[0], single.life, rtol=0.01, atol=1.0)


def test_the_agent_knows_where_the_tool_is() -> None:
    env = FamilyVectorEnv(8, FAMILY)
    tracker = filter_of(FAMILY)
    observations, infos = env.reset(seed=0)
    state, random, numbers = torch.zeros(8, JobFilter.STATES), np.random.default_rng(0), infos["job"]
    works = [env.job(i).scenario.workpiece for i in range(8)]
    approach, length = (np.array([getattr(work, name) for work in works]) for name in ("approach", "bar_length"))
    errors = []
    for _ in range(60):
        readings, state = tracker(doubted(observations), state)
        share = (infos["path"] % (approach + length) - approach) / length
        along = 0.5 * (readings[:, -2].numpy() + 1.0)
        error = (along - share + 0.5) % 1.0 - 0.5
        errors.append(np.where((infos["job"] == numbers) & (share > 0.0), error, 0.0))
        actions = np.concatenate([random.uniform(-1, 1, (8, 2)), -np.ones((8, 1))], axis=1)
        observations, _, _, _, infos = env.step(actions)
    assert np.abs(errors).max() < 0.2
    assert np.abs(errors).mean() < 0.03


@pytest.mark.soak
def test_a_bar_that_is_not_measured_yet_is_entered_with_less_feed() -> None:
    shop = Family.load("shop")
    env, parameters = FamilyVectorEnv(32, shop), plan(shop, 0, Path("unused"), "a command", SMALL).parameters
    actor = FamilyActor(shop.job(0).scenario, parameters["context"], 8, 8)
    torch.nn.init.zeros_(actor.head.weight)
    observations, _ = env.reset(seed=list(range(32)))
    memory, measured, less = torch.zeros(32, actor.memory_size), np.full(32, np.nan), []
    for step in range(120):
        with torch.no_grad():
            seen, memory = actor.see(doubted(observations), memory)
            actions, memory = actor.respond(seen, memory)
        feed, along = actor._proposals(seen)[:, 1].numpy(), 0.5 * (seen[:, -2].numpy() + 1.0)
        if step > 20:
            less.append((feed - measured)[observations[:, OBS.cutting] < 0.5])
        measured = np.where((along > 0.2) & (along < 0.8), feed, measured)
        observations, *_ = env.step(actions.numpy())
    found = np.concatenate(less)
    assert np.isfinite(found).sum() > 10
    assert np.nanmedian(found) < -0.05


def test_a_corrected_speed_gets_the_feed_that_it_bears() -> None:
    shop = Family.load("shop")
    env, parameters = FamilyVectorEnv(16, shop), plan(shop, 0, Path("unused"), "a command", SMALL).parameters
    actor = FamilyActor(shop.job(0).scenario, parameters["context"], 8, 8)
    torch.nn.init.zeros_(actor.head.weight)
    observations, _ = env.reset(seed=list(range(16)))
    memory = torch.zeros(16, actor.memory_size)
    for _ in range(60):
        seen, memory = actor.see(doubted(observations), memory)
        observations, *_ = env.step(np.tile(np.array([0.0, 0.0, -1.0], np.float32), (16, 1)))
    feeds = []
    with torch.no_grad():
        for correction in (-0.02, 0.0, 0.02):
            actor.head.bias[0] = correction
            feeds.append(actor.bounded(actor._unbounded(torch.zeros(16, 8), seen), seen)[:, 1])
    speed, feed, _, lowest, _, highest, slope, _ = actor._proposals(seen).unbind(dim=-1)
    torch.testing.assert_close(feeds[1], torch.minimum(torch.maximum(feed, lowest), highest))
    free = (speed.abs() < 0.9) & (slope < -0.1) & (feed > lowest + 0.1) & (feed < highest - 0.1)
    assert free.any()
    assert (feeds[0] - feeds[2])[free].min() > 1e-3


@pytest.mark.parametrize("drive", [0, 1])
def test_the_less_doubt_the_less_speed_and_feed_are_corrected(drive: int) -> None:
    shop = Family.load("shop")
    parameters = plan(shop, 0, Path("unused"), "a command", SMALL).parameters
    actor = FamilyActor(shop.job(0).scenario, parameters["context"], 8, 8)
    torch.nn.init.zeros_(actor.head.weight)
    observations, _ = FamilyVectorEnv(4, shop).reset(seed=list(range(4)))
    targets = []
    for correction in (0.0, 0.1):
        torch.nn.init.zeros_(actor.head.bias)
        torch.nn.init.constant_(actor.head.bias[drive], correction)
        for doubt in (1.0, 0.3):
            seen, _ = actor.see(doubted(observations, doubt), torch.zeros(4, actor.memory_size))
            targets.append(actor._unbounded(torch.zeros(4, 8), seen)[:, drive])
    torch.testing.assert_close(targets[2] - targets[0], torch.full((4,), 0.1))
    torch.testing.assert_close(targets[3] - targets[1], torch.full((4,), 0.03))


def test_the_ends_of_a_range_are_proposed_where_they_are_best() -> None:
    shop = Family.load("shop")
    tracker, positions = filter_of(shop), torch.tensor([-1.0, 0.0, 1.0]).double()
    for drive, span in enumerate(tracker._spans):
        proposed = tracker._position(drive, 0.5 * (positions + 1.0) * span)
        torch.testing.assert_close(proposed, positions, rtol=0.0, atol=2e-4)


def test_the_filter_takes_a_context_as_it_is_and_the_network_one_that_training_had() -> None:
    shop = Family.load("shop")
    context = context_of(shop)
    actor, entries = FamilyActor(shop.job(0).scenario, context, 8, 8), len(layout(shop.job(0).scenario))
    place = entries + context["names"].index("log_idle_power")
    observations, _ = FamilyVectorEnv(4, shop).reset(seed=list(range(4)))
    found = []
    for idle in (context["low"][place - entries], -10.0):
        observations[:, place] = idle
        found.append(actor.see(doubted(observations), torch.zeros(4, actor.memory_size))[0])
    least, lower = found
    torch.testing.assert_close(lower[:, : -JobFilter.READINGS], least[:, : -JobFilter.READINGS])
    log_power = -JobFilter.READINGS + 8 + STATES + 5 + 2 + 1
    free = least[:, log_power] > -5.0
    assert free.any()
    assert (lower[free, log_power] < least[free, log_power]).all()


def test_an_edge_that_fails_leaves_the_position_in_doubt_until_air_is_seen() -> None:
    shop = Family.load("shop")
    env, tracker = FamilyVectorEnv(16, shop), filter_of(shop)
    observations, _ = env.reset(seed=list(range(16)))
    state, slack = torch.zeros(16, JobFilter.STATES), PLACE - 1
    for _ in range(30):
        _, state = tracker(doubted(observations), state)
        observations, *_ = env.step(np.tile(np.array([0.0, 0.0, -1.0], np.float32), (16, 1)))
    assert (state[:, slack] == 0.0).all()
    moved = tracker(doubted(observations), state)[1]
    observations[:, OBS.nominal_wear] = 0.0
    failed = tracker(doubted(observations), state)[1]
    cutting = observations[:, OBS.cutting] > 0.5
    travel, short = (each[cutting, 1] - state[cutting, 1] for each in (moved, failed))
    same_bar = travel > 1e-3
    assert same_bar.any()
    torch.testing.assert_close(short[same_bar], 0.5 * travel[same_bar], rtol=1e-3, atol=1e-5)
    torch.testing.assert_close(failed[cutting, slack][same_bar], short[same_bar], rtol=1e-3, atol=1e-5)


def test_idle_power_is_told_apart_from_the_power_of_the_cut() -> None:
    shop = Family.load("shop")
    tracker = filter_of(shop)
    told = told_of(tracker, shop, 48)
    columns = columns_of([shop.job(number).scenario.nominal() for number in range(48)])
    speed, feed = (np.array([getattr(shop.job(n), name) for n in range(48)]) for name in ("cutting_speed", "feed"))
    wear = 0.5**columns.material.wear.time * columns.tool.wear_criterion
    law = columns.material.power
    depth = columns.workpiece.depth_of_cut
    cut = np.exp(law.log_coefficient) * speed**law.cutting_speed * feed**law.feed * depth**law.depth_of_cut * wear**law.wear
    idle = columns.spindle.idle_torque / (30.0 * columns.workpiece.diameter) * speed
    zero = torch.zeros(48).double()
    np.testing.assert_allclose(tracker._idle_share(told, Place(zero, zero, zero, Linear(zero, zero))), idle / cut, rtol=0.02)


@pytest.mark.soak
def test_the_filter_estimates_what_the_compiled_one_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(family_actor, "MISFIT", 0.0)  # which the compiled one does not know
    shop, steps = Family.load("shop"), 300
    # The compiled one has a law of power with idling, and does not follow the depth and hardness that an edge has met.
    other = {"spindle.idle_torque": 0.0, "material.wear.depth_of_cut": 0.0, "material.wear.hardness": 0.0}
    shop = Family.model_validate(shop.model_dump() | {"fields": shop.fields | other})
    jobs = [shop.job(number) for number in range(4)]
    env = FamilyVectorEnv(len(jobs), shop)
    doubt, known, zero = Uncertainty(1.0, 0.4, 0.78), (0.0, 0.0), [0.0] * (ERRORS - 1)
    spreads = [doubt.lot, *known, *(each for law in LAW_ERRORS for each in law)]
    prior = {"error_mean": [-np.log(doubt.lot_life), *zero], "error_factor": np.diag(spreads).tolist()}
    tracker = JobFilter(jobs[0].scenario, context_of(shop) | prior)
    compiled = LoadFilter([job.scenario.nominal() for job in jobs], len(jobs), doubt)
    compiled.reset(np.ones(len(jobs), np.bool_))
    start, scales = compiled.mean.copy(), np.sqrt(np.diagonal(compiled.covariance, axis1=1, axis2=2))
    observations, infos = env.reset(seed=list(range(len(jobs))))
    assert infos["job"].tolist() == [0, 1, 2, 3]
    state, columns = torch.zeros(len(jobs), JobFilter.STATES), columns_of([job.scenario for job in jobs])
    differences = []
    for step in range(steps):
        _, state = tracker(doubted(observations), state)
        compiled.observe(read(observations[:, : len(layout(jobs[0].scenario))], columns))
        mine, its = state[:, PLACE : PLACE + STATES].numpy()[:, SHARED], (compiled.mean - start) / scales
        differences.append(np.abs(mine - its))
        swing = 0.3 * np.sin(0.4 * step)
        actions = np.tile(np.array([swing, -swing, 1.0 if step % 140 == 139 else -1.0], np.float32), (len(jobs), 1))
        observations, *_ = env.step(actions)
    assert np.abs(its).max() > 1.0
    assert np.median(differences) < 0.05
    assert np.mean(differences) < 0.15


@pytest.mark.soak
def test_edges_worn_at_other_speeds_teach_the_exponent_of_speed() -> None:
    shop, count, steps = Family.load("shop"), 48, 80
    env, tracker = FamilyVectorEnv(count, shop), filter_of(shop)
    observations, _ = env.reset(seed=list(range(count)))
    jobs = [shop.job(number).scenario for number in range(count)]
    errors = [job.material.wear.cutting_speed / job.nominal().material.wear.cutting_speed - 1.0 for job in jobs]
    state = torch.zeros(count, JobFilter.STATES)
    for step in range(6 * steps):
        _, state = tracker(doubted(observations), state)
        edge, second = divmod(step, steps)
        faster = (1.0 - 2.0 * (edge % 2)) * (second < 10)
        actions = np.tile(np.array([faster, 0.0, 1.0 if second == steps - 1 else -1.0], np.float32), (count, 1))
        observations, *_ = env.step(actions)
    learnt = state[:, PLACE + TAYLOR].numpy()
    assert np.corrcoef(learnt, errors)[0, 1] > 0.5


def test_an_edge_remembers_the_mean_depth_and_hardness_that_it_has_met() -> None:
    shop = Family.load("shop")
    tracker = filter_of(shop)
    told = told_of(tracker, shop, 8) | {"doubt": torch.ones(8).double()}
    scales, prior = tracker._scales(told), torch.zeros(8, STATES, STATES).double()
    estimate = Estimate(told, scales, torch.zeros(8, STATES).double(), prior.clone())
    by_depth = told["wear_depth_of_cut_exponent"] * scales[:, DEPTH]
    by_hardness = shop.job(0).scenario.material.wear.hardness * scales[:, HARDNESS]
    estimate.excess[:, HISTORY, HISTORY] = -1.0  # nothing met, for certain
    for number, depth in enumerate((1.0, -2.0, 4.0), start=1):  # three bars of equal life
        estimate.mean[:, DEPTH] = depth
        estimate = tracker._worn(estimate, torch.full((8,), 1.0 / number).double())
        fresh = 1.0 - tracker._bar
        estimate = estimate._replace(excess=fresh[:, None] * estimate.excess * fresh)
    torch.testing.assert_close(estimate.mean[:, HISTORY], by_depth)
    torch.testing.assert_close(1.0 + estimate.excess[:, HISTORY, HISTORY], (by_depth.square() + by_hardness.square()) / 3.0)
    torch.testing.assert_close(estimate.excess[:, LAWS:], prior[:, LAWS:])


def test_the_less_doubt_the_less_the_laws_are_learnt() -> None:
    shop = Family.load("shop")
    env, tracker = FamilyVectorEnv(16, shop), filter_of(shop)
    observations, _ = env.reset(seed=list(range(16)))
    learnt = []
    for doubt in (1.0, 0.05):
        state = torch.zeros(16, JobFilter.STATES)
        for _ in range(60):
            _, state = tracker(doubted(observations, doubt), state)
            observations, *_ = env.step(np.tile(np.array([0.0, 0.0, -1.0], np.float32), (16, 1)))
        means, told = state[:, PLACE : PLACE + STATES].double(), {"doubt": torch.full((16,), doubt).double()}
        estimate = Estimate(told, means, means, means)
        errors = tracker._errors(estimate) - tracker._errors(estimate._replace(mean=torch.zeros_like(means)))
        learnt.append(errors[:, LOADS[0] :].abs().mean().item())
    assert learnt[1] < 0.2 * learnt[0]


def state_of(run: Run) -> dict[str, torch.Tensor]:
    return ALGORITHM.actor(run.policy).state_dict()


def test_a_training_killed_and_resumed_gives_the_same_agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    undisturbed, killed = small_run(tmp_path / "undisturbed"), small_run(tmp_path / "killed")
    train(undisturbed)
    rows = undisturbed.learning_curve.read_text().splitlines()
    assert rows[0] == ",".join(family_gradient.CURVE_COLUMNS)
    assert rows[-1].startswith(f"{SMALL['steps']},")

    learn, calls = Training.learn, []

    def learn_twice(self: Training, *arguments: Any) -> float:
        calls.append(self.steps)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return learn(self, *arguments)

    monkeypatch.setattr(family_gradient, "CHECKPOINT_EVERY", 0.0)
    monkeypatch.setattr(Training, "learn", learn_twice)
    with pytest.raises(KeyboardInterrupt):
        train(killed)
    assert killed.checkpoint.exists()
    train(killed)
    assert not killed.checkpoint.exists()
    first, second = state_of(undisturbed), state_of(killed)
    for name, values in first.items():
        assert torch.equal(values, second[name]), name
    assert any(not torch.equal(values, first[name]) for name, values in Training(undisturbed, "cpu").actor.state_dict().items())
    assert train(killed).stat().st_mtime == killed.policy.stat().st_mtime


def test_training_ends_by_the_clock_and_refuses_other_settings_and_seeds(tmp_path: Path) -> None:
    run = small_run(tmp_path, steps=10**9)
    train(run, minutes=1e-6)
    assert len(run.learning_curve.read_text().splitlines()) < 6
    with pytest.raises(ValueError, match="other settings"):
        train(small_run(tmp_path))
    with pytest.raises(ValueError, match=f"must be 0 to {SEEDS - 1}"):
        train(small_run(tmp_path, seed=SEEDS))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fields": FAMILY.fields | {"machine.cutting_speed_max": "2.0 * speed * exp(0.1 * edge_cost)"}}, "must be the same"),
        ({"fields": FAMILY.fields | {"sensors.power_noise": "0.01 * edge_cost"}}, "power_noise is .* must be the same"),
        (
            {"base": "rough_turning", "fields": FAMILY.fields | {"sensors.inspects_edges": False}},
            "must have control.edge_changes",
        ),
    ],
)
def test_jobs_must_be_alike_in_what_the_agent_takes_as_the_same(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    run = plan(Family.load(BRIEF | changes), 0, tmp_path, "a command", SMALL)
    with pytest.raises(ValueError, match=message):
        train(run)


def exported(folder: Path) -> Path:
    """Train and export a family's agent; return its path. The exporter takes the longer, the more of Newton's steps it traces."""
    arguments = [part for name, value in SMALL.items() for part in ("--set", f"{name}={value}")]
    path = folder / "brief.toml"
    path.write_text(tomli_w.dumps(BRIEF))
    assert main(["--family", str(path), "--runs", str(folder), *arguments]) == 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "STEPS", 5)
        patch.setattr(export, "TIMED_CALLS", 3)
        patch.setattr(job_optimum, "_NEWTON_STEPS", 1)
        patch.setattr(newton_search, "STEPS", 1)
        (run,) = folder.rglob("run.json")
        return Path(export.export(run.parent, folder)["path"])


def policy(path: Path, num_envs: int) -> OnnxPolicy:
    file = agent_file.read(path)
    return OnnxPolicy(session_of(file.content), file.memory_size, num_envs)


def baked(agent: Path, scenario: Path | str, out: Path, *options: str) -> Path:
    assert export.main(["--agent", str(agent), "--scenario", str(scenario), "--out", str(out), *options]) == 0
    (path,) = out.glob("*.onnx")
    return path


@pytest.mark.soak
def test_an_agent_with_a_nominal_model_acts_as_if_it_were_told_it(tmp_path: Path) -> None:
    agent = exported(tmp_path)
    file = agent_file.read(agent)
    assert file.metadata.name == "family_gradient"
    job = FAMILY.job(5)
    job.scenario.save(tmp_path / "mine.toml")
    path = baked(agent, tmp_path / "mine.toml", tmp_path / "out")
    assert agent_file.read(path).metadata.scenario.digest() == job.scenario.digest()
    told, mine = policy(agent, 1), policy(path, 1)
    env = FamilyVectorEnv(1, FAMILY)
    observations, _ = env.reset(seed=5)
    for _ in range(20):
        actions = told.act(observations)
        np.testing.assert_allclose(mine.act(observations[:, : len(layout(job.scenario))]), actions, atol=1e-5)
        observations, _, _, _, _ = env.step(actions)


def test_other_ranges_and_steps_are_converted(tmp_path: Path) -> None:
    agent = onnx_agents.write_of_family(tmp_path, FAMILY)
    base = Scenario.load("rough_turning")
    wide = {"machine": base.machine.model_copy(update={"cutting_speed_min": 25.0, "cutting_speed_max": 400.0})}
    fine = {"control": base.control.model_copy(update={"cutting_speed_step": 0.3, "feed_step": 0.8})}
    paths = []
    for name, changes in {"wide": wide, "fine": wide | fine}.items():
        base.model_copy(update={"name": name, **changes}).save(tmp_path / f"{name}.toml")
        paths.append(baked(agent, tmp_path / f"{name}.toml", tmp_path / name))
    observations = np.random.default_rng(0).uniform(-0.5, 0.5, (5, 11)).astype(np.float32)
    usual, finer = (policy(path, 5).act(observations) for path in paths)
    assert usual.shape == (5, 2)
    np.testing.assert_allclose(finer, 0.5 * usual, atol=1e-6)
    see = {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load(paths[0]).graph.initializer}["see_weight"]
    assert see[2, 2] == see[4, 4] == pytest.approx(2.0)  # a ratio of 16 in place of 4
    assert see[3, 3] == 1.0


def test_the_agent_is_told_the_doubt(tmp_path: Path, capsys: Any) -> None:
    agent = onnx_agents.write_of_family(tmp_path, FAMILY)
    told = []
    for options in ([], ["--doubt", "0.3"]):
        model = onnx.load(baked(agent, "rough_turning", tmp_path / f"{len(options)}", *options))
        told.append({each.name: onnx.numpy_helper.to_array(each) for each in model.graph.initializer})
    first, second = (each["see_bias"] for each in told)
    assert first[-1] == 1.0
    assert second[-1] == np.float32(0.3)
    np.testing.assert_array_equal(first[:-1], second[:-1])
    for doubt in ("0.01", "1.5", "nan"):
        assert export.main(["--agent", str(agent), "--scenario", "rough_turning", "--doubt", doubt]) != 0
        assert f"doubt is {float(doubt)}, but must be 0.05 to 1.0" in capsys.readouterr().err


def test_the_agent_is_told_what_no_training_job_had(tmp_path: Path) -> None:
    agent, law = onnx_agents.write_of_family(tmp_path, FAMILY), "power_depth_of_cut_exponent"
    context: Any = agent_file.read(agent).metadata.parameters["context"]
    place = context["names"].index(law)
    assert context["low"][place] == context["high"][place] == 0.0  # all training jobs have the exponent 1
    see = onnx.load(baked(agent, "rough_turning", tmp_path / "out"))
    told = {each.name: onnx.numpy_helper.to_array(each) for each in see.graph.initializer}["see_bias"][:-1]
    value = told[place - len(context["names"])] * context["spread"][place] + context["mean"][place]
    assert value == pytest.approx(Scenario.load("rough_turning").material.power.depth_of_cut)


def edge_cost(scenario: Scenario) -> float:
    return bake._edge_cost(scenario, scenario.model_dump(exclude={"name", "nominal_model"}))


def test_a_job_of_the_family_keeps_its_edges_price() -> None:
    for number in range(3):
        job = Family.load("shop").job(number).scenario.nominal()
        assert edge_cost(job) == pytest.approx(job.economics.edge_cost, rel=1e-6)


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_an_edge_costs_as_much_metal_as_in_the_scenario(factor: float) -> None:
    base = Scenario.load("shift")
    economics = base.economics.model_copy(update={"reference_removal_rate": factor * base.economics.reference_removal_rate})
    scenario = base.model_copy(update={"economics": economics})
    told, change = edge_cost(scenario), economics.edge_change_time
    values = scenario.model_dump(exclude={"name", "nominal_model"})
    values["economics"]["edge_cost"] = told
    best = plan_of(Columns(values), 1)
    speed, feed, life = (float(each[0, MIDDLE]) for each in (best.speed, best.feed, best.life))
    metal = speed * feed * scenario.workpiece.depth_of_cut / economics.reference_removal_rate
    told_metal = 1.0 + (told + change) / life
    assert told / told_metal == pytest.approx(economics.edge_cost / metal, rel=1e-3)


def test_where_the_episode_ends_with_the_edge_its_price_is_what_its_life_earns() -> None:
    shift = Scenario.load("shift")
    ends = shift.model_copy(update={"control": shift.control.model_copy(update={"edge_changes": "end"})})
    dear = ends.model_copy(update={"economics": ends.economics.model_copy(update={"edge_cost": 9.0})})
    assert edge_cost(dear) == pytest.approx(edge_cost(ends), rel=0.05)
    assert edge_cost(ends) < edge_cost(shift)


def test_agents_and_scenarios_that_do_not_fit_are_refused(tmp_path: Path, capsys: Any) -> None:
    agent = onnx_agents.write_of_family(tmp_path, FAMILY)
    for scenario, message in (("override", "control.action"), ("surface", "control.a"), ("batch_casting", "control.action")):
        assert export.main(["--agent", str(agent), "--scenario", scenario, "--out", str(tmp_path)]) != 0
        assert message in capsys.readouterr().err
    path = baked(agent, "shift", tmp_path / "shift")
    assert export.main(["--agent", str(path), "--scenario", "shift", "--out", str(tmp_path)]) != 0
    assert "only agents of RoughTurning-Family-v0" in capsys.readouterr().err
    file = agent_file.read(agent)
    spec = agent_file.trained_policy(file.metadata, 0, file.digest, lambda num_envs: policy(agent, num_envs))
    with pytest.raises(ValueError, match="--agent FILE --scenario shift"):
        agent_file.check_fits(spec, Scenario.load("shift"))
