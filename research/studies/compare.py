"""Run a study: variants of a training or of a controller, scored on one task and compared seed by seed.

    python -m research.studies ablation
    python -m research.studies equal_terms --variants ppo ppo-position --trainings 3 --jobs 2
    python -m research.studies my_study.toml --steps 300000

A study is a TOML file of this folder, or one of your own. It prints a Markdown table with 95 % bootstrap intervals over seeds and
training seeds. Differences are paired by seed. Costs are all that the reward charges, per volume of metal.

``RUNS/NAME`` keeps trainings and episodes: the same command continues where it stopped, and one with more trainings adds to them.
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
from baselines.oracles.perfect_state import VERSION
from leaderboard.__main__ import positive
from leaderboard.family import CAUSAL, FamilyPlay, Truthful
from leaderboard.table import markdown
from train.agents.agent_file import ONNX_SUFFIX, informed
from train.curves import FILE as CURVES
from train.curves import Training, Trainings
from train.export import export
from train.run import HYPERPARAMETERS, Run, hyperparameters, trained_on
from train.training import SEEDS, algorithm_of, load_agent, train
from turning_env import FAMILY_ID, IDS, MODEL_VERSION, SPLITS, Family, Scenario
from turning_env.console import UserError, described, exits
from turning_env.files import digest_of, replace_file
from turning_env.scoring.play import Episodes, play, play_family
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.seeds import held_out_seeds, tuning_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate, RankKey, rank_key
from turning_env.scoring.workers import spread, workers

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

    like: str = ""  # variant that supplies the fields this one lacks, and with which it is compared instead of the first
    algorithm: str = ""
    policy: str = ""
    settings: dict[
        str, Any
    ] = {}  # hyperparameters of the algorithm, or parameters of the controller
    scenario: dict[
        str, dict[str, Any]
    ] = {}  # values of the scenario that differ in training and in play, by section
    trainings: int = Field(0, ge=0)  # number of training seeds; 0: that of the study
    true_fields: str | tuple[str, ...] | None = None
    """Prefix, or prefixes, of the fields whose true values the controller receives on jobs; None: of none."""
    family: str | None = None  # family of the jobs; None: the id's own
    hidden: tuple[str, ...] | None = (
        None  # prefixes of the family's hidden fields that the jobs have; None: all
    )


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
    """Values by section of further scenarios on which controllers are ranked; the table then compares these rankings."""
    overload_prices: tuple[
        float, ...
    ] = ()  # prices of overload at which the same episodes are charged again
    variants: dict[str, Variant] = Field(min_length=1)

    @model_validator(mode="after")
    def _has_what_it_names(self) -> Self:
        if self.task not in (*IDS, FAMILY_ID):
            raise ValueError(
                f"task is {self.task!r}, but must be one of {', '.join((*IDS, FAMILY_ID))}"
            )
        before: list[str] = []
        for name, own in self.variants.items():
            if own.like and own.like not in before:
                raise ValueError(
                    f"variants.{name}.like is {own.like!r}, but must be a variant before it: {', '.join(before)}"
                )
            before.append(name)
            each = self.variant(name)
            if bool(each.algorithm) == bool(each.policy):
                raise ValueError(f"variants.{name} needs one of algorithm, policy and like")
            if each.algorithm not in ("", *(path.stem for path in HYPERPARAMETERS.glob("*.toml"))):
                raise ValueError(
                    f"variants.{name}.algorithm is {each.algorithm!r}, but must be a name in {HYPERPARAMETERS}"
                )
            if self.task in IDS:
                with_changes(self.task, each.scenario)
            known = hyperparameters(each.algorithm, self.task) if each.algorithm else each.settings
            if unknown := [
                key for key in self.settings | each.settings if key not in known and each.algorithm
            ]:
                raise ValueError(
                    f"variants.{name}.settings has {unknown[0]!r}, but must be of {', '.join(known)}"
                )
        return self

    @classmethod
    def read(cls, name: str) -> Self:
        """Return the study of a name or of a TOML file. Raise UserError if there is no such study, or it cannot be read."""
        path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
        if not path.is_file():
            raise UserError(
                f"NAME is {name!r}, but must be one of {', '.join(STUDIES)}, or a TOML file"
            )
        try:
            return cls.model_validate(tomllib.loads(path.read_text("utf-8")))
        except ValidationError as error:
            first = error.errors()[0]
            raise UserError(
                f"{path}: {' '.join([*map(str, first['loc']), *first['msg'].split()])}"
            ) from error
        except ValueError as error:
            raise UserError(f"{path}: {error}") from error

    def variant(self, name: str) -> Variant:
        """Return a variant with the fields of the one that it is like."""
        own = self.variants[name]
        if not own.like:
            return own
        whole, fields = self.variant(own.like).model_dump(), own.model_dump(exclude_unset=True)
        return Variant.model_validate(
            whole | fields | {"settings": whole["settings"] | own.settings}
        )

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


class Played(NamedTuple):
    """Episodes of a variant by scenario, the task's own first, and the duration of its training."""

    episodes: dict[str, Episodes]
    seconds: float | None  # wall time [s]; None without a training


def home_of(study: Study, variant: Variant) -> Scenario | Family:
    """Return the family of a study, or its scenario with a variant's changes."""
    home = trained_on(study.task, variant.family)
    if not isinstance(home, Family):
        return with_changes(study.task, variant.scenario)
    if variant.hidden is None:
        return home
    hidden = {
        name: formula for name, formula in home.hidden.items() if name.startswith(variant.hidden)
    }
    return Family.model_validate(
        home.model_dump(exclude_none=True) | {"name": f"{home.name}-part", "hidden": hidden}
    )


def run_of(study: Study, name: str, seed: int, runs: Path) -> Run:
    """Return the training of a variant with a training seed, which the recorded command repeats on the id's own scenario."""
    variant = study.variant(name)
    settings = study.settings | variant.settings
    words = [
        f"--set {shlex.quote(f'{key}={json.dumps(value)}')}" for key, value in settings.items()
    ]
    words = [*(["--scenario", variant.family] if variant.family else []), f"--seed {seed}", *words]
    command = " ".join([f"python -m train.{variant.algorithm} --env {study.task}", *words])
    return Run.plan(
        variant.algorithm, study.task, home_of(study, variant), seed, runs / name, command, settings
    )


def publish(trained: Sequence[tuple[str, Run]], folder: Path) -> None:
    """Write agents under the names of their variants as ONNX files, and their learning curves, beside those that are there."""
    curves = Trainings.read(folder / CURVES).trainings if (folder / CURVES).exists() else {}
    for name, run in trained:
        if not (folder / f"{name}-seed{run.seed}{ONNX_SUFFIX}").exists():
            export(run.folder, folder, name)
        if run.read_learning_curve():  # an untrained agent has none
            curves[f"{name}-seed{run.seed}"] = Training.of(run)
    if trained:
        _, run = trained[0]
        Trainings(env_id=run.env_id, scenario=run.task, trainings=curves).write(folder / CURVES)


def played(piece: tuple[str, int], study: Study, runs: Path) -> Played:
    """Train a variant with a training seed and play it, unless that is done.

    Args:
        piece: the variant's name and the training seed.
        study: the study.
        runs: folder of trainings and episodes.

    Raises:
        ValueError: a training's folder holds a training with other settings, or there is no such policy or file.
    """
    name, seed = piece
    variant, seconds = study.variant(name), None
    kept = [
        study.task,
        study.seeds,
        study.episodes,
        MODEL_VERSION,
        seed,
        variant.model_dump(mode="json"),
    ]
    home = home_of(study, variant)
    if variant.algorithm:
        run = run_of(study, name, seed, runs)
        spec = load_agent(train(run, algorithm_of(variant.algorithm)).parent)
        seconds = max((row["wall_time"] for row in run.read_learning_curve()), default=0.0)
        kept.append(run.parameters)
    if isinstance(home, Family):
        jobs, split = range(study.episodes), JOBS[study.seeds]
        kept.append(home.digest())
        if variant.policy:
            rule, first = catalogue.RULES.get(variant.policy), home.job(0).scenario
            kept.append(rule.version if rule else VERSION)
            told = "" if variant.policy == CAUSAL else variant.true_fields
            plays = FamilyPlay(
                home if told is None else Truthful.of(home, told),
                split,
                variant.policy,
                False,
                variant.settings,
            )
            found = partial(plays, first, jobs, lambda ended: None)
        else:
            make = informed(spec, [home.job(number, split).scenario for number in jobs])
            found = partial(play_family, home, split, jobs, make)
        return Played({study.task: _cached(runs, kept, found)}, seconds)
    episodes = {}
    others = [
        with_changes(study.task, changes, title) for title, changes in study.scenarios.items()
    ]
    for scenario in (home, *(map(Scenario.load, SPLITS) if study.splits else ()), *others):
        if variant.policy:
            spec = _controller(variant, scenario, Scenario.load(IDS[study.task]))
            kept.append(spec.identity)
        seeds, make = (
            (tuning_seeds if study.seeds == "tuning" else held_out_seeds)(study.episodes),
            informed(spec, scenario),
        )
        episodes[scenario.name] = _cached(
            runs, [*kept, scenario.digest()], partial(play, make, scenario, seeds)
        )
    return Played(episodes, seconds)


def _controller(variant: Variant, scenario: Scenario, home: Scenario) -> PolicySpec:
    """Return the variant's controller for a scenario, tuned for ``home`` unless its settings say otherwise."""
    nominal, tuned = scenario.nominal(), catalogue.spec(variant.policy, scenario, home)
    rule, parameters = (
        catalogue.playable(variant.policy, nominal),
        tuned.parameters | variant.settings,
    )
    values: Any = parameters
    return tuned.model_copy(
        update={"parameters": parameters, "make": partial(rule.controller, nominal, **values)}
    )


def _cached(runs: Path, identity: list[Any], work: Callable[[], Episodes]) -> Episodes:
    """Return the episodes kept under an identity, or do the work and keep it."""
    path = runs / "episodes" / f"{digest_of(identity)}.json"
    if not path.exists():
        content = json.dumps({field: values.tolist() for field, values in work().items()})
        replace_file(path, lambda partial_path: partial_path.write_text(content, "utf-8"))
    return {
        field: np.array(values) for field, values in json.loads(path.read_text("utf-8")).items()
    }


class Row:
    """A variant in the table.

    Args:
        name: its name.
        trained: episodes of each training seed.
        bootstrap: the resamples of all variants.
    """

    def __init__(self, name: str, trained: Sequence[Played], bootstrap: Bootstrap) -> None:
        self.name, self._bootstrap = name, bootstrap
        self.scenarios = {
            scenario: {
                field: np.stack([each.episodes[scenario][field] for each in trained])
                for field in fields
            }
            for scenario, fields in trained[0].episodes.items()
        }
        self._own = next(iter(self.scenarios.values()))
        self._seconds = [each.seconds for each in trained if each.seconds is not None]

    def cells(self, other: "Row | None", prices: Sequence[float] = ()) -> dict[str, str]:
        """Return the texts by heading, with differences from another row and returns at other prices of overload."""
        own, returns, bootstrap = self._own, self._own["return"], self._bootstrap
        total = {field: float(values.sum()) for field, values in own.items()}
        means = bootstrap.means(returns, self.name)
        cells = {
            "Variant": f"`{self.name}`",
            "Return [s]": _text(Estimate.of(returns.mean(), means)),
        }
        if other is not None:
            others = other._own["return"]
            leads = returns.mean(axis=0) - others.mean(axis=0)
            cells["Compared with"] = f"`{other.name}`"
            cells["Difference [s]"] = _text(
                Estimate.of(leads.mean(), means - bootstrap.means(others, other.name))
            )
            cells["Median [s]"] = f"{np.median(leads):.1f}"
            cells["Better [% of seeds]"] = f"{100.0 * (leads > 0.0).mean():.0f}"
        if len(returns) > 1:
            low, *_, high = np.sort(returns.mean(axis=1))
            cells["Worst to best training [s]"] = f"{low:.0f} to {high:.0f}"
        for price in prices:
            charged = returns - own["reward_overload"] - price * own["excess"]
            cells[f"At price {price:g} [s]"] = f"{charged.mean():.0f}"
        cut, volume = max(total["engaged_time"], 1e-9), total["removed"] / 1000.0
        if volume > 0.0:
            cost = total["reward_metal"] - total["return"]
            cells["Full cost [min/dm3]"] = f"{cost / 60.0 / volume:.2f}"
            cells["Cost without overload [min/dm3]"] = (
                f"{(cost + total['reward_overload']) / 60.0 / volume:.2f}"
            )
        cells["Over a limit [% of cutting time]"] = f"{100.0 * total['overload_time'] / cut:.1f}"
        home, *splits = self.scenarios
        cells["By > 5 % [%]"] = (
            f"{100.0 * total['severe_overload_time'] / cut:.2f}{self._verdict(home)}"
        )
        cells["Edges broken per 100"] = (
            f"{100.0 * total['edges_broken'] / max(total['edges_used'], 1e-9):.1f}"
        )
        for split in splits:
            cells[f"`{split}` [s]"] = (
                f"{self.scenarios[split]['return'].mean():.0f}{self._verdict(split)}"
            )
        if self._seconds:
            cells["Training [s]"] = f"{np.mean(self._seconds):.0f}"
        return cells

    def _verdict(self, scenario: str) -> str:
        """Return a remark if the variant is not feasible on a scenario; jobs of the family have limits of their own."""
        return "" if scenario == FAMILY_ID or self._is_feasible(scenario) else ", infeasible"

    def _is_feasible(self, scenario: str) -> bool:
        episodes = self.scenarios[scenario]
        limit = self._bootstrap.severe_limit(
            episodes["severe_overload_time"], episodes["engaged_time"], self.name
        )
        return limit <= Scenario().limits.overload_allowance

    def rank_key(self, scenario: str) -> RankKey:
        """Return the key by which a leaderboard ranks a controller on a split: by feasibility, then by full cost."""
        episodes = self.scenarios[scenario]
        cost = (episodes["reward_metal"] - episodes["return"]).sum() / max(
            episodes["removed"].sum(), 1e-9
        )
        return rank_key("rule", self._is_feasible(scenario), -cost)


def _text(estimate: Estimate) -> str:
    return f"{estimate.value:.1f} ({estimate.low:.1f} to {estimate.high:.1f})"


def table(study: Study, variants: Mapping[str, Sequence[Played]]) -> str:
    """Return a Markdown table of variants, each with the episodes of its training seeds."""
    bootstrap = Bootstrap(study.episodes)
    rows = {name: Row(name, trained, bootstrap) for name, trained in variants.items()}
    if study.scenarios:
        return markdown([*rankings(list(rows.values()))])
    first, *_ = rows.values()
    found = [row.cells(None if (other := rows.get(study.variants[name].like, first)) is row else other, study.overload_prices)
             for name, row in rows.items()]  # fmt: skip
    return markdown(found)


def rankings(rows: Sequence[Row]) -> Iterator[dict[str, str]]:
    """Yield the cells of each scenario: how its ranking of the variants differs from that of the first."""
    home: dict[str, RankKey] = {}
    for scenario in rows[0].scenarios:
        keys = {row.name: row.rank_key(scenario) for row in rows}
        home = home or keys
        order, known = sorted(keys, key=keys.__getitem__), sorted(home, key=home.__getitem__)
        swapped = [
            pair for pair in combinations(order, 2) if known.index(pair[0]) > known.index(pair[1])
        ]
        yield {
            "Scenario": f"`{scenario}`",
            "Kendall's tau": f"{1.0 - 4.0 * len(swapped) / max(len(order) * (len(order) - 1), 1):.2f}",
            "First": f"`{order[0]}`",
            "No longer feasible": ", ".join(
                f"`{name}`"
                for name in order
                if keys[name].is_not_feasible and not home[name].is_not_feasible
            ),
            "Pairs that change order": ", ".join(
                f"`{better}` before `{worse}`" for better, worse in swapped
            ),
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
    for name, what in counts.items():
        parser.add_argument(
            f"--{name}", type=positive, metavar="N", help=f"{what} (default: as the study says)"
        )
    which = "folder for the trained agents, named after their variants, as ONNX files, and for their learning curves"
    parser.add_argument("--agents", type=Path, metavar="FOLDER", help=which)
    who = parser.add_mutually_exclusive_group()
    who.add_argument(
        "--jobs",
        type=positive,
        default=1,
        metavar="N",
        help="variants at the same time (default: %(default)s)",
    )
    who.add_argument(
        "--scheduler", metavar="URL", help="work on a Dask cluster, such as tcp://host:8786"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)"
    )
    parsed = parser.parse_args(arguments)
    study = Study.read(parsed.study)
    if unknown := [name for name in parsed.variants or () if name not in study.variants]:
        parser.error(f"--variants has {unknown[0]!r}, but must be of {', '.join(study.variants)}")
    study = study.with_options(parsed.task, parsed.trainings, parsed.steps, parsed.episodes)
    names = [name for name in study.variants if not parsed.variants or name in parsed.variants]
    # One training seed after the other, so that an interrupted command leaves whole rows.
    pieces = sorted(
        ((name, seed) for name in names for seed in range(study.count(name))),
        key=lambda piece: piece[1],
    )
    runs = parsed.runs / Path(parsed.study).stem / (parsed.task or "")
    work = partial(played, study=study, runs=runs)
    done: dict[tuple[str, int], Played] = {}
    with (
        workers(parsed.jobs, parsed.scheduler) as over,
        tqdm(total=len(pieces), unit="play", disable=None) as bar,
    ):
        for piece, outcome in spread(over, work, [(piece, piece) for piece in pieces]):
            done[piece] = outcome
            bar.set_postfix_str(f"{piece[0]}, seed {piece[1]}")
            bar.update()
    if parsed.agents:
        publish(
            [
                (name, run_of(study, name, seed, runs))
                for name, seed in pieces
                if study.variant(name).algorithm
            ],
            parsed.agents,
        )
    print(
        table(
            study, {name: [done[name, seed] for seed in range(study.count(name))] for name in names}
        )
    )
    return 0
