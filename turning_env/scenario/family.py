"""Families of scenarios: distributions from which jobs are drawn, each a true scenario and the nominal model of its control.

A family is a TOML file. Its ``variables`` and the columns of its ``tables`` are drawn. Its ``fields`` are formulas of them, for
the scenario's fields that are not those of its ``base``; ``planned`` fields also know the nominal model's best set point
(``plan.py``), and ``hidden`` fields are the truth's alone. A variable with a ``truth`` has a true value, too, and the fields that
depend on it differ between truth and nominal model. ``docs/family.md`` describes the families that ship.

A job depends on family, split and number alone. Its numbers are keyed by the name of their variable (``numerics.keyed_random``),
so a variable that is added changes no other. A job that makes no sense (``makes_sense``) is drawn again.
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
from turning_env.scenario import Scenario, ScenarioError
from turning_env.scenario.formula import evaluate
from turning_env.scenario.plan import MIDDLE, USED_LIVES, Loads, Plan, features, plan_of, unchecked
from turning_env.scenario.scenario import (
    always_told,
    complaints_of,
    flat,
    merged,
    nested,
    shipped,
    table_of,
)
from turning_env.scenario.section import Section, declared_ranges, names_instead

Array = NDArray[np.float64]
Values = dict[str, Any]

_FAMILIES = shipped("families")
_SCHEMA = "python -m turning_env schema"
_SHIPPED = _FAMILIES, "family", "families()"
_RANGES = declared_ranges(Scenario)
CHUNK = 256
"""Jobs that are drawn together, as one alone takes almost as long. The first of training standardise the context."""
MAX_JOBS = 2**32
MAX_RATIO = (
    1e300  # of the ends of a logarithmic distribution: ``exp`` and ``log`` are not exact beyond
)
MAX_LOG_SPREAD = (
    100.0  # largest standard deviation of a logarithm, so that ``exp`` is exact seven of them away
)
CONTEXT_LIMIT = 10.0  # highest absolute value of a number of the context
_STRIDE = 2654435769  # odd, so that the episodes of a seed visit every job of a split
_MAX_ATTEMPTS = 200


class Distribution(Section):
    """A distribution of one of four kinds, given by two numbers."""

    uniform: tuple[float, float] | None = None  # lowest and highest value
    log_uniform: tuple[PositiveFloat, float] | None = None  # likewise
    normal: tuple[float, NonNegativeFloat] | None = None  # mean and standard deviation
    log_normal: tuple[PositiveFloat, NonNegativeFloat] | None = (
        None  # median, and standard deviation of the logarithm
    )

    @property
    def _given(self) -> list[tuple[str, tuple[float, float]]]:
        return [
            (name, getattr(self, name))
            for name in Distribution.model_fields
            if getattr(self, name) is not None
        ]

    @model_validator(mode="after")
    def _one_that_makes_sense(self) -> Self:
        if len(given := self._given) != 1:
            names = ", ".join(name for name, _ in given) or "none"
            raise ValueError(
                f"must have one of {', '.join(Distribution.model_fields)}, but has {names}"
            )
        ((name, (first, second)),) = given
        if "uniform" in name and first > second:
            raise ValueError(
                f"{name} is [{first}, {second}], but the lowest value must not exceed the highest"
            )
        if name == "log_uniform" and not second <= MAX_RATIO * first:
            raise ValueError(
                f"{name} is [{first}, {second}], but the highest value may be {MAX_RATIO:g} times the lowest"
            )
        if name == "log_normal" and second > MAX_LOG_SPREAD:
            raise ValueError(
                f"{name} is [{first}, {second}], but its standard deviation may be at most {MAX_LOG_SPREAD:g}"
            )
        return self

    def values(self, uniforms: tuple[Array, Array]) -> Any:
        """Return values made of two uniform numbers each."""
        ((name, (low, high)),) = self._given
        if name == "uniform":
            return low + uniforms[0] * (high - low)
        if name == "log_uniform":
            return low * exp(uniforms[0] * log(high / low))
        normals = np.sqrt(-2.0 * log(uniforms[0])) * sine_and_cosine(uniforms[1])[1]  # Box-Muller
        return low + high * normals if name == "normal" else low * exp(high * normals)

    def true_values(self, told: Array, uniforms: tuple[Array, Array]) -> Any:
        """Return true values: a ``normal`` or ``uniform`` deviation is added to nominal ones, a logarithmic one is a factor."""
        deviation = self.values(uniforms)
        return told * deviation if self.log_normal or self.log_uniform else told + deviation


class Variable(Distribution):
    """A variable, and the deviation of its true value from the nominal one."""

    unit: str
    source: str
    truth: Distribution | None = None


class Table(Section):
    """Rows of numbers that belong together, such as those of a material: one row is drawn, and its columns are variables."""

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
        for field, kind, known in (
            ("held_out", "row", self.rows),
            ("truth", "column", self.columns),
        ):
            for name in getattr(self, field):
                if name not in known:
                    raise ValueError(
                        f"{field}: there is no {kind} {name!r}; {names_instead(name, known, 'the table')}"
                    )
        if self.rows.keys() <= set(self.held_out):
            raise ValueError("every row is held out, but the training jobs need some")
        return self


def _finite(place: str, values: Any) -> Any:
    """Return values, or raise ValueError if one is no finite number."""
    if not np.all(np.isfinite(values)):
        raise ValueError(
            f"{place}: a value that is drawn is too large: allowed are numbers up to 1.79e308"
        )
    return values


def _in_range(fields: Values, jobs: int) -> NDArray[np.bool_]:
    """Return in which jobs all fields are within their ranges, shape (jobs,).

    Raise ValueError if a field that has one value in all jobs is outside.
    """
    inside = np.ones(jobs, np.bool_)
    for name, (low, high, unit) in _RANGES.items():
        if name not in fields:
            continue
        value = fields[name]
        within = np.logical_and(low <= value, value <= high)
        if np.ndim(value) == 0 and not within:
            raise ValueError(f"{name}: {value} is outside the allowed range {low} to {high} {unit}")
        inside &= within
    return inside


class Job(NamedTuple):
    """A job: the true scenario, which also holds its nominal model, and the plan of the nominal model."""

    scenario: Scenario
    cutting_speed: float  # the nominal model's best cutting speed on a half-worn edge [m/min]
    feed: float  # likewise the feed [mm/rev]
    context: Array  # context: numbers that describe the nominal model, standardised; shape (``len(Family.context_names)``,)
    numbers: dict[str, float]  # the same numbers by name, not standardised


@dataclass(frozen=True)
class Draw:
    """Some jobs of a split. Arrays have shape (jobs,)."""

    true: Scenario  # the true scenarios, with arrays of numbers (``plan.py``)
    nominal: Scenario  # the nominal models, likewise
    plan: Plan
    fields: tuple[Values, Values]  # nominal and true values by dotted names
    features: dict[str, Array]  # context before standardisation
    in_range: NDArray[np.bool_]  # whether all fields are within the ranges that scenarios allow


def makes_sense(true: Scenario, plan: Plan) -> NDArray[np.bool_]:
    """Return which jobs make sense, shape (jobs,).

    * By the nominal model some set point is within the limits at every wear, and an edge lasts 4 to 60 min at the best one.
    * In truth some set point exceeds no limit by more than the tolerance, at 95 % of an edge's life and on bars two standard
      deviations deeper and harder.
    * In truth an edge lasts more than 2 min at the nominal model's best set point.
    """
    nominal_life, jobs = plan.life[:, MIDDLE], len(plan.life)
    loads = Loads(true, jobs)
    bearable = (loads.excess(USED_LIVES[-1], deviations=2.0) <= true.limits.overload_tolerance).any(
        axis=(1, 2)
    )
    true_life = (
        1.0
        / loads.life_rate[
            np.arange(jobs), *loads.nearest(plan.speed[:, MIDDLE], plan.feed[:, MIDDLE])
        ]
    )
    lasts = (nominal_life > 4.0) & (nominal_life < 60.0) & (true_life > 2.0)
    return np.asarray(plan.feasible.all(axis=1) & lasts & bearable)


class Family(Section):
    """Distributions over jobs; see the module's description."""

    name: str
    base: str = "shift"  # preset with the values of all fields that are not drawn
    jobs: int = Field(default=4096, ge=1, le=MAX_JOBS)  # number of training jobs
    held_out_jobs: int = Field(
        default=256, ge=1, le=MAX_JOBS
    )  # number of jobs of every other split
    held_out_key: str = (
        ""  # text that determines the jobs of every other split, with their names and numbers
    )
    variables: dict[str, Variable]
    tables: dict[str, Table] = {}  # noqa: RUF012
    derived: dict[str, float | str] = {}  # noqa: RUF012
    """Further variables: formulas of nominal values, in order."""
    fields: dict[str, float | bool | str]
    hidden: dict[str, float | str] = {}  # noqa: RUF012
    """Fields that the nominal model leaves at the base's values: formulas of true values, for forms that its laws do not have."""
    shown: tuple[str, ...] = ()
    """Variables and columns whose nominal values join the context."""
    planned: dict[str, float | bool | str] = {}  # noqa: RUF012
    splits: dict[str, tuple[str, ...]] = {"train": ()}  # noqa: RUF012
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
        drawn = [
            *self.variables,
            *(column for table in self.tables.values() for column in table.columns),
            *self.derived,
        ]
        for name in self.shown:
            if name not in drawn:
                raise ValueError(
                    f"shown: there is no variable {name!r}; {names_instead(name, drawn, 'the variables')}"
                )
        for table in ("fields", "hidden", "planned"):
            for name, value in getattr(self, table).items():
                self._check_field(f"{table}.{name}", name, value)
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
        known = [
            field.removeprefix(f"{section}.")
            for field in self._base
            if field.startswith(f"{section}.")
        ]
        instead = (
            names_instead(last, known, _SCHEMA)
            if known
            else names_instead(name, self._base, _SCHEMA)
        )
        return f"a scenario has no field {name!r}; {instead}"

    @classmethod
    def load(cls, source: "str | os.PathLike[str] | Mapping[str, Any] | Family") -> "Family":
        """Return the family of a preset's name, a TOML file's path or a dict; ScenarioError names the field and its fault."""
        if isinstance(source, Family):
            return source
        if isinstance(source, Mapping):
            return cls._from_values("family", dict(source))
        return (
            _preset(str(source))
            if source in _FAMILIES
            else cls._from_values(*table_of(source, *_SHIPPED))
        )

    @classmethod
    def _from_values(cls, source: str, values: Values) -> "Family":
        try:
            if "extends" in values:  # on top of the values of another family that ships
                other = str(values.pop("extends"))
                if other not in _FAMILIES:
                    raise ValueError(
                        f"extends is {other!r}; {names_instead(other, _FAMILIES, 'families()')}"
                    )
                values = merged(_preset(other).model_dump(exclude_none=True), values)
            family = cls.model_validate(values)
            family.job(0)
        except ValueError as error:
            faults = complaints_of(error) if isinstance(error, ValidationError) else [str(error)]
            raise ScenarioError(f"{source}: " + "; ".join(faults)) from error
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
        """Return the SHA-256 of all values; a field that was added later counts if it is used."""
        values = self.model_dump(mode="json")
        return digest_of(
            {
                name: value
                for name, value in values.items()
                if value or name not in ("hidden", "shown")
            }
        )

    def number(self, seed: int, episode: int, split: str) -> int:
        """Return the number of the job that an episode of a seed plays."""
        return (int(seed) + _STRIDE * int(episode)) % (
            self.jobs if split == "train" else self.held_out_jobs
        )

    def job(self, seed: int, split: str = "train", episode: int = 0) -> Job:
        """Return the job that an episode of a seed plays; ValueError if there is no such split."""
        number = self.number(seed, episode, split)
        draw, i = self.draw(split, number // CHUNK), number % CHUNK
        nominal, true = (
            {
                name: value[i].item() if isinstance(value, np.ndarray) else value
                for name, value in fields.items()
            }
            for fields in draw.fields
        )
        differing = {
            name: value
            for name, value in nominal.items()
            if value != true[name] and not always_told(name)
        }
        name = "-".join((self.name, split, str(number)))
        values = (
            {"base": self.base, "name": name}
            | nested(true.items())
            | {"nominal_model": nested(differing.items())}
        )
        speed, feed = draw.plan.speed[i, MIDDLE], draw.plan.feed[i, MIDDLE]
        numbers = {name: float(values[i]) for name, values in draw.features.items()}
        return Job(
            scenario=Scenario.load(values),
            cutting_speed=float(speed),
            feed=float(feed),
            context=self.context(draw.features)[i],
            numbers=numbers,
        )

    @property
    def context_names(self) -> tuple[str, ...]:
        """Names of the numbers of a job's context."""
        return tuple(self.draw("train", 0).features)

    def context(self, features: Mapping[str, Any]) -> Array:
        """Return the context of each job by its features, standardised by training jobs: shape (jobs, numbers)."""
        mean, spread = self.context_scale
        return np.clip((_stacked(features) - mean) / spread, -CONTEXT_LIMIT, CONTEXT_LIMIT)

    def context_of(self, scenario: Scenario, shown: Mapping[str, float]) -> Array:
        """Return the context of one's own scenario, shape (numbers,), by its nominal model and values of ``Family.shown``."""
        if shown.keys() != set(self.shown):
            names = ", ".join(self.shown) or "no values"
            raise ValueError(
                f"the context of family {self.name!r} needs {names}, got {dict(shown)}"
            )
        nominal = scenario.nominal()
        return self.context(features(nominal, plan_of(nominal, 1)) | dict(shown)).ravel()

    @cached_property
    def context_scale(self) -> tuple[Array, Array]:
        """Return mean and spread by which the context is standardised, shape (numbers,) each."""
        sample = _stacked(self.draw("train", 0).features)
        spread = sample.std(axis=0)
        return sample.mean(axis=0), np.where(spread > 1e-6, spread, 1.0)

    @cached_property
    def _deviations(self) -> dict[str, Distribution]:
        own = {name: variable.truth for name, variable in self.variables.items() if variable.truth}
        return own | {
            name: truth for table in self.tables.values() for name, truth in table.truth.items()
        }

    @cached_property
    def _base(self) -> Values:
        return flat(Scenario.load(self.base).model_dump(exclude={"name", "nominal_model"}))

    def columns(self, fields: Values) -> Scenario:
        """Return scenarios, with arrays of numbers, that have these fields by dotted names, and the base's others."""
        return unchecked(nested((self._base | fields).items()))

    def draw(self, split: str, chunk: int) -> Draw:
        """Return the jobs with the numbers from ``CHUNK * chunk`` on; ValueError if there is no such split."""
        if split not in self.splits:
            raise ValueError(
                f"there is no split {split!r}; {names_instead(split, self.splits, 'the splits of the family')}"
            )
        known: dict[tuple[str, int], Draw] = vars(self).setdefault("_known", {})
        if (split, chunk) not in known:
            known[split, chunk] = self._drawn(
                split, np.arange(chunk * CHUNK, (chunk + 1) * CHUNK, dtype=np.uint64)
            )
        return known[split, chunk]

    @np.errstate(all="ignore")  # numbers that are not finite are refused, or make no sense
    def _drawn(self, split: str, numbers: NDArray[np.uint64]) -> Draw:
        attempts, pending = np.zeros(len(numbers), np.uint64), np.arange(len(numbers))
        while pending.size:
            draw = self._attempt(split, numbers[pending], attempts[pending])
            pending = pending[~(draw.in_range & makes_sense(draw.true, draw.plan))]
            attempts[pending] += np.uint64(1)
            if attempts.max() > _MAX_ATTEMPTS:
                outside = [
                    name
                    for name in self.fields
                    if not _in_range({name: draw.fields[0][name]}, len(draw.in_range)).all()
                ]
                where = f"; outside their ranges are {', '.join(outside)}" if outside else ""
                raise ValueError(
                    f"{_MAX_ATTEMPTS} jobs in a row make no sense in split {split!r}: check ranges and limits{where}"
                )
        return self._attempt(split, numbers, attempts)

    def _attempt(
        self, split: str, numbers: NDArray[np.uint64], attempts: NDArray[np.uint64]
    ) -> Draw:
        names = [*self.variables, *self.tables, *(f"{name}.truth" for name in self._deviations)]
        keys = np.array([crc32(name.encode()) for name in names], np.uint64)[:, None]
        split_key = (
            crc32(b"train")
            if split == "train"
            else int(digest_of([self.held_out_key, split])[:16], 16)
        )
        words = philox_4x32(keys, attempts, JOB_CHANNEL, numbers, np.uint64(split_key))
        uniforms = dict(
            zip(
                names,
                zip(*((word + 0.5) * 2.0**-32 for word in words[:2]), strict=True),
                strict=True,
            )
        )

        told: Values = {}
        for name, variable in self.variables.items():
            told[name] = _finite(f"variables.{name}", variable.values(uniforms[name]))
        for name, table in self.tables.items():
            held_out = name in self.splits[split]
            choices = np.array(
                [row for each, row in table.rows.items() if (each in table.held_out) == held_out]
            )
            told |= dict(
                zip(
                    table.columns,
                    choices[(uniforms[name][0] * len(choices)).astype(np.int64)].T,
                    strict=True,
                )
            )
        for name, formula in self.derived.items():
            told[name] = evaluate(f"derived.{name}", formula, told)
        true = dict(told)
        for name, truth in self._deviations.items():
            true[name] = _finite(
                f"{name}.truth", truth.true_values(told[name], uniforms[f"{name}.truth"])
            )

        nominal_fields = {
            name: evaluate(f"fields.{name}", formula, told) for name, formula in self.fields.items()
        }
        in_range = _in_range(nominal_fields, len(numbers))
        plan = plan_of(self.columns(nominal_fields), len(numbers))
        planned = {"best_cutting_speed": plan.speed[:, MIDDLE], "best_feed": plan.feed[:, MIDDLE]}
        planned |= {"best_life": plan.life[:, MIDDLE], "best_removal_rate": plan.removal_rate}
        for name, formula in self.planned.items():
            nominal_fields[name] = evaluate(f"planned.{name}", formula, told | planned)
        true_fields = {}
        for name, value in nominal_fields.items():
            same = always_told(name) or name in self.planned
            true_fields[name] = (
                value if same else evaluate(f"fields.{name}", self.fields[name], true)
            )
        nominal_fields |= {name: self._base[name] for name in self.hidden}
        for name, formula in self.hidden.items():
            true_fields[name] = evaluate(f"hidden.{name}", formula, true | planned)
        nominal = self.columns(nominal_fields)
        # The true fields hold the planned ones, too; hidden nominal ones are those of the base.
        in_range &= _in_range(true_fields, len(numbers))
        return Draw(
            true=self.columns(true_fields),
            nominal=nominal,
            plan=plan,
            fields=(nominal_fields, true_fields),
            features=features(nominal, plan) | {name: told[name] for name in self.shown},
            in_range=in_range,
        )


def _stacked(numbers: Mapping[str, Any]) -> Array:
    """Return the context before standardisation, shape (jobs, numbers)."""
    return np.stack(np.broadcast_arrays(*numbers.values()), axis=1)


def families() -> tuple[str, ...]:
    """Return the names of the families that come with the package."""
    return tuple(_FAMILIES)


@cache
def _preset(name: str) -> Family:
    return Family._from_values(*table_of(name, *_SHIPPED))
