"""Run a study: variants of a training or a controller on one task, compared seed by seed.

    python -m research.studies ablation
    python -m research.studies equal_terms --variants ppo ppo-position --trainings 3 --jobs 2
    python -m research.studies my_study.toml --steps 300000

A study is a TOML file of this folder, or one of your own. It prints a Markdown table with 95 %
bootstrap intervals over seeds and training seeds. Differences are paired by seed. Costs are all
that the reward charges, per volume of metal.

``RUNS/NAME`` keeps trainings and episodes: the same command continues where it stopped, and one
with more trainings adds to them.
"""

import argparse
import json
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from tqdm import tqdm

from baselines import catalogue
from baselines.comparators import CAUSAL
from baselines.oracles.perfect_state import VERSION
from baselines.oracles.truthful import Truthful
from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import ONNX_SUFFIX, informed
from leaderboard.family import FamilyPlay
from leaderboard.play import Episodes, play, play_family
from leaderboard.seeds import held_out_seeds, tuning_seeds
from leaderboard.statistics import Bootstrap, Estimate, Floats, RankKey, rank_key
from leaderboard.table import markdown
from leaderboard.workers import spread, workers
from train.curves import FILE as CURVES
from train.curves import LearningCurve, Trainings
from train.export import export
from train.run import ALGORITHMS, Run, hyperparameters, trained_on
from train.training import SEEDS, algorithm_of, load_agent, train
from turning_env import FAMILY_ID, IDS, MODEL_VERSION, SPLITS, Family, Scenario
from turning_env.console import UserError, described, exits, positive
from turning_env.files import digest_of, write_file
from turning_env.scenario.scenario import flat

FOLDER = Path(__file__).parent
STUDIES = sorted(path.stem for path in FOLDER.glob("*.toml"))


def with_changes(
    env_id: str, changes: Mapping[str, dict[str, Any]], name: str | None = None
) -> Scenario:
    """Return an id's scenario with other values by section, perhaps under another name."""
    return Scenario.load({"base": IDS[env_id], "name": name or IDS[env_id], **changes})


JOBS = {"training_jobs": "train", "tuning": "validation", "held_out": "unseen_jobs"}
"""Split of a family whose jobs are played, by the study's seeds."""


class Variant(BaseModel):
    """One row of a study: it trains an algorithm, or plays a controller."""

    model_config = ConfigDict(extra="forbid")

    like: str = ""
    """Variant that supplies the fields this one lacks, and with which it is compared."""
    algorithm: str = ""
    policy: str = ""
    settings: dict[str, Any] = {}
    """Hyperparameters of the algorithm, or parameters of the controller."""
    scenario: dict[str, dict[str, Any]] = {}
    """Values of the scenario that differ in training and in play, by section; numbers and switches
    of all jobs, if the task is a family."""
    lathes: int | None = Field(None, ge=1)
    """Number of jobs of the family on which agents are trained; None: the family's."""
    trainings: int = Field(0, ge=0)
    """Number of training seeds; 0: that of the study."""
    family: str | None = None
    """Family of the jobs; None: the id's own."""


class Study(BaseModel):
    """Variants, and the seeds on which they are compared."""

    model_config = ConfigDict(extra="forbid")

    question: str
    task: str
    seeds: Literal["tuning", "held_out", "training_jobs"] = "tuning"
    episodes: int = Field(ge=1, le=100_000)
    trainings: int = Field(1, ge=1, lt=SEEDS)
    settings: dict[str, Any] = {}  # hyperparameters of all trainings
    splits: bool = False  # whether the variants also play the splits
    scenarios: dict[str, dict[str, dict[str, Any]]] = {}
    """Values by section of further scenarios on which controllers are ranked.

    The table then compares these rankings.
    """
    scale: tuple[str, str] | None = None
    """Variants whose mean returns are the scores 0 and 100; None: no scores."""
    overload_prices: tuple[float, ...] = ()
    """Prices of overload at which the same episodes are charged again."""
    variants: dict[str, Variant] = Field(min_length=1)

    @model_validator(mode="after")
    def _has_what_it_names(self) -> Self:
        tasks = (*IDS, FAMILY_ID)
        if self.task not in tasks:
            raise ValueError(f"task is {self.task!r}, but must be one of {', '.join(tasks)}")
        before: list[str] = []
        for name, stated in self.variants.items():
            if stated.like and stated.like not in before:
                raise ValueError(
                    f"variants.{name}.like is {stated.like!r}, but must be a variant before it: "
                    f"{', '.join(before)}"
                )
            before.append(name)
            self._check_variant(name)
        for name in self.scale or ():
            if name not in self.variants:
                raise ValueError(f"scale has {name!r}, but must be of {', '.join(self.variants)}")
        return self

    def _check_variant(self, name: str) -> None:
        variant = self.variant(name)
        if bool(variant.algorithm) == bool(variant.policy):
            raise ValueError(f"variants.{name} needs one of algorithm, policy and like")
        if self.task in IDS:
            with_changes(self.task, variant.scenario)
        if not variant.algorithm:
            if variant.settings and self.task == FAMILY_ID:
                raise ValueError(
                    f"variants.{name}.settings: a controller plays jobs with its own parameters"
                )
            return
        if variant.algorithm not in ALGORITHMS:
            raise ValueError(
                f"variants.{name}.algorithm is {variant.algorithm!r}, but must be one of "
                f"{', '.join(ALGORITHMS)}"
            )
        known = hyperparameters(variant.algorithm, self.task)
        for key in self.settings | variant.settings:
            if key not in known:
                raise ValueError(
                    f"variants.{name}.settings has {key!r}, but must be of {', '.join(known)}"
                )

    @classmethod
    def read(cls, name: str) -> Self:
        """Return the study of a name or of a TOML file.

        Raises:
            UserError: there is no such study, or it cannot be read.
        """
        path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
        if not path.is_file():
            raise UserError(
                f"NAME is {name!r}, but must be one of {', '.join(STUDIES)}, or a TOML file"
            )
        try:
            return cls.model_validate(tomllib.loads(path.read_text("utf-8")))
        except ValidationError as error:
            first = error.errors()[0]
            place = " ".join(str(part) for part in first["loc"])
            message = " ".join(first["msg"].split())
            raise UserError(f"{path}: {place} {message}".replace(":  ", ": ")) from error
        except ValueError as error:
            raise UserError(f"{path}: {error}") from error

    def variant(self, name: str) -> Variant:
        """Return a variant with the fields of the one that it is like."""
        stated = self.variants[name]
        if not stated.like:
            return stated
        values = self.variant(stated.like).model_dump()
        settings = values["settings"] | stated.settings
        values |= stated.model_dump(exclude_unset=True)
        values["settings"] = settings
        return Variant.model_validate(values)

    def count(self, name: str) -> int:
        """Return the number of trainings of a variant."""
        variant = self.variant(name)
        return (variant.trainings or self.trainings) if variant.algorithm else 1

    def with_options(
        self, task: str | None, trainings: int | None, steps: int | None, episodes: int | None
    ) -> "Study":
        """Return the study with the given task and numbers in place of its own."""
        values = self.model_dump(exclude_unset=True)
        given = {"task": task, "trainings": trainings, "episodes": episodes}
        values |= {name: value for name, value in given.items() if value is not None}
        for variant in values["variants"].values():
            if trainings is not None:
                variant.pop("trainings", None)
            if steps is not None:
                variant.get("settings", {}).pop("total_timesteps", None)
        if steps is not None:
            values["settings"] = self.settings | {"total_timesteps": steps}
        return Study.model_validate(values)


class VariantEpisodes(NamedTuple):
    """Episodes of a variant by scenario, the task's own first, and the duration of its training."""

    episodes: dict[str, Episodes]
    seconds: float | None  # wall time [s]; None without a training


def home_of(study: Study, variant: Variant) -> Scenario | Family:
    """Return the family of a study, or its scenario with a variant's changes."""
    home = trained_on(study.task, variant.family)
    if not isinstance(home, Family):
        return with_changes(study.task, variant.scenario)
    changes: dict[str, Any] = {}
    if variant.scenario:
        changes["fields"] = home.fields | flat(variant.scenario)
    if variant.lathes is not None:
        changes["jobs"] = variant.lathes
    if not changes:
        return home
    return Family.model_validate(home.model_dump(exclude_none=True) | changes)


def run_of(study: Study, name: str, seed: int, runs: Path) -> Run:
    """Return the training of a variant with a training seed.

    The recorded command repeats it on the id's own scenario.
    """
    variant = study.variant(name)
    settings = study.settings | variant.settings
    words = [f"python -m train.{variant.algorithm} --env {study.task}"]
    if variant.family:
        words.append(f"--scenario {variant.family}")
    words.append(f"--seed {seed}")
    for key, value in settings.items():
        setting = f"{key}={json.dumps(value)}"
        words.append(f"--set {shlex.quote(setting)}")
    return Run.plan(
        variant.algorithm,
        study.task,
        home_of(study, variant),
        seed,
        runs / name,
        " ".join(words),
        settings,
    )


def publish(trained: Sequence[tuple[str, Run]], folder: Path) -> None:
    """Add agents, named after their variants, and their learning curves to a folder."""
    curves_path = folder / CURVES
    curves: dict[str, LearningCurve] = {}
    if curves_path.exists():
        curves |= Trainings.read(curves_path).trainings
    for name, run in trained:
        agent_name = f"{name}-seed{run.seed}"
        agent_path = folder / f"{agent_name}{ONNX_SUFFIX}"
        if not agent_path.exists():
            export(run.folder, folder, name)
        if run.read_learning_curve():  # an untrained agent has none
            curves[agent_name] = LearningCurve.of(run)
    if trained:
        _, first_run = trained[0]
        trainings = Trainings(
            env_id=first_run.env_id,
            scenario=first_run.task,
            trainings=curves,
        )
        trainings.write(curves_path)


def played(piece: tuple[str, int], study: Study, runs: Path) -> VariantEpisodes:
    """Train a variant with a training seed and play it, unless that is done.

    Args:
        piece: the variant's name and the training seed.
        study: the study.
        runs: folder of trainings and episodes.

    Raises:
        ValueError: a training's folder holds a training with other settings, or there is no such
            policy or file.
    """
    name, seed = piece
    variant = study.variant(name)
    identity: list[Any] = [
        study.task,
        study.seeds,
        study.episodes,
        MODEL_VERSION,
        seed,
        variant.model_dump(mode="json"),
    ]
    run = None
    if variant.algorithm:
        run = run_of(study, name, seed, runs)
        identity.append(run.parameters)
    home = home_of(study, variant)
    if isinstance(home, Family):
        jobs_episodes = _played_on_family(study, variant, home, run, identity, runs)
        return VariantEpisodes({study.task: jobs_episodes}, _seconds(run))
    scenarios = [home]
    if study.splits:
        scenarios += [Scenario.load(split) for split in SPLITS]
    for title, changes in study.scenarios.items():
        scenarios.append(with_changes(study.task, changes, title))
    seeds_of = tuning_seeds if study.seeds == "tuning" else held_out_seeds
    seeds = seeds_of(study.episodes)
    episodes = {}
    for scenario in scenarios:
        if run is not None:
            work = partial(_play_agent, run, scenario, seeds)
        else:
            controller = _controller(variant, scenario, Scenario.load(IDS[study.task]))
            identity.append(controller.identity)
            work = partial(play, informed(controller, scenario), scenario, seeds)
        episodes[scenario.name] = kept_episodes(runs, [*identity, scenario.digest()], work)
    return VariantEpisodes(episodes, _seconds(run))


def _trained(run: Run) -> PolicySpec:
    """Return the agent of a training, which is run or resumed unless it is finished."""
    return load_agent(train(run, algorithm_of(run.algorithm)).parent)


def _seconds(run: Run | None) -> float | None:
    """Return the wall time of a training [s]; None if there is none."""
    if run is None:
        return None
    return max((row["wall_time"] for row in run.read_learning_curve()), default=0.0)


def _play_agent(run: Run, scenario: Scenario, seeds: Sequence[int]) -> Episodes:
    """Train an agent and play it on a scenario."""
    return play(informed(_trained(run), scenario), scenario, seeds)


def _play_agent_on_family(run: Run, family: Family, split: str, jobs: Sequence[int]) -> Episodes:
    """Train an agent and play it on the jobs of a family."""
    make = informed(_trained(run), [family.job(number, split).scenario for number in jobs])
    return play_family(family, split, jobs, make)


def _played_on_family(
    study: Study,
    variant: Variant,
    family: Family,
    run: Run | None,
    identity: list[Any],
    runs: Path,
) -> Episodes:
    """Return the episodes of a variant on a family's jobs; ``run``: None for a controller."""
    jobs = range(study.episodes)
    split = JOBS[study.seeds]
    identity = [*identity, family.digest()]
    if run is not None:
        work = partial(_play_agent_on_family, run, family, split, jobs)
        return kept_episodes(runs, identity, work)
    rule = catalogue.RULES.get(variant.policy)
    identity.append(rule.version if rule else VERSION)
    # The causal oracle receives all true values.
    known_family = Truthful.of(family) if variant.policy == CAUSAL else family
    plays = FamilyPlay(known_family, split, variant.policy, forgets=False)
    work = partial(plays, family.job(0).scenario, jobs, lambda ended: None)
    return kept_episodes(runs, identity, work)


def _controller(variant: Variant, scenario: Scenario, home: Scenario) -> PolicySpec:
    """Return the variant's controller, tuned for ``home`` unless its settings say otherwise."""
    nominal = scenario.nominal()
    tuned = catalogue.spec(variant.policy, scenario, home)
    rule = catalogue.playable(variant.policy, nominal)
    parameters: dict[str, Any] = tuned.parameters | variant.settings
    make = partial(rule.controller, nominal, **parameters)
    return tuned.model_copy(update={"parameters": parameters, "make": make})


def kept_episodes(runs: Path, identity: list[Any], work: Callable[[], Episodes]) -> Episodes:
    """Return the episodes kept under an identity, or do the work and keep it."""
    path = runs / "episodes" / f"{digest_of(identity)}.json"
    if not path.exists():
        lists = {}
        for field, values in work().items():
            lists[field] = values.tolist()
        content = json.dumps(lists)
        write_file(path, content)
    kept = json.loads(path.read_text("utf-8"))
    return {field: np.array(values) for field, values in kept.items()}


class VariantRow:
    """A variant in the table.

    Args:
        name: its name.
        trained: episodes of each training seed.
        bootstrap: the resamples of all variants.
    """

    def __init__(self, name: str, trained: Sequence[VariantEpisodes], bootstrap: Bootstrap) -> None:
        self.name = name
        self._bootstrap = bootstrap
        # Arrays of shape (training seeds, seeds), by scenario and field.
        self.scenarios: dict[str, Episodes] = {}
        for scenario, fields in trained[0].episodes.items():
            stacked = {}
            for field in fields:
                by_training = [played.episodes[scenario][field] for played in trained]
                stacked[field] = np.stack(by_training)
            self.scenarios[scenario] = stacked
        self.home = next(iter(self.scenarios))
        self._seconds = []
        for played in trained:
            if played.seconds is not None:
                self._seconds.append(played.seconds)

    def cells(self, other: "VariantRow | None", prices: Sequence[float] = ()) -> dict[str, str]:
        """Return the texts by heading.

        Args:
            other: row with which this one is compared; None: no comparison.
            prices: further prices of overload at which the returns are computed.
        """
        episodes = self.scenarios[self.home]
        returns = episodes["return"]
        replicates = self._bootstrap.means(returns, self.name)
        mean_return = Estimate.of(returns.mean(), replicates)
        cells = {
            "Variant": f"`{self.name}`",
            "Return [s]": _text(mean_return),
        }
        if other is not None:
            cells |= self._compared_with(other, replicates)
        if len(returns) > 1:
            by_training = returns.mean(axis=1)
            worst = by_training.min()
            best = by_training.max()
            cells["Worst to best training [s]"] = f"{worst:.0f} to {best:.0f}"
        for price in prices:
            free_of_overload = returns - episodes["reward_overload"]
            charged = free_of_overload - price * episodes["excess"]
            cells[f"At price {price:g} [s]"] = f"{charged.mean():.0f}"
        cells |= self._totals()
        for scenario, played in self.scenarios.items():
            if scenario != self.home:
                mean = played["return"].mean()
                verdict = self._verdict(scenario)
                cells[f"`{scenario}` [s]"] = f"{mean:.0f}{verdict}"
        if self._seconds:
            seconds = np.mean(self._seconds)
            cells["Training [s]"] = f"{seconds:.0f}"
        return cells

    def score(self, fixed: "VariantRow", oracle: "VariantRow") -> str:
        """Return the score on a scale of 0 for the mean return of one row and 100 for another's."""
        means = {}
        replicates = {}
        for row in (self, fixed, oracle):
            returns = row.scenarios[row.home]["return"]
            means[row.name] = returns.mean()
            replicates[row.name] = self._bootstrap.means(returns, row.name)
        lead = means[self.name] - means[fixed.name]
        leads = replicates[self.name] - replicates[fixed.name]
        gap = means[oracle.name] - means[fixed.name]
        gaps = replicates[oracle.name] - replicates[fixed.name]

        share = 100.0 * lead / gap
        shares = 100.0 * leads / gaps
        return _text(Estimate.of(share, shares))

    def _compared_with(self, other: "VariantRow", means: Floats) -> dict[str, str]:
        """Return the cells of the differences from another row, paired by seed.

        ``means``: bootstrap replicates of this row's mean return.
        """
        returns = self.scenarios[self.home]["return"]
        other_returns = other.scenarios[other.home]["return"]
        leads = returns.mean(axis=0) - other_returns.mean(axis=0)
        replicates = means - self._bootstrap.means(other_returns, other.name)
        difference = Estimate.of(leads.mean(), replicates)
        better = 100.0 * (leads > 0.0).mean()
        return {
            "Compared with": f"`{other.name}`",
            "Difference [s]": _text(difference),
            "Median [s]": f"{np.median(leads):.1f}",
            "Better [% of seeds]": f"{better:.0f}",
        }

    def _totals(self) -> dict[str, str]:
        """Return the cells of cost, overload and edges, over all episodes."""
        total = {}
        for field, values in self.scenarios[self.home].items():
            total[field] = float(values.sum())

        cells = {}
        volume = total["removed"] / 1000.0  # [dm3]
        if volume > 0.0:
            cost = total["reward_metal"] - total["return"]
            without_overload = cost + total["reward_overload"]
            cost_per_volume = cost / 60.0 / volume
            lower_cost_per_volume = without_overload / 60.0 / volume
            cells["Full cost [min/dm3]"] = f"{cost_per_volume:.2f}"
            cells["Cost without overload [min/dm3]"] = f"{lower_cost_per_volume:.2f}"

        engaged = max(total["engaged_time"], 1e-9)
        edges = max(total["edges_used"], 1e-9)
        over = 100.0 * total["overload_time"] / engaged
        severe = 100.0 * total["severe_overload_time"] / engaged
        broken = 100.0 * total["edges_broken"] / edges
        verdict = self._verdict(self.home)
        cells["Over a limit [% of cutting time]"] = f"{over:.1f}"
        cells["By > 5 % [%]"] = f"{severe:.2f}{verdict}"
        cells["Edges broken per 100"] = f"{broken:.1f}"
        return cells

    def _verdict(self, scenario: str) -> str:
        """Return a remark if the variant is not feasible on a scenario."""
        # Jobs of the family have limits of their own.
        if scenario == FAMILY_ID or self._is_feasible(scenario):
            return ""
        return ", infeasible"

    def _is_feasible(self, scenario: str) -> bool:
        episodes = self.scenarios[scenario]
        limit = self._bootstrap.severe_limit(
            episodes["severe_overload_time"], episodes["engaged_time"], self.name
        )
        return limit <= Scenario().limits.overload_allowance

    def rank_key(self, scenario: str) -> RankKey:
        """Return the key of a controller's rank on a split: feasibility, then full cost."""
        episodes = self.scenarios[scenario]
        charges = episodes["reward_metal"] - episodes["return"]
        removed = max(episodes["removed"].sum(), 1e-9)
        cost = charges.sum() / removed
        return rank_key("rule", self._is_feasible(scenario), -cost)


def _text(estimate: Estimate) -> str:
    return f"{estimate.value:.1f} ({estimate.low:.1f} to {estimate.high:.1f})"


def variants_table(study: Study, variants: Mapping[str, Sequence[VariantEpisodes]]) -> str:
    """Return a Markdown table of variants, each with the episodes of its training seeds."""
    bootstrap = Bootstrap(study.episodes)
    rows = {}
    for name, trained in variants.items():
        rows[name] = VariantRow(name, trained, bootstrap)
    if study.scenarios:
        return markdown(list(rankings(list(rows.values()))))

    # A variant is compared with the one that its study names, or with the first.
    first = next(iter(rows.values()))
    fixed = None
    oracle = None
    if study.scale:
        fixed = rows.get(study.scale[0])
        oracle = rows.get(study.scale[1])
    cells = []
    for name, row in rows.items():
        other = rows.get(study.variants[name].like, first)
        compared = None if other is row else other
        row_cells = row.cells(compared, study.overload_prices)
        if fixed is not None and oracle is not None:
            row_cells["Score"] = row.score(fixed, oracle)
        cells.append(row_cells)
    return markdown(cells)


def rankings(rows: Sequence[VariantRow]) -> Iterator[dict[str, str]]:
    """Yield the cells of each scenario: how its ranking differs from that of the first."""
    first = rows[0]
    home_keys = {row.name: row.rank_key(first.home) for row in rows}
    home_order = sorted(home_keys, key=home_keys.__getitem__)
    for scenario in first.scenarios:
        keys = {row.name: row.rank_key(scenario) for row in rows}
        order = sorted(keys, key=keys.__getitem__)
        swapped = []
        for better, worse in combinations(order, 2):
            if home_order.index(better) > home_order.index(worse):
                swapped.append(f"`{better}` before `{worse}`")
        infeasible = []
        for name in order:
            was_feasible = not home_keys[name].is_not_feasible
            if was_feasible and keys[name].is_not_feasible:
                infeasible.append(f"`{name}`")

        # Kendall's tau: 1 - 2 * (pairs that change order) / (all pairs).
        count = len(order)
        pairs = max(count * (count - 1), 1) / 2
        tau = 1.0 - 2.0 * len(swapped) / pairs
        yield {
            "Scenario": f"`{scenario}`",
            "Kendall's tau": f"{tau:.2f}",
            "First": f"`{order[0]}`",
            "No longer feasible": ", ".join(infeasible),
            "Pairs that change order": ", ".join(swapped),
        }


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Train and play all missing variants and print the table; return the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(prog="python -m research.studies", **described(__doc__))
    parser.add_argument("study", metavar="NAME", help=f"{', '.join(STUDIES)}, or a TOML file")
    parser.add_argument(
        "--task", choices=[*IDS, FAMILY_ID], help="task to compare on (default: as the study says)"
    )
    parser.add_argument(
        "--variants", nargs="+", metavar="NAME", help="variants to compare (default: all)"
    )
    counts = {
        "trainings": "trainings of each variant",
        "steps": "environment steps of a training",
        "episodes": "seeds to play",
    }
    for name, meaning in counts.items():
        parser.add_argument(
            f"--{name}", type=positive, metavar="N", help=f"{meaning} (default: as the study says)"
        )
    parser.add_argument(
        "--agents",
        type=Path,
        metavar="FOLDER",
        help="folder for the trained agents, named after their variants, as ONNX files, and for "
        "their learning curves",
    )
    execution = parser.add_mutually_exclusive_group()
    execution.add_argument(
        "--jobs",
        type=positive,
        default=1,
        metavar="N",
        help="variants at the same time (default: %(default)s)",
    )
    execution.add_argument(
        "--scheduler", metavar="URL", help="work on a Dask cluster, such as tcp://host:8786"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)"
    )
    parsed = parser.parse_args(arguments)
    study = Study.read(parsed.study)
    for name in parsed.variants or ():
        if name not in study.variants:
            parser.error(f"--variants has {name!r}, but must be of {', '.join(study.variants)}")
    study = study.with_options(parsed.task, parsed.trainings, parsed.steps, parsed.episodes)
    names = [name for name in study.variants if not parsed.variants or name in parsed.variants]
    pieces = []
    for name in names:
        for seed in range(study.count(name)):
            pieces.append((name, seed))
    # One training seed after the other, so that an interrupted command leaves whole rows.
    pieces.sort(key=lambda piece: piece[1])
    runs = parsed.runs / Path(parsed.study).stem / (parsed.task or "")
    work = partial(played, study=study, runs=runs)
    done: dict[tuple[str, int], VariantEpisodes] = {}
    with (
        workers(parsed.jobs, parsed.scheduler) as over,
        tqdm(total=len(pieces), unit="play", disable=None) as bar,
    ):
        for piece, outcome in spread(over, work, [(piece, piece) for piece in pieces]):
            done[piece] = outcome
            bar.set_postfix_str(f"{piece[0]}, seed {piece[1]}")
            bar.update()
    if parsed.agents:
        trained = []
        for name, seed in pieces:
            if study.variant(name).algorithm:
                trained.append((name, run_of(study, name, seed, runs)))
        publish(trained, parsed.agents)
    variants = {}
    for name in names:
        variants[name] = [done[name, seed] for seed in range(study.count(name))]
    print(variants_table(study, variants))
    return 0
