"""Families: what is drawn, for whom, and what is refused."""

import hashlib

import numpy as np
import pytest

from turning_env import Family, Scenario, ScenarioError
from turning_env.scenario.family import CHUNK, families, makes_sense
from turning_env.scenario.formula import FormulaError, evaluate
from turning_env.scenario.scenario import flat
from turning_env.scenario.sections import EdgeFailure, Mismatch

SHOP, UNMODELLED = Family.load("shop"), Family.load("unmodelled")
JOBS = {
    "train": "67b14524b7e305a5",
    "validation": "ab00820dc183e917",
    "unseen_jobs": "ad9b5f9382a87067",
    "unseen_materials": "f0d745f1f19b49a6",
    "unseen_machines": "22815411f48502ec",
}
"""Golden digests of all jobs of the family `shop`."""
SMALL = {
    "name": "small",
    "base": "shift",
    "jobs": 8,
    "variables": {
        "factor": {
            "log_uniform": [0.8, 1.2],
            "unit": "-",
            "source": "assumption",
            "truth": {"log_normal": [1.0, 0.1]},
        }
    },
    "fields": {
        "material.power.coefficient": "0.30338170 * factor",
        "workpiece.diameter": "100 * factor",
    },
}


def test_a_job_depends_on_family_split_and_seed_alone():
    again = Family.load(
        SMALL
        | {
            "variables": SMALL["variables"]
            | {"other": {"normal": [0, 1], "unit": "-", "source": "none"}}
        }
    )
    first = Family.load(SMALL)
    assert first.job(5).scenario == first.job(5 + 8).scenario
    assert first.job(5).scenario == again.job(5).scenario
    assert len({first.job(seed).scenario.material.power.coefficient for seed in range(8)}) == 8
    assert {first.number(5, episode, "train") for episode in range(8)} == set(range(8))


def test_the_truth_scatters_about_the_nominal_model_but_not_what_the_control_knows():
    job = Family.load(SMALL).job(3)
    nominal = job.scenario.nominal()
    assert nominal.material.power.coefficient != job.scenario.material.power.coefficient
    assert nominal.workpiece == job.scenario.workpiece
    assert job.scenario.nominal_model == (
        ("material.power.coefficient", nominal.material.power.coefficient),
    )
    assert nominal.nominal() == nominal


def test_held_out_rows_are_drawn_by_their_split_alone():
    rows = {"small": [6.5], "usual": [7.0], "large": [7.5]}
    table = {"columns": ["power"], "rows": rows, "held_out": ["small", "large"], "source": "test"}
    drawn = {
        "tables": {"machine": table},
        "fields": {"limits.power": "power"},
        "splits": {"train": [], "other": ["machine"]},
    }
    family = Family.load(SMALL | drawn)
    for split, expected in (("train", {7.0}), ("other", {6.5, 7.5})):
        assert {family.job(seed, split).scenario.limits.power for seed in range(8)} == expected
    assert SHOP.job(0, "train").scenario != SHOP.job(0, "unseen_jobs").scenario
    with pytest.raises(ValueError, match="did you mean unseen_jobs"):
        SHOP.job(0, "unseen_job")


@pytest.mark.parametrize("split", SHOP.splits)
def test_every_job_makes_sense_and_is_a_scenario(split):
    draw = SHOP.draw(split, 0)
    assert makes_sense(draw.true, draw.plan).all()
    assert np.isfinite(SHOP.context(draw.features)).all()
    job = SHOP.job(17, split)
    assert Scenario.load(job.scenario.portable()) == job.scenario
    assert job.context.shape == (len(SHOP.context_names),)


def digest_of_jobs(split):
    """Return a digest of all jobs of a split: nominal values, true values, and the context."""
    digest = hashlib.sha256()
    for chunk in range(-(-(SHOP.jobs if split == "train" else SHOP.held_out_jobs) // CHUNK)):
        draw = SHOP.draw(split, chunk)
        for name, values in (*draw.nominal_fields.items(), *draw.true_fields.items()):
            digest.update(name.encode() + np.asarray(values, np.float64).tobytes())
        digest.update(SHOP.context(draw.features).tobytes())
    return digest.hexdigest()[:16]


@pytest.mark.slow
@pytest.mark.parametrize("split", SHOP.splits)
def test_jobs_are_as_released_on_every_processor(split):
    assert digest_of_jobs(split) == JOBS[split], "jobs have changed: the family needs a new version"


def test_a_family_is_the_same_from_a_dict_and_a_file(tmp_path):
    assert families() == ("shop", "unmodelled")
    assert Family.load(SHOP.model_dump(mode="json", exclude_none=True)) == SHOP
    path = tmp_path / "mine.toml"
    path.write_text('[variables]\n[fields]\n"limits.power" = 6.5\n')
    assert Family.load(path).job(0).scenario.limits.power == 6.5
    assert Family.load(path).name == "mine"


def test_hidden_forms_are_true_and_the_nominal_model_knows_none_of_them():
    scenario, draw = UNMODELLED.job(3).scenario, UNMODELLED.draw("train", 0)
    nominal, true = scenario.nominal(), flat(scenario.model_dump(exclude={"name", "nominal_model"}))
    assert (nominal.edge_failure, nominal.mismatch, nominal.machine.chatter) == (
        EdgeFailure(),
        Mismatch(),
        0.0,
    )
    for name, formula in UNMODELLED.hidden.items():
        drawn = np.broadcast_to(draw.true_fields[name], CHUNK)
        assert true[name] == drawn[3]
        assert (len(np.unique(drawn)) > 1) == isinstance(formula, str)


def test_a_family_extends_another_and_shows_what_a_catalogue_says(tmp_path):
    assert UNMODELLED.base == SHOP.base
    assert UNMODELLED.fields == SHOP.fields
    assert UNMODELLED.tables["machine"].held_out == SHOP.tables["machine"].held_out
    assert UNMODELLED.context_names == (*SHOP.context_names, *UNMODELLED.shown)
    told = UNMODELLED.draw("train", 0).features["heat"]
    assert set(told.round(6)) <= {row[3] for row in UNMODELLED.tables["material"].rows.values()}
    (tmp_path / "mine.toml").write_text('extends = "shopp"')
    with pytest.raises(ScenarioError, match="did you mean shop"):
        Family.load(tmp_path / "mine.toml")


FORMULAS = {
    "1/0": "needs a divisor other than 0",
    "factor / (factor - factor)": "needs a divisor other than 0",
    "9" * 400: "up to 1.79e308",
    "1e400 - 1e400": "up to 1.79e308",
    "1e308 * 10": "up to 1.79e308",
    "sqrt()": "sqrt has 0 arguments, but needs 1",
    "sqrt(4.0, 1.0)": "sqrt has 2 arguments, but needs 1",
    "minimum(1.0, factor, factor)": "minimum has 3 arguments, but needs 2",
    "exp(x=1)": "a formula has numbers",
    "exp(*factor)": "a formula has numbers",
    "-" * 20_000 + "1": "at most 1000 are allowed",
    "1" + "+1" * 20_000: "at most 1000 are allowed",
    "1" + "+1" * 300: "more than the 100 levels",
    "-" * 300 + "1": "more than the 100 levels",
    "(" * 300 + "1" + ")" * 300: "is not a formula",
    "sqrt(factor - 2)": "needs numbers of 0 or more",
    "exp(1000)": "within -708 to 708",
    "2 ** 5000": "too large or too small",
    "1e-300 ** 2": "too large or too small",
    "True": "a formula has numbers",
    "1j": "a formula has numbers",
    "1or 2": "is not a formula",
    "factor\0": "a formula has numbers",
    "factor[0]": "a formula has numbers",
    "": "is not a formula",
}


@pytest.mark.parametrize(
    "formula", FORMULAS, ids=[formula[:20].replace("\0", "0") for formula in FORMULAS]
)
@pytest.mark.parametrize("table", ["fields", "hidden", "planned"])
def test_a_formula_without_a_value_is_refused_with_its_place(formula, table):
    with pytest.raises(ScenarioError, match=FORMULAS[formula]) as refusal:
        Family.load(SMALL | {table: {"limits.power": formula}})
    assert f"family: {table}.limits.power: {formula[:10]!r}"[:-4] in str(refusal.value)
    assert len(str(refusal.value)) < 300


def test_a_formula_changes_no_variable():
    """A third argument of NumPy's ``minimum`` is where its result goes."""
    factor = np.full(4, 2.0)
    for formula in (
        "minimum(1.0, factor)",
        "-factor",
        "factor * 3",
        "maximum(factor, 5)",
        "exp(factor)",
    ):
        evaluate("fields.limits.power", formula, {"factor": factor})
    assert factor.tolist() == [2.0] * 4
    with pytest.raises(FormulaError):
        evaluate("fields.limits.power", "minimum(1.0, factor, factor)", {"factor": factor})
    assert factor.tolist() == [2.0] * 4


def test_what_is_drawn_is_finite():
    variable = {"unit": "-", "source": "none"}
    for distribution in (
        {"uniform": [-1e308, 1e308]},
        {"normal": [0, 1e308]},
        {"log_uniform": [1e-300, 1e300]},
    ):
        with pytest.raises(ScenarioError, match=r"variables\.factor"):
            Family.load(SMALL | {"variables": {"factor": variable | distribution}})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"jobz": 3}, "did you mean jobs"),
        ({"fields": {"limits.power": "factr * 7"}}, "did you mean factor"),
        ({"fields": {"limits.power": "factor.real"}}, "a formula has numbers"),
        ({"fields": {"limits.power": "7 *"}}, "is not a formula"),
        ({"fields": {"limits.power": "(factor - 1) ** 2"}}, r"\*\* needs numbers above 0"),
        ({"fields": {"limits.power": "log(factor - 2)"}}, "log needs numbers above 0"),
        ({"fields": {"limits.powr": 7.0}}, "did you mean power"),
        ({"variables": {"factor": {"unit": "-", "source": "none"}}}, "must have one of uniform"),
        (
            {"variables": {"factor": {"uniform": [2, 1], "unit": "-", "source": "none"}}},
            "must not exceed the highest",
        ),
        ({"fields": {"limits.power": 0.01}}, "make no sense"),
        ({"splits": {"train": ["material"]}}, "draws no held-out rows"),
    ],
)
def test_errors_name_the_field_and_what_is_allowed(changes, message):
    with pytest.raises(ScenarioError, match=message):
        Family.load(SMALL | changes)
