"""Families of scenarios: distributions from which jobs are drawn.

A job is a true scenario and the nominal model of its control. A family is a TOML file. Its
``variables`` and the columns of its ``tables`` are drawn. Its ``fields`` are formulas of them, for
the scenario's fields that are not those of its ``base``; ``planned`` fields also know the nominal
model's best set point (``plan.py``), and ``hidden`` fields are the truth's alone. A variable with
a ``truth`` has a true value, too, and the fields that depend on it differ between truth and
nominal model. ``docs/family.md`` describes the families that ship.

A job depends on family, split and number alone. Its numbers are keyed by the name of their
variable (``numerics.keyed_random``), so a variable that is added changes no other. A job that
makes no sense (``makes_sense``) is drawn again.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple, Self
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, PositiveFloat, ValidationError, model_validator

from turning_env.files import digest_of
from turning_env.numerics.functions import exp, log, sine_and_cosine
from turning_env.numerics.keyed_random import JOB_CHANNEL, philox_4x32
from turning_env.scenario.formula import evaluate
from turning_env.scenario.plan import (
    MIDDLE,
    USED_LIVES,
    Plan,
    SetPointGrid,
    features,
    plan_of,
)
from turning_env.scenario.scenario import (
    Scenario,
    ScenarioError,
    TomlTable,
    always_known,
    complaints_of,
    flat,
    merged,
    nested,
    shipped,
    table_of,
)
from turning_env.scenario.scenario_batch import ScenarioBatch
from turning_env.scenario.section import (
    MAX_LISTED,
    Section,
    declared_ranges,
    few,
    names_instead,
)

Array = NDArray[np.float64]
Values = dict[str, Any]

CHUNK = 256
"""Jobs that are drawn together, as one alone takes almost as long.

The first chunk of the training jobs standardises the context.
"""
MAX_JOBS = 2**32
MAX_RATIO = 1e300
"""Largest ratio of the ends of a logarithmic distribution: ``exp`` and ``log`` are not exact
beyond."""
MAX_LOG_SPREAD = 100.0
"""Largest standard deviation of a logarithm, so that ``exp`` is exact seven of them away."""
CONTEXT_LIMIT = 10.0  # highest absolute value of a number of the context

_FAMILIES = shipped("families")
_SCHEMA = "python -m turning_env show --schema"
_RANGES = declared_ranges(Scenario)
_STRIDE = 2654435769  # odd, so that the episodes of a seed visit every job of a split
_MAX_ATTEMPTS = 200
_MIN_NOMINAL_LIFE = 4.0  # of an edge at the best set point [min]
_MAX_NOMINAL_LIFE = 60.0  # likewise
_MIN_TRUE_LIFE = 2.0  # likewise


class Distribution(Section):
    """A distribution of one of four kinds, given by two numbers."""

    uniform: tuple[float, float] | None = None  # lowest and highest value
    log_uniform: tuple[PositiveFloat, float] | None = None  # likewise
    normal: tuple[float, NonNegativeFloat] | None = None  # mean and standard deviation
    log_normal: tuple[PositiveFloat, NonNegativeFloat] | None = None
    """Median, and standard deviation of the logarithm."""

    @property
    def _kinds(self) -> list[str]:
        """Names of the kinds that are given."""
        return [name for name in Distribution.model_fields if getattr(self, name) is not None]

    @model_validator(mode="after")
    def _check_numbers(self) -> Self:
        kinds = self._kinds
        if len(kinds) != 1:
            allowed = ", ".join(Distribution.model_fields)
            raise ValueError(f"must have one of {allowed}, but has {', '.join(kinds) or 'none'}")
        kind = kinds[0]
        first, second = getattr(self, kind)
        fault = ""
        if kind in ("uniform", "log_uniform") and first > second:
            fault = "the lowest value must not exceed the highest"
        elif kind == "log_uniform" and not second <= MAX_RATIO * first:
            fault = f"the highest value may be {MAX_RATIO:g} times the lowest"
        elif kind == "log_normal" and second > MAX_LOG_SPREAD:
            fault = f"its standard deviation may be at most {MAX_LOG_SPREAD:g}"
        if fault:
            raise ValueError(f"{kind} is [{first}, {second}], but {fault}")
        return self

    def values(self, first_uniform: Array, second_uniform: Array) -> Any:
        """Return values made of two uniform numbers each."""
        kind = self._kinds[0]
        if kind == "uniform":
            low, high = getattr(self, kind)
            return low + first_uniform * (high - low)
        if kind == "log_uniform":
            low, high = getattr(self, kind)
            return low * exp(first_uniform * log(high / low))
        # The Box-Muller transform.
        _, cosine = sine_and_cosine(second_uniform)
        normals = np.sqrt(-2.0 * log(first_uniform)) * cosine
        middle, spread = getattr(self, kind)
        return middle + spread * normals if kind == "normal" else middle * exp(spread * normals)

    def true_values(self, nominal: Array, first_uniform: Array, second_uniform: Array) -> Any:
        """Return true values by nominal ones and two uniform numbers each.

        A ``normal`` or ``uniform`` deviation is added, a logarithmic one is a factor.
        """
        deviation = self.values(first_uniform, second_uniform)
        if self.log_normal or self.log_uniform:
            return nominal * deviation
        return nominal + deviation


class Variable(Distribution):
    """A variable, and the deviation of its true value from the nominal one."""

    unit: str
    source: str
    truth: Distribution | None = None


class Table(Section):
    """Rows of numbers that belong together, such as those of a material.

    One row is drawn, and its columns are variables.
    """

    columns: tuple[str, ...]
    rows: dict[str, tuple[float, ...]]
    held_out: tuple[str, ...] = ()
    """Rows that only some splits draw, and no others."""
    source: str
    truth: dict[str, Distribution] = {}  # noqa: RUF012 - frozen, and copied by Pydantic
    """Deviation of a column's true value from the nominal one."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for name, row in self.rows.items():
            if len(row) != len(self.columns):
                raise ValueError(
                    f"rows.{name} has {len(row)} numbers, but there are {len(self.columns)} columns"
                )
        for name in self.held_out:
            if name not in self.rows:
                advice = names_instead(name, self.rows)
                raise ValueError(f"held_out: there is no row {name!r}; {advice}")
        for name in self.truth:
            if name not in self.columns:
                advice = names_instead(name, self.columns)
                raise ValueError(f"truth: there is no column {name!r}; {advice}")
        if self.rows.keys() <= set(self.held_out):
            raise ValueError("every row is held out, but the training jobs need some")
        return self

    def choices(self, held_out: bool) -> Array:
        """Return the rows of numbers that are held out or those that are not."""
        rows = [row for name, row in self.rows.items() if (name in self.held_out) == held_out]
        return np.array(rows)


def _finite(place: str, values: Any) -> Any:
    """Return values, or raise ValueError if one is no finite number."""
    if not np.all(np.isfinite(values)):
        raise ValueError(
            f"{place}: a value that is drawn is too large: allowed are numbers up to 1.79e308"
        )
    return values


def _in_range(fields: Values, num_jobs: int) -> NDArray[np.bool_]:
    """Return in which jobs all fields are within their ranges, shape (jobs,).

    Raise ValueError if a field that has one value in all jobs is outside.
    """
    inside = np.ones(num_jobs, np.bool_)
    for name, allowed in _RANGES.items():
        if name not in fields:
            continue
        value = fields[name]
        within = np.logical_and(allowed.low <= value, value <= allowed.high)
        if np.ndim(value) == 0 and not within:
            raise ValueError(f"{name}: {value} is outside the allowed range {allowed.text()}")
        inside &= within
    return inside


class Job(NamedTuple):
    """A job: the true scenario, which also holds its nominal model, and the model's plan."""

    scenario: Scenario
    cutting_speed: float  # the nominal model's best cutting speed on a half-worn edge [m/min]
    feed: float  # likewise the feed [mm/rev]
    context: Array
    """Numbers that describe the nominal model, standardised; shape
    (``len(Family.context_names)``,)."""
    numbers: dict[str, float]  # the same numbers by name, not standardised


@dataclass(frozen=True)
class DrawnJobs:
    """Some jobs of a split. Arrays have shape (jobs,)."""

    true: ScenarioBatch
    nominal: ScenarioBatch
    plan: Plan  # of the nominal models
    true_fields: Values  # drawn values of the true scenarios by dotted names
    nominal_fields: Values  # likewise of the nominal models
    features: dict[str, Array]  # context before standardisation
    in_range: NDArray[np.bool_]  # whether all fields are within the ranges that scenarios allow


def makes_sense(true: ScenarioBatch, plan: Plan) -> NDArray[np.bool_]:
    """Return which jobs make sense, shape (jobs,).

    * By the nominal model some set point is within the limits at every wear, and an edge lasts
      4 to 60 min at the best one.
    * In truth some set point exceeds no limit by more than the tolerance, at 95 % of an edge's
      life and on bars two standard deviations deeper and harder.
    * In truth an edge lasts more than 2 min at the nominal model's best set point.
    """
    sensible = np.ones(true.num_scenarios, np.bool_)
    for condition in _conditions(true, plan):
        sensible &= condition.met
    return sensible


class _Condition(NamedTuple):
    """A condition of jobs that make sense."""

    met: NDArray[np.bool_]  # by which jobs, shape (jobs,)
    fault: str  # of jobs that do not meet it
    depends_on: tuple[str, ...]  # sections and fields


_LOADS = ("limits", "machine", "spindle", "workpiece", "material.thrust_force", "material.power")
_LIVES = ("material.wear", "tool.wear_criterion")


def _conditions(true: ScenarioBatch, plan: Plan) -> tuple[_Condition, ...]:
    """Return the conditions of ``makes_sense``."""
    grid = SetPointGrid(true)
    nominal_life = plan.life[:, MIDDLE]
    true_life = 1.0 / grid.life_rate_near(plan.speed[:, MIDDLE], plan.feed[:, MIDDLE])
    excess = grid.excess(USED_LIVES[-1], deviations=2.0)
    return (
        _Condition(
            np.asarray(plan.feasible.all(axis=1)),
            "by the nominal model no cutting speed and feed is within limits.thrust_force and "
            "limits.power",
            _LOADS,
        ),
        _Condition(
            (nominal_life > _MIN_NOMINAL_LIFE) & (nominal_life < _MAX_NOMINAL_LIFE),
            "by the nominal model an edge does not last "
            f"{_MIN_NOMINAL_LIFE:g} to {_MAX_NOMINAL_LIFE:g} min at the best cutting speed and "
            "feed (material.wear, tool.wear_criterion)",
            (*_LIVES, *_LOADS),
        ),
        _Condition(
            true_life > _MIN_TRUE_LIFE,
            f"in truth an edge does not last {_MIN_TRUE_LIFE:g} min at the nominal model's best "
            "cutting speed and feed (material.wear, mismatch.wear_factor)",
            (*_LIVES, "mismatch", *_LOADS),
        ),
        _Condition(
            np.asarray((excess <= true.limits.overload_tolerance).any(axis=(1, 2))),
            "in truth every cutting speed and feed exceeds limits.thrust_force or limits.power "
            "on a worn edge",
            (*_LOADS, "mismatch"),
        ),
    )


class Family(Section):
    """Distributions over jobs; see the module's description."""

    name: str
    base: str = "shift"  # preset with the values of all fields that are not drawn
    jobs: int = Field(default=4096, ge=1, le=MAX_JOBS)  # number of training jobs
    held_out_jobs: int = Field(default=256, ge=1, le=MAX_JOBS)
    """Number of jobs of every other split."""
    held_out_key: str = ""
    """Text that determines the jobs of every other split, with their names and numbers."""
    variables: dict[str, Variable]
    tables: dict[str, Table] = {}  # noqa: RUF012 - frozen, and copied by Pydantic
    derived: dict[str, float | str] = {}  # noqa: RUF012 - likewise
    """Further variables: formulas of nominal values, in order."""
    fields: dict[str, float | bool | str]
    hidden: dict[str, float | str] = {}  # noqa: RUF012 - likewise
    """Fields that the nominal model leaves at the base's values: formulas of true values, for
    forms that its laws do not have."""
    shown: tuple[str, ...] = ()
    """Variables and columns whose nominal values join the context."""
    planned: dict[str, float | bool | str] = {}  # noqa: RUF012 - likewise
    splits: dict[str, tuple[str, ...]] = {"train": ()}  # noqa: RUF012 - likewise
    """Names of splits, and of the tables whose held-out rows each of them draws."""

    @model_validator(mode="after")
    def _splits_fit(self) -> Self:
        if self.splits.get("train") != ():
            raise ValueError('splits must have "train", which draws no held-out rows')
        for split, tables in self.splits.items():
            for name in tables:
                if name not in self.tables or not self.tables[name].held_out:
                    raise ValueError(f"splits.{split}: no table {name!r} has held-out rows")
        return self

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        drawn = [*self.variables]
        for table in self.tables.values():
            drawn += table.columns
        drawn += self.derived
        for name in self.shown:
            if name not in drawn:
                advice = names_instead(name, drawn)
                raise ValueError(f"shown: there is no variable {name!r}; {advice}")
        for formulas in ("fields", "hidden", "planned"):
            for name, value in getattr(self, formulas).items():
                self._check_field(f"{formulas}.{name}", name, value)
        return self

    def _check_field(self, place: str, name: str, value: float | bool | str) -> None:
        """Raise ValueError unless a scenario has the field, and the value may be of its type."""
        if name not in self._base:
            raise ValueError(f"{place}: {self._no_field(name)}")
        usual = self._base[name]
        if not isinstance(usual, bool | int | float):
            raise ValueError(
                f"{place}: only numbers are drawn, but this field has {usual!r}: set it in the base"
            )
        if isinstance(usual, bool) != isinstance(value, bool):
            allowed = "true or false" if isinstance(usual, bool) else "a number or a formula"
            raise ValueError(f"{place}: {value!r} is not allowed: it must be {allowed}")

    def _no_field(self, name: str) -> str:
        """Return what is wrong with the name of a field that no scenario has."""
        section, _, last = name.rpartition(".")
        in_section = []
        for field in self._base:
            if field.startswith(f"{section}."):
                in_section.append(field.removeprefix(f"{section}."))
        if in_section:
            advice = names_instead(last, in_section, lists_all=_SCHEMA)
        else:
            advice = names_instead(name, self._base, lists_all=_SCHEMA)
        return f"a scenario has no field {name!r}; {advice}"

    @classmethod
    def load(cls, source: "str | os.PathLike[str] | Mapping[str, Any] | Family") -> "Family":
        """Return the family of a preset's name, a TOML file's path or a dict.

        A ``Family`` is returned unchanged. ScenarioError names the field and its fault.
        """
        if isinstance(source, Family):
            return source
        if isinstance(source, Mapping):
            return cls._from_values("family", dict(source))
        if source in _FAMILIES:
            return _preset(str(source))
        table = _table_of(source)
        return cls._from_values(table.title, table.values)

    @classmethod
    def _from_values(cls, title: str, values: Values) -> "Family":
        """Return the family of a table, which errors call by its title."""
        try:
            if "extends" in values:
                values = _extended(values)
            family = cls.model_validate(values)
            # Formulas that have no value, and jobs that make no sense, are refused here.
            family.job(0)
        except ValueError as error:
            faults = complaints_of(error) if isinstance(error, ValidationError) else [str(error)]
            raise ScenarioError(f"{title}: {few(faults)}") from error
        return family

    def __eq__(self, other: object) -> bool:
        """Return whether all values are equal, whichever jobs have been drawn."""
        return isinstance(other, Family) and self.model_dump() == other.model_dump()

    def __reduce__(self) -> Any:
        """Pickle the family without its jobs."""
        return Family.load, (self.portable(),)

    def __deepcopy__(self, memo: Any = None) -> "Family":
        """Return the family itself, which never changes."""
        return self

    def portable(self) -> str | dict[str, Any]:
        """Return a source for ``load`` that JSON can hold: the name of a preset, or a dict."""
        if self.name in _FAMILIES and self == _preset(self.name):
            return self.name
        return self.model_dump(mode="json", exclude_none=True)

    def digest(self) -> str:
        """Return the SHA-256 of all values."""
        return digest_of(self.model_dump(mode="json"))

    def number(self, seed: int, episode: int, split: str) -> int:
        """Return the number of the job that an episode of a seed plays."""
        num_jobs = self.jobs if split == "train" else self.held_out_jobs
        return (int(seed) + _STRIDE * int(episode)) % num_jobs

    def job(self, seed: int, split: str = "train", episode: int = 0) -> Job:
        """Return the job that an episode of a seed plays; ValueError if there is no such split."""
        number = self.number(seed, episode, split)
        chunk, i = divmod(number, CHUNK)
        jobs = self.draw(split, chunk)
        true = fields_of(jobs.true_fields, i)
        differing = {}
        for name, value in fields_of(jobs.nominal_fields, i).items():
            if value != true[name] and not always_known(name):
                differing[name] = value
        values: Values = {"base": self.base, "name": f"{self.name}-{split}-{number}"}
        values |= nested(true.items())
        values["nominal_model"] = nested(differing.items())
        return Job(
            scenario=Scenario.load(values),
            cutting_speed=float(jobs.plan.speed[i, MIDDLE]),
            feed=float(jobs.plan.feed[i, MIDDLE]),
            context=self.context(jobs.features)[i],
            numbers={name: float(column[i]) for name, column in jobs.features.items()},
        )

    @property
    def context_names(self) -> tuple[str, ...]:
        """Names of the numbers of a job's context."""
        return tuple(self.draw("train", 0).features)

    def context(self, features: Mapping[str, Any]) -> Array:
        """Return the context of each job by its features, shape (jobs, numbers).

        It is standardised by training jobs.
        """
        mean, spread = self.context_scale
        return np.clip((_stacked(features) - mean) / spread, -CONTEXT_LIMIT, CONTEXT_LIMIT)

    @cached_property
    def context_scale(self) -> tuple[Array, Array]:
        """Mean and spread by which the context is standardised, shape (numbers,) each."""
        sample = _stacked(self.draw("train", 0).features)
        spread = sample.std(axis=0)
        # A number that training jobs share is only centred.
        return sample.mean(axis=0), np.where(spread > 1e-6, spread, 1.0)

    @cached_property
    def _deviations(self) -> dict[str, Distribution]:
        """Deviations of true from nominal values, by the names of variables and columns."""
        deviations = {}
        for name, variable in self.variables.items():
            if variable.truth:
                deviations[name] = variable.truth
        for table in self.tables.values():
            deviations |= table.truth
        return deviations

    @cached_property
    def _base(self) -> Values:
        """Values of the base by dotted names."""
        return flat(Scenario.load(self.base).model_dump(exclude={"name", "nominal_model"}))

    @cached_property
    def _chunks(self) -> dict[tuple[str, int], DrawnJobs]:
        """Jobs that have been drawn, by split and chunk."""
        return {}

    def batch_of(self, fields: Values, num_jobs: int) -> ScenarioBatch:
        """Return scenarios that have these fields by dotted names, and the base's others."""
        return ScenarioBatch(self._base | fields, num_jobs)

    def draw(self, split: str, chunk: int) -> DrawnJobs:
        """Return the jobs with the numbers from ``CHUNK * chunk`` on.

        Raise ValueError if there is no such split.
        """
        if split not in self.splits:
            advice = names_instead(split, self.splits)
            raise ValueError(f"there is no split {split!r}; {advice}")
        if (split, chunk) not in self._chunks:
            numbers = np.arange(chunk * CHUNK, (chunk + 1) * CHUNK, dtype=np.uint64)
            self._chunks[split, chunk] = self.draw_numbers(split, numbers)
        return self._chunks[split, chunk]

    @np.errstate(all="ignore")  # numbers that are not finite are refused, or make no sense
    def draw_numbers(self, split: str, numbers: NDArray[np.uint64]) -> DrawnJobs:
        """Return the jobs with these numbers; jobs that make no sense are drawn again.

        Raise ValueError if that happens too often in a row.
        """
        attempts = np.zeros(len(numbers), np.uint64)
        pending = np.arange(len(numbers))
        while pending.size:
            jobs = self._attempt(split, numbers[pending], attempts[pending])
            accepted = jobs.in_range & makes_sense(jobs.true, jobs.plan)
            pending = pending[~accepted]
            attempts[pending] += np.uint64(1)
            if attempts.max() > _MAX_ATTEMPTS:
                raise ValueError(
                    f"{_MAX_ATTEMPTS} jobs in a row make no sense in split {split!r}: "
                    f"{self._reason(jobs)}"
                )
        # All in one, so that arrays have one row for each number, whenever it was accepted.
        return self._attempt(split, numbers, attempts)

    def _reason(self, jobs: DrawnJobs) -> str:
        """Return why some jobs make no sense: fields out of range, or else an unmet condition."""
        outside = []
        for name in jobs.true_fields:
            for drawn in (jobs.nominal_fields, jobs.true_fields):
                is_inside = _in_range({name: drawn[name]}, len(jobs.in_range)).all()
                if not is_inside and name not in outside:
                    outside.append(name)
        if outside:
            ranges = [f"{name} ({_RANGES[name].text()})" for name in outside[:MAX_LISTED]]
            return f"outside their ranges are {', '.join(ranges)}"
        for condition in _conditions(jobs.true, jobs.plan):
            if not condition.met.all():
                return f"{condition.fault}; {self._set_by_family(condition.depends_on)}"
        raise AssertionError("jobs that make sense are accepted")

    def _set_by_family(self, names: tuple[str, ...]) -> str:
        """Return which fields of some sections the family sets itself; the base sets the others."""
        prefixes = tuple(f"{name}." for name in names)
        fields = []
        for name in [*self.fields, *self.hidden, *self.planned]:
            if name in names or name.startswith(prefixes):
                fields.append(name)
        if not fields:
            return f"base {self.base!r} sets {', '.join(names)}"
        return f"the family sets {', '.join(fields[:MAX_LISTED])}"

    def _attempt(
        self, split: str, numbers: NDArray[np.uint64], attempts: NDArray[np.uint64]
    ) -> DrawnJobs:
        """Draw jobs, whether they make sense or not.

        Args:
            split: name of the split.
            numbers: numbers of the jobs, shape (jobs,).
            attempts: how often each job has been drawn before.
        """
        num_jobs = len(numbers)
        uniforms = self._uniforms(split, numbers, attempts)
        nominal_values = self._nominal_values(split, uniforms)
        true_values = self._true_values(nominal_values, uniforms)

        nominal_fields = {}
        for name, formula in self.fields.items():
            nominal_fields[name] = evaluate(f"fields.{name}", formula, nominal_values)
        in_range = _in_range(nominal_fields, num_jobs)
        plan = plan_of(self.batch_of(nominal_fields, num_jobs))
        best = {
            "best_cutting_speed": plan.speed[:, MIDDLE],
            "best_feed": plan.feed[:, MIDDLE],
            "best_life": plan.life[:, MIDDLE],
            "best_removal_rate": plan.removal_rate,
        }
        for name, formula in self.planned.items():
            nominal_fields[name] = evaluate(f"planned.{name}", formula, nominal_values | best)

        true_fields = {}
        for name, value in nominal_fields.items():
            # The control's own settings, and the values that follow from its plan, have no error.
            if always_known(name) or name in self.planned:
                true_fields[name] = value
            else:
                true_fields[name] = evaluate(f"fields.{name}", self.fields[name], true_values)
        for name, formula in self.hidden.items():
            nominal_fields[name] = self._base[name]
            true_fields[name] = evaluate(f"hidden.{name}", formula, true_values | best)

        # The true fields hold the planned ones, too; hidden nominal ones are those of the base.
        in_range &= _in_range(true_fields, num_jobs)
        true = self.batch_of(true_fields, num_jobs)
        nominal = self.batch_of(nominal_fields, num_jobs)
        described = features(nominal, plan)
        described |= {name: nominal_values[name] for name in self.shown}
        if nominal.sensors.observes_all:
            described |= self._true_features(true, true_fields)
        return DrawnJobs(
            true=true,
            nominal=nominal,
            plan=plan,
            true_fields=true_fields,
            nominal_fields=nominal_fields,
            features=described,
            in_range=in_range,
        )

    def _true_features(self, true: ScenarioBatch, true_fields: Values) -> dict[str, Array]:
        """Return numbers that describe true scenarios: their plan, and the forms that are hidden.

        Each has the shape (jobs,). Hidden forms are no power laws, so no plan has them.
        """
        numbers = {}
        for name, value in features(true, plan_of(true)).items():
            numbers[f"true_{name}"] = value
        for name in self.hidden:
            numbers[f"true_{name}"] = np.broadcast_to(true_fields[name], true.num_scenarios)
        return numbers

    def _uniforms(
        self, split: str, numbers: NDArray[np.uint64], attempts: NDArray[np.uint64]
    ) -> dict[str, tuple[Array, Array]]:
        """Return two uniform numbers per job for every variable, table and deviation.

        They are keyed by its name, so that one that is added changes no other.
        """
        names = [*self.variables, *self.tables]
        names += [f"{name}.truth" for name in self._deviations]
        keys = np.array([crc32(name.encode()) for name in names], np.uint64)
        # Training jobs do not depend on the key of the others, which an organiser may change.
        if split == "train":
            split_key = crc32(b"train")
        else:
            # 16 hexadecimal digits are the 64 bits of a key of Philox.
            split_key = int(digest_of([self.held_out_key, split])[:16], 16)
        words = philox_4x32(
            keys[:, np.newaxis], attempts, JOB_CHANNEL, numbers, np.uint64(split_key)
        )
        # Words of 32 bits become numbers above 0 and below 1: their logarithms are finite.
        first = (words[0] + 0.5) * 2.0**-32
        second = (words[1] + 0.5) * 2.0**-32
        return {name: (first[row], second[row]) for row, name in enumerate(names)}

    def _nominal_values(self, split: str, uniforms: Mapping[str, tuple[Array, Array]]) -> Values:
        """Return the nominal values of variables, columns and derived variables."""
        values: Values = {}
        for name, variable in self.variables.items():
            first, second = uniforms[name]
            values[name] = _finite(f"variables.{name}", variable.values(first, second))
        for name, table in self.tables.items():
            choices = table.choices(held_out=name in self.splits[split])
            first, _ = uniforms[name]
            rows = choices[(first * len(choices)).astype(np.int64)]
            values.update(zip(table.columns, rows.T, strict=True))
        for name, formula in self.derived.items():
            values[name] = evaluate(f"derived.{name}", formula, values)
        return values

    def _true_values(
        self, nominal_values: Values, uniforms: Mapping[str, tuple[Array, Array]]
    ) -> Values:
        """Return the true values of all variables, which differ where there is a deviation."""
        values = dict(nominal_values)
        for name, deviation in self._deviations.items():
            first, second = uniforms[f"{name}.truth"]
            true = deviation.true_values(nominal_values[name], first, second)
            values[name] = _finite(f"{name}.truth", true)
        return values


def fields_of(fields: Values, i: int) -> Values:
    """Return the fields of one of some jobs."""
    values = {}
    for name, value in fields.items():
        values[name] = value[i].item() if isinstance(value, np.ndarray) else value
    return values


def _stacked(numbers: Mapping[str, Any]) -> Array:
    """Return the context before standardisation, shape (jobs, numbers)."""
    return np.stack(np.broadcast_arrays(*numbers.values()), axis=1)


def _extended(values: Values) -> Values:
    """Return the values of the family that ``extends`` names, overwritten by the others."""
    values = dict(values)
    name = str(values.pop("extends"))
    if name not in _FAMILIES:
        advice = names_instead(name, _FAMILIES, lists_all="families()")
        raise ValueError(f"extends is {name!r}; {advice}")
    return dict(merged(_preset(name).model_dump(exclude_none=True), values))


def _table_of(source: Any) -> TomlTable:
    return table_of(source, _FAMILIES, kind="family", lists_all="families()")


def families() -> tuple[str, ...]:
    """Return the names of the families that come with the package."""
    return tuple(_FAMILIES)


@cache
def _preset(name: str) -> Family:
    table = _table_of(name)
    return Family._from_values(table.title, table.values)
