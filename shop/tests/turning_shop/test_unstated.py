"""Values that only a preset states are off, or printed as assumed.

No two numbers of advice disagree because of one.
"""

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.advise import advise, headline
from turning_shop.advise_play import clocked, constant, play_all
from turning_shop.allowed import NO_STRENGTH, allowed_loads, feed_range
from turning_shop.plots import draw_sheet
from turning_shop.prediction import Evidence
from turning_shop.provenance import BARS_VARY, load
from turning_shop.whatif import NO_LIMIT, what_if

from leaderboard.adapt import as_factory
from leaderboard.play import play
from shop.tests.turning_shop.sheets import wear_curves
from turning_env import Scenario
from turning_env.scenario import ScenarioError

MACHINE = """
base = "rough_turning"
[machine]
cutting_speed_min = 90.0
cutting_speed_max = 350.0
feed_min = 0.1
feed_max = 0.45
[workpiece]
diameter = 90.0
bar_length = 220.0
depth_of_cut = 2.5
[economics]
currency = "CHF"
machine_rate = 60.0
insert_price = 10.0
edges_per_insert = 4.0
[control]
interval = 3.0
"""
VARIED = """
base = "tool.toml"
[workpiece]
depth_bar_spread = 0.2
depth_along_spread = 0.25
hardness_bar_spread = 0.06
hardness_along_spread = 0.04
[tool]
edge_strength = 3000.0
nose_radius = 0.8
[limits]
power = 6.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a tool calibrated on the user's own machine.

    ``varied.toml`` also states how bars vary and when edges break.
    """
    folder = tmp_path_factory.mktemp("shop")
    (folder / "machine.toml").write_text(MACHINE, "utf-8")
    (folder / "cuts.csv").write_text(wear_curves(), "utf-8")
    (folder / "varied.toml").write_text(VARIED, "utf-8")
    command = ["calibrate", str(folder / "cuts.csv"), "--base", str(folder / "machine.toml")]
    assert main([*command, "--out", str(folder / "tool.toml")]) == 0
    return folder


def test_values_that_the_files_do_not_state_are_off_and_named(folder: Path) -> None:
    scenario, evidence = load(folder / "tool.toml")
    assert scenario.limits.power == NO_LIMIT["power"]
    assert scenario.limits.thrust_force == NO_LIMIT["thrust_force"]
    assert scenario.tool.edge_strength == NO_STRENGTH
    warnings = "\n".join(evidence.warnings)
    for name in BARS_VARY:
        section, field = name.split(".")
        assert getattr(getattr(scenario, section), field) == 0.0
        assert name in warnings
    for name in (
        "limits.power",
        "tool.edge_strength",
        "machine.return_time 0.1 min",
        "workpiece.approach 3 mm",
    ):
        assert name in warnings
    for stated in ("diameter", "cutting_speed", "insert_price", "currency", "wear_factor_spread"):
        assert stated not in warnings


def test_values_that_the_files_state_stay(folder: Path) -> None:
    scenario, evidence = load(folder / "varied.toml")
    assert scenario.tool.edge_strength == 3000.0
    assert scenario.workpiece.depth_along_spread == 0.25
    assert scenario.limits.power == 6.0
    warnings = "\n".join(evidence.warnings)
    assert "edge_strength is off" not in warnings
    for assumed in (
        "tool.edge_strength_spread 0.12",
        "economics.breakage_downtime 10 min",
        "limits.overload_allowance 0.05",
    ):
        assert assumed in warnings


@pytest.mark.parametrize(
    "preset", ["practitioner", "harder_lot", "override_torque", "small_diameter"]
)
def test_effects_of_a_preset_are_off_in_a_file_on_it(tmp_path: Path, preset: str) -> None:
    (tmp_path / "changed.toml").write_text(f'base = "{preset}"\n')
    scenario, _ = load(tmp_path / "changed.toml")
    neutral = Scenario()
    for section in ("edge_failure", "swarf", "mismatch", "spindle"):
        switched_off = getattr(scenario, section)
        assert switched_off == getattr(neutral, section)
    assert load(preset)[0] == Scenario.load(preset)


def test_effects_that_advice_does_not_know_are_named(tmp_path: Path) -> None:
    (tmp_path / "changed.toml").write_text(
        "[edge_failure]\ncollapse_temperature = 900.0\n[swarf]\ntangle_rate = 0.5\n"
    )
    warnings = "\n".join(load(tmp_path / "changed.toml")[1].warnings)
    assert "only the simulation" in warnings
    assert "edge_failure.collapse_temperature" in warnings
    assert "swarf.chip_feed_min 0.15 mm/rev" in warnings


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tool.toml", "varied.toml"])
def test_headline_and_simulation_agree_everywhere(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(folder)
    page = folder / f"{name}.html"
    capsys.readouterr()
    assert main(["advise", name, "--seeds", "8", "--json", "--page", str(page)]) == 0
    result = json.loads(capsys.readouterr().out)
    first = result["advice"][0]
    fixed = result["played"]["results"][0]
    assert fixed["cost"]["value"] == pytest.approx(first["cost"], rel=0.03)
    assert fixed["broken"] == 0
    assert fixed["feasible"]
    assert result["played"]["unit"] == "CHF"

    text = page.read_text("utf-8")
    shown_advice = text.partition('class="advice"')[2].partition("</div>")[0]
    shown = [html.unescape(line) for line in re.findall("<p>(.*?)</p>", shown_advice)]
    count = len(result["headline"])
    assert shown[:count] == result["headline"]
    assert f"simulated with 8 edges: {fixed['cost']['value']:.2f} CHF" in shown[count]
    scenario, evidence = load(name)
    advice = advise(scenario, evidence)
    assert list(headline(scenario, evidence, advice)) == result["headline"]
    sheet = draw_sheet(scenario, evidence, advice, shown[count:])
    drawn = "\n".join(text.get_text() for text in sheet.findobj(Text))
    for sentence in shown:
        assert sentence in " ".join(drawn.split())


@pytest.mark.slow
def test_a_broken_edge_is_on_the_sheet() -> None:
    changes = {"edge_failure": {"collapse_temperature": 300.0}, "control": {"time_limit": 2.0}}
    scenario = Scenario.load({"tool": {"edge_strength": 1e6}} | changes)
    advice = advise(scenario, Evidence())
    sentences = list(play_all(scenario, advice[0].plan, [], 2).headline())
    assert "2 of 2 simulated edges broke" in sentences[1]
    sheet = draw_sheet(scenario, Evidence(), advice, sentences)
    drawn = "\n".join(text.get_text() for text in sheet.findobj(Text))
    assert sentences[1] in drawn


@pytest.mark.slow
def test_a_strength_that_is_stated_bounds_the_thrust(folder: Path) -> None:
    scenario, evidence = load(folder / "varied.toml")
    scenario = scenario.model_copy(update={"limits": scenario.limits.model_copy(update=NO_LIMIT)})
    best, *_ = advise(scenario, evidence)
    # The strength that 97.5 % of edges exceed.
    low_strength = scenario.tool.edge_strength * np.exp(-2 * scenario.tool.edge_strength_spread)
    assert best.plan.cuts.thrust_force < low_strength
    assert any(bound.limit.startswith("tool.edge_strength, 3000 N") for bound in best.bounds)
    assert any("tool.edge_strength" in line for line in headline(scenario, evidence, [best]))
    policy = as_factory(constant(scenario, best.plan))
    episodes = play(policy, clocked(scenario, best.plan), range(64))
    assert episodes["edges_broken"].mean() < 0.05
    weak_tool = scenario.tool.model_copy(update={"edge_strength": 50.0})
    weak = scenario.model_copy(update={"tool": weak_tool})
    with pytest.raises(WorkshopError, match=r"tool\.edge_strength, 50 N"):
        advise(weak, evidence)


@pytest.mark.slow
@pytest.mark.parametrize("power", [4.0, 6.0])
def test_limits_are_kept_on_bars_that_vary(folder: Path, power: float) -> None:
    scenario, evidence = load(folder / "varied.toml")
    unbreakable = scenario.tool.model_copy(update={"edge_strength": NO_STRENGTH})
    limits = scenario.limits.model_copy(update={"power": power})
    limited = scenario.model_copy(update={"limits": limits, "tool": unbreakable})
    assert 0.7 < allowed_loads(limited).overload_factors["power"] < 1.0
    best = advise(limited, evidence)[0].plan
    episodes = play(as_factory(constant(limited, best)), clocked(limited, best), range(24))
    allowed_time = limits.overload_allowance * episodes["engaged_time"].sum()
    assert episodes["severe_overload_time"].sum() <= allowed_time
    assert best.cuts.power < power


PROGRAM = "G21 G99 T0101\nG50 S4000\nG96 S180 M3\nG0 X85. Z5.\nG1 Z-200. F0.4\nG0 X100.\nZ5.\nM30\n"


def test_the_strength_of_edges_bounds_programs_too(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    pytest.importorskip("shapely")
    monkeypatch.chdir(folder)
    Path("part.nc").write_text(PROGRAM)
    Path("strong.toml").write_text('base = "tool.toml"\n[tool]\nedge_strength = 2000.0\n')
    loads = {}
    command = ["program", "part.nc", "--stock", "bar:90x220", "--wear", "0.3", "--json"]
    for name in ("tool.toml", "strong.toml"):
        capsys.readouterr()
        assert main([*command, "--scenario", name]) == 0
        result = json.loads(capsys.readouterr().out)
        loads[name] = result["totals"]["max_load"]
        is_noted = any("tool.edge_strength" in note for note in result["notes"])
        assert is_noted == (name == "strong.toml")
    force = what_if(
        load("tool.toml")[0],
        180,
        0.4,
        wear=0.3,
    ).thrust_force
    allowed = allowed_loads(load("strong.toml")[0])
    assert loads["strong.toml"] == pytest.approx(force / allowed.thrust_force, rel=0.02)
    assert loads["strong.toml"] > 1.0


@pytest.fixture(params=[0.4, 0.8], ids="radius {} mm".format)
def nose_radius(request: pytest.FixtureRequest, folder: Path) -> float:
    """A nose radius [mm], which ``nose.toml`` states."""
    radius: float = request.param
    text = f'base = "tool.toml"\n[tool]\nnose_radius = {radius}\n'
    (folder / "nose.toml").write_text(text)
    return radius


def words_of_nose_radius(source: str, radius: float) -> list[str]:
    """Return the words that state a nose radius [mm]: by a file or by an option."""
    if source == "file":
        return ["nose.toml"]
    return ["tool.toml", "--nose-radius", str(radius)]


@pytest.mark.slow
@pytest.mark.parametrize("source", ["file", "option"])
def test_the_nose_radius_limits_the_feed_of_advice(
    folder: Path, nose_radius: float, source: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(folder)
    words = words_of_nose_radius(source, nose_radius)
    capsys.readouterr()
    assert main(["advise", *words, "--seeds", "0", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["advice"]
    for advice in result["advice"]:
        assert advice["feed"] <= nose_radius / 2
    limits = [bound["limit"] for bound in result["advice"][0]["bounds"]]
    assert any("tool.nose_radius" in limit for limit in limits)
    assert not any("needs a nose radius" in line for line in result["headline"])


@pytest.mark.parametrize("source", ["file", "option"])
def test_a_feed_above_half_the_nose_radius_is_noted(
    folder: Path, nose_radius: float, source: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(folder)
    words = words_of_nose_radius(source, nose_radius)
    feed = f"{nose_radius / 2 + 0.01:g}"
    settings = ["--cutting-speed", "150", "--feed", feed, "--wear", "0.1"]
    assert main(["whatif", *words, *settings]) == 0
    assert "nose_radius" in capsys.readouterr().err


def test_the_range_of_feeds_ends_at_half_the_nose_radius(folder: Path, nose_radius: float) -> None:
    scenario, _ = load(folder / "nose.toml")
    assert feed_range(scenario) == (0.1, nose_radius / 2)


def test_a_nose_radius_that_allows_no_feed_is_refused(folder: Path) -> None:
    scenario, _ = load(folder / "tool.toml", nose_radius=0.1)
    with pytest.raises(WorkshopError, match=r"tool\.nose_radius"):
        feed_range(scenario)


@pytest.mark.slow
def test_advice_names_the_nose_radius_that_its_feed_needs(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(folder)
    assert main(["advise", "tool.toml", "--seeds", "0"]) == 0
    assert "needs a nose radius of 0.9 mm or more" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("machine", "speed", "feed"),
    [
        pytest.param(
            "cutting_speed_min = 220.0\ncutting_speed_max = 500.0\n",
            220.0,
            0.25,
            id="fast",
        ),
        pytest.param(
            "cutting_speed_min = 20.0\ncutting_speed_max = 80.0\n",
            80.0,
            0.25,
            id="slow",
        ),
        pytest.param(
            "feed_min = 0.3\nfeed_max = 0.9\n",
            125.0,
            0.3,
            id="high feeds",
        ),
        pytest.param(
            "feed_min = 0.05\nfeed_max = 0.2\n[spindle]\nmax_speed = 300.0\n",
            94.2478,
            0.2,
            id="low feeds and slow spindle",
        ),
    ],
)
def test_a_machines_range_alone_is_enough(
    tmp_path: Path, machine: str, speed: float, feed: float
) -> None:
    """The start moves to the nearest speed [m/min] and feed [mm/rev] of the machine."""
    (tmp_path / "machine.toml").write_text(f'base = "rough_turning"\n[machine]\n{machine}')
    (tmp_path / "tool.toml").write_text('base = "machine.toml"\n[tool]\nwear_criterion = 0.25\n')
    for name in ("machine.toml", "tool.toml"):
        start = Scenario.load(tmp_path / name).control
        assert start.initial_cutting_speed == pytest.approx(speed, rel=1e-5)
        assert start.initial_feed == pytest.approx(feed, rel=1e-5)


def test_a_start_that_is_stated_is_not_moved(tmp_path: Path) -> None:
    (tmp_path / "start.toml").write_text("[control]\ninitial_cutting_speed = 100.0\n")
    (tmp_path / "fast.toml").write_text(
        'base = "start.toml"\n[machine]\ncutting_speed_min = 150.0\n'
    )
    with pytest.raises(ScenarioError, match=r"initial_cutting_speed is 100"):
        Scenario.load(tmp_path / "fast.toml")
    with pytest.raises(ScenarioError, match=r"initial_feed is 0\.9"):
        Scenario.load({"control": {"initial_feed": 0.9}})


def test_the_tool_life_of_the_preset_does_not_depend_on_the_start(tmp_path: Path) -> None:
    (tmp_path / "fast.toml").write_text(
        "[machine]\ncutting_speed_min = 180.0\ncutting_speed_max = 400.0\n"
    )
    (tmp_path / "usual.toml").write_text("[workpiece]\ndiameter = 80.0\n")
    fast, _ = load(tmp_path / "fast.toml")
    usual, _ = load(tmp_path / "usual.toml")
    life = what_if(fast, 190, 0.3, wear=0.2).tool_life
    assert life == pytest.approx(
        what_if(
            usual,
            190,
            0.3,
            wear=0.2,
        ).tool_life
    )
