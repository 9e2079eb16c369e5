"""Families: what is drawn, for whom, and what is refused."""

import hashlib
import math

import numpy as np
import pytest

from turning_env import Family, FamilyVectorEnv, Scenario, ScenarioError
from turning_env.scenario.family import CHUNK, families, makes_sense
from turning_env.scenario.formula import FormulaError, evaluate
from turning_env.scenario.scenario import flat
from turning_env.scenario.sections import EdgeFailure, Mismatch

SHOP = Family.load("shop")
UNMODELLED = Family.load("unmodelled")
JOBS = {
    ("shop", "train"): "1e34709b797f8934",
    ("shop", "validation"): "13c7b89dae4ca033",
    ("shop", "unseen_jobs"): "f43c3044ab010d94",
    ("shop", "unseen_materials"): "4070c766a1ed7545",
    ("shop", "unseen_machines"): "4b6eaa6d651032bc",
    ("unmodelled", "train"): "0d858e8c52bba638",
    ("unmodelled", "validation"): "ca2f80b1315a7f77",
    ("unmodelled", "unseen_jobs"): "c6a99da00f41484a",
    ("unmodelled", "unseen_materials"): "e43a403058a65262",
    ("unmodelled", "unseen_machines"): "72ad5eed108f6abf",
}
"""Golden digests of all jobs of each split of the families that have results."""
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
    family = Family.load(SMALL)
    coefficients = [family.job(seed).scenario.material.power.coefficient for seed in range(8)]
    assert len(set(coefficients)) == 8
    assert family.job(5).scenario == family.job(5 + 8).scenario


def test_a_variable_that_is_added_changes_no_other():
    added = {"other": {"normal": [0, 1], "unit": "-", "source": "none"}}
    family = Family.load(SMALL | {"variables": SMALL["variables"] | added})
    assert family.job(5).scenario == Family.load(SMALL).job(5).scenario


def test_the_episodes_of_a_seed_visit_every_job():
    family = Family.load(SMALL)
    assert {family.number(5, episode, "train") for episode in range(8)} == set(range(8))


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
    table = {
        "columns": ["power"],
        "rows": rows,
        "held_out": ["small", "large"],
        "source": "test",
    }
    drawn = {
        "tables": {"machine": table},
        "fields": {"limits.power": "power"},
        "splits": {"train": [], "other": ["machine"]},
    }
    family = Family.load(SMALL | drawn)
    for split, expected in (("train", {7.0}), ("other", {6.5, 7.5})):
        powers = {family.job(seed, split).scenario.limits.power for seed in range(8)}
        assert powers == expected


def test_splits_have_different_jobs():
    assert SHOP.job(0, "train").scenario != SHOP.job(0, "unseen_jobs").scenario


def test_an_unknown_split_is_refused():
    with pytest.raises(ValueError, match="did you mean unseen_jobs"):
        SHOP.job(0, "unseen_job")


@pytest.mark.slow
@pytest.mark.parametrize("split", SHOP.splits)
def test_every_job_makes_sense_and_is_a_scenario(split):
    jobs = SHOP.draw(split, 0)
    sensible = makes_sense(jobs.true, jobs.plan)
    assert sensible.shape == (CHUNK,)
    assert sensible.all()
    assert np.isfinite(SHOP.context(jobs.features)).all()
    job = SHOP.job(17, split)
    assert Scenario.load(job.scenario.portable()) == job.scenario
    assert job.context.shape == (len(SHOP.context_names),)


def digest_of_jobs(family, split):
    """Return a digest of all jobs of a split: nominal values, true values, and the context."""
    digest = hashlib.sha256()
    num_jobs = family.jobs if split == "train" else family.held_out_jobs
    for chunk in range(math.ceil(num_jobs / CHUNK)):
        jobs = family.draw(split, chunk)
        for fields in (jobs.nominal_fields, jobs.true_fields):
            for name, values in fields.items():
                digest.update(name.encode() + np.asarray(values, np.float64).tobytes())
        digest.update(family.context(jobs.features).tobytes())
    return digest.hexdigest()[:16]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "split"), JOBS)
def test_jobs_are_as_released_on_every_processor(name, split):
    digest = digest_of_jobs(Family.load(name), split)
    assert digest == JOBS[name, split], "jobs have changed: the family needs a new version"


def test_a_family_is_the_same_from_a_dict_and_a_file(tmp_path):
    assert families() == ("shop", "unmodelled")
    assert Family.load(SHOP.model_dump(mode="json", exclude_none=True)) == SHOP
    path = tmp_path / "mine.toml"
    path.write_text('[variables]\n[fields]\n"limits.power" = 6.5\n')
    assert Family.load(path).job(0).scenario.limits.power == 6.5
    assert Family.load(path).name == "mine"


@pytest.fixture
def twin():
    """The family `unmodelled`, in which the state and the true laws are observed."""
    fields = UNMODELLED.fields | {"sensors.observes_all": True}
    return Family.load(UNMODELLED.model_dump(exclude_none=True) | {"fields": fields})


def test_a_twin_that_observes_all_has_the_same_jobs(twin):
    twin_fields = flat(twin.job(5).scenario.model_dump())
    plain_fields = flat(UNMODELLED.job(5).scenario.model_dump())
    differing = {name for name, value in twin_fields.items() if value != plain_fields[name]}
    assert differing == {"sensors.observes_all"}


def test_the_context_of_a_twin_begins_with_that_of_the_family(twin):
    context = twin.job(5).context
    plain_context = UNMODELLED.job(5).context
    assert len(context) > len(plain_context)
    assert context[: len(plain_context)] == pytest.approx(plain_context)


def test_a_twin_that_observes_all_shows_the_true_laws_and_forms(twin):
    job = twin.job(5)
    numbers = job.numbers
    # Laws are shown beside those of the nominal model, and hidden forms by their fields.
    exponent = "thrust_force_feed_exponent"
    assert numbers[exponent] == job.scenario.nominal().material.thrust_force.feed
    assert numbers[f"true_{exponent}"] == job.scenario.material.thrust_force.feed
    assert numbers["true_machine.chatter"] == job.scenario.machine.chatter


def test_hidden_forms_are_true_and_the_nominal_model_knows_none_of_them():
    scenario = UNMODELLED.job(3).scenario
    nominal = scenario.nominal()
    assert nominal.edge_failure == EdgeFailure()
    assert nominal.mismatch == Mismatch()
    assert nominal.machine.chatter == 0.0
    true = flat(scenario.model_dump(exclude={"name", "nominal_model"}))
    true_fields = UNMODELLED.draw("train", 0).true_fields
    assert UNMODELLED.hidden
    for name in UNMODELLED.hidden:
        drawn = np.broadcast_to(true_fields[name], CHUNK)
        assert true[name] == drawn[3]
    # Edges of some lathes collapse; those of the others bear any temperature.
    assert len(np.unique(true_fields["edge_failure.collapse_temperature"])) == 2


def test_forms_of_the_laws_differ_between_truth_and_nominal_model_in_a_known_share_of_jobs():
    jobs = SHOP.draw("train", 0)
    assert makes_sense(jobs.true, jobs.plan).all()
    for name in ("thrust_force", "power"):
        true = getattr(jobs.true.material, name)
        nominal = getattr(jobs.nominal.material, name)
        true_form = true.wear_growth > 0.0
        nominal_form = nominal.wear_growth > 0.0
        # Of 256 jobs; 0.92, 0.5 and 0.42 of all that are drawn, whether they make sense or not.
        assert true_form.mean() == pytest.approx(0.92, abs=0.06)
        assert nominal_form.mean() == pytest.approx(0.5, abs=0.1)
        assert (true_form != nominal_form).mean() == pytest.approx(0.42, abs=0.1)
        # U = 1 + b W has no exponent.
        assert (true.wear[true_form] == 1.0).all()
        assert (nominal.wear[~nominal_form] < 1.2).all()


def test_both_forms_of_a_law_need_the_same_load_at_a_half_worn_edge():
    share_of_a_fresh_edge = []
    for seed in range(16):
        job = SHOP.job(seed)
        material = job.scenario.nominal().material
        place = {"cutting_speed": job.cutting_speed, "feed": 0.25, "depth_of_cut": 2.0}
        worn = material.power(**place, wear=0.15)
        fresh = material.power(**place, wear=1e-9)
        share_of_a_fresh_edge.append(fresh / worn)
        if material.power.wear_growth > 0.0:
            assert worn / fresh == pytest.approx(1.0 + 0.15 * material.power.wear_growth)
    assert min(share_of_a_fresh_edge) < 0.3
    assert max(share_of_a_fresh_edge) > 0.7


def test_start_speeds_depend_on_the_grade():
    materials = SHOP.tables["material"]
    usual_speeds = {row[2] for row in materials.rows.values()}
    grades = [row[0] for row in SHOP.tables["grade"].rows.values()]
    jobs = SHOP.draw("train", 0)
    # The machine's highest speed is 1.6 times the start speed.
    start_speeds = jobs.nominal_fields["machine.cutting_speed_max"] / 1.6
    for start_speed in start_speeds:
        usual = [start_speed / grade for grade in grades]
        assert any(
            abs(speed - usual_speed) < 1e-9 for speed in usual for usual_speed in usual_speeds
        )


def test_about_half_of_the_lathes_have_each_form_and_no_nominal_model_has_any():
    jobs = UNMODELLED.draw("train", 0)
    failure = jobs.true.edge_failure
    nominal_windows = jobs.nominal_fields["swarf.chip_feed_min"]
    present = [
        failure.collapse_temperature < 5000.0,
        failure.built_up_edge > 1e-6,
        failure.notch_growth > 1e-6,
        jobs.true.machine.chatter > 1e-6,
        jobs.true_fields["swarf.chip_feed_min"] != nominal_windows,
    ]
    for form in present:
        assert form.mean() == pytest.approx(0.5, abs=0.12)
    # One form says nothing of another.
    correlations = np.corrcoef(present) - np.eye(len(present))
    assert np.abs(correlations).max() < 0.25
    nominal = UNMODELLED.job(0).scenario.nominal()
    assert nominal.edge_failure == EdgeFailure()
    assert nominal.machine.chatter == 0.0
    assert set(nominal_windows) <= {row[0] for row in UNMODELLED.tables["breaker"].rows.values()}


def test_a_family_extends_another_and_shows_values_of_a_catalogue(tmp_path):
    assert UNMODELLED.base == SHOP.base
    law = "material.power.coefficient"
    assert UNMODELLED.fields[law] == SHOP.fields[law]
    assert UNMODELLED.tables["machine"].held_out == SHOP.tables["machine"].held_out
    assert UNMODELLED.context_names == (*SHOP.context_names, *UNMODELLED.shown)
    adhesions = UNMODELLED.draw("train", 0).features["adhesion"]
    material = UNMODELLED.tables["material"]
    column = material.columns.index("adhesion")
    assert set(adhesions.round(6)) <= {row[column] for row in material.rows.values()}
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
    formulas = [
        "minimum(1.0, factor)",
        "-factor",
        "factor * 3",
        "maximum(factor, 5)",
        "exp(factor)",
    ]
    for formula in formulas:
        evaluate("fields.limits.power", formula, {"factor": factor})
    assert factor.tolist() == [2.0] * 4
    with pytest.raises(FormulaError):
        evaluate("fields.limits.power", "minimum(1.0, factor, factor)", {"factor": factor})
    assert factor.tolist() == [2.0] * 4


@pytest.mark.parametrize(
    "distribution",
    [
        {"uniform": [-1e308, 1e308]},
        {"normal": [0, 1e308]},
        {"log_uniform": [1e-300, 1e300]},
    ],
    ids=["uniform", "normal", "log_uniform"],
)
def test_a_distribution_with_values_that_are_not_finite_is_refused(distribution):
    variable = {"unit": "-", "source": "none"} | distribution
    with pytest.raises(ScenarioError, match=r"variables\.factor"):
        Family.load(SMALL | {"variables": {"factor": variable}})


def variables(**kinds):
    """Return variables, of which there is one, with some kinds of distribution."""
    return {"factor": {"unit": "-", "source": "none"} | kinds}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param({"jobz": 3}, "did you mean jobs", id="unknown key"),
        pytest.param(
            {"fields": {"limits.power": "factr * 7"}}, "did you mean factor", id="unknown variable"
        ),
        pytest.param(
            {"fields": {"limits.power": "factor.real"}}, "a formula has numbers", id="attribute"
        ),
        pytest.param({"fields": {"limits.power": "7 *"}}, "is not a formula", id="syntax"),
        pytest.param(
            {"fields": {"limits.power": "(factor - 1) ** 2"}},
            r"\*\* needs numbers above 0",
            id="power",
        ),
        pytest.param(
            {"fields": {"limits.power": "log(factor - 2)"}},
            "log needs numbers above 0",
            id="logarithm",
        ),
        pytest.param({"fields": {"limits.powr": 7.0}}, "did you mean power", id="unknown field"),
        pytest.param({"variables": variables()}, "must have one of uniform", id="no distribution"),
        pytest.param(
            {"variables": variables(uniform=[2, 1])},
            "must not exceed the highest",
            id="ends reversed",
        ),
        pytest.param(
            {"fields": {"limits.power": 0.01}},
            r"make no sense in split 'train': by the nominal model no cutting speed and feed is "
            r"within .* limits\.power; the family sets limits\.power",
            id="no sensible job",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"splits": {"train": ["material"]}},
            "draws no held-out rows",
            id="training on held-out rows",
        ),
    ],
)
def test_errors_name_the_field_and_what_is_allowed(changes, message):
    with pytest.raises(ScenarioError, match=message):
        Family.load(SMALL | changes)


@pytest.mark.slow
@pytest.mark.parametrize("split", ["unseen_materials", "unseen_machines"])
@pytest.mark.parametrize("first_is_a_line", [False, True])
def test_jobs_are_played_though_the_first_one_has_another_form_of_a_law(split, first_is_a_line):
    is_line = UNMODELLED.draw(split, 0).true.material.power.wear_growth > 0.0
    first = int(np.flatnonzero(is_line == first_is_a_line)[0])
    second = int(np.flatnonzero(is_line != first_is_a_line)[0])
    env = FamilyVectorEnv(2, UNMODELLED, split=split)
    observations, _ = env.reset(seed=[first, second])
    assert np.isfinite(observations).all()
