"""The walk of a process engineer, from a messy sheet to advice and an adapted program."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely")
from matplotlib.text import Text
from turning_shop.advise import advise, headline
from turning_shop.plots import draw_sheet
from turning_shop.provenance import load

from turning_env.__main__ import main

MACHINE = """
[machine]
cutting_speed_min = 100.0
cutting_speed_max = 320.0
feed_min = 0.1
feed_max = 0.5
[limits]
power = 9.0
[spindle]
base_speed = 500.0
idle_torque = 4.0
[workpiece]
diameter = 100.0
"""
PRICED = """
base = "tool.toml"
[economics]
currency = "EUR"
machine_rate = 55.0
operator_rate = 30.0
insert_price = 9.5
"""
PROGRAM = (
    "G21 G99 T0101\nG50 S4000\nG96 S{speed:.10g} M3\n"
    "G0 X100. Z{approach}\nG1 Z-300. F{feed:.10g}\nG0 X120.\nZ5.\nM30\n"
)


def messy_sheet() -> str:
    """Return measured cuts as they come: two header lines, decimal commas, means, remarks."""
    rng = np.random.default_rng(0)
    rows = []
    for edge, (speed, feed, depth) in enumerate(
        (v, f, a) for v in (150, 220, 300) for f in (0.15, 0.3, 0.45) for a in (2, 3.5)
    ):
        life = 20.0 * (220 / speed) ** 4 * (0.3 / feed) ** 0.6
        for time in life * np.array([0.3, 0.6, 1.0]):
            wear = 0.3 * (time / life) ** 0.7 * np.exp(0.05 * rng.normal())
            power = (
                1.02 * speed * feed**0.78 * depth * wear**0.13 * 60 * np.exp(0.01 * rng.normal())
            )
            rows.append(
                f"{edge + 1};{speed};{feed};{depth};{time:.1f};{1000 * wear:.0f};{power:.0f};ok"
            )
    rows.insert(9, "Mittelwert;187;0.2;2.7;11.1;150;6000;")
    lines = [
        "\ufeffVersuch 7;;;;;;;",
        "Schneide;vc;fn;ap;Zeit;VB;P;Bemerkung",
        ";m/min;mm/U;mm;min;um;W;",
    ]
    return "\n".join(lines + [row.replace(".", ",") for row in rows])


def test_no_two_numbers_of_the_walk_disagree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (
        ("machine.toml", MACHINE),
        ("cuts.csv", messy_sheet()),
        ("priced.toml", PRICED),
    ):
        Path(name).write_text(text, "utf-8")

    def printed(*words: str) -> str:
        capsys.readouterr()
        assert main(list(words)) == 0
        return capsys.readouterr().out

    printed("calibrate", "cuts.csv", "--base", "machine.toml", "--out", "tool.toml")
    text = printed("advise", "priced.toml", "--seeds", "0", "--page", "page.html")
    advice = json.loads(printed("advise", "priced.toml", "--seeds", "0", "--json"))["advice"][0]
    sentence = next(line for line in text.splitlines() if line.startswith("Cut "))
    numbers = re.fullmatch(
        r"Cut (\S+) m/min, (\S+) mm/rev, change after (\d+) parts: "
        r"(\S+) EUR a part( \(.*\))?( \*)?",
        sentence,
    )
    assert numbers is not None
    speed, feed, parts, cost = map(float, numbers.groups()[:4])
    assert (speed, feed, parts) == (advice["cutting_speed"], advice["feed"], advice["parts"])
    assert cost == round(advice["cost"], 2)
    assert bool(numbers[6]) == advice["extrapolated"]

    row = next(line for line in text.splitlines() if line.startswith("least cost ")).split()
    shown = [
        f"{speed:g}",
        f"{feed:g}",
        f"{parts:g}",
        f"{advice['wear']:.3g}",
        f"{advice['tool_life']:.1f}",
    ]
    assert row[2:7] == shown
    assert f"{cost:.2f}" in row

    page = Path("page.html").read_text("utf-8")
    scenario, evidence = load("priced.toml")
    found = advise(scenario, evidence)
    said = list(headline(scenario, evidence, found))
    assert said[0] == sentence
    drawn = "\n".join(
        each.get_text() for each in draw_sheet(scenario, evidence, found).findobj(Text)
    )
    for line in said:
        assert line in text
        assert line in page
        assert line in drawn
    data = re.search(r'id="data">(.*?)</script>', page)
    assert data is not None
    first = json.loads(data[1])["advice"][0]
    assert [first[name] for name in ("cutting_speed", "feed", "wear")] == [
        speed,
        feed,
        advice["wear"],
    ]

    options = ("--scenario", "priced.toml", "--stock", "bar:105x320", "--json")
    for approach in (0.0, 0.7, 5.0, 40.0):
        Path("cut.nc").write_text(PROGRAM.format(approach=approach, speed=speed, feed=feed))
        played = json.loads(printed("program", "cut.nc", *options))["totals"]
        assert (played["parts"]["T0101"], played["change_wear"]["T0101"]) == (parts, advice["wear"])
        assert played["time_at_feed_in_air"] == pytest.approx(
            approach * played["time_in_metal"] / 300.0, abs=0.01
        )
        assert played["max_load"] == pytest.approx(advice["power_share"], rel=1e-3)
        assert advice["minutes"] == pytest.approx(parts * played["time_in_metal"] / 60.0, rel=1e-3)
        assert advice["minutes"] / parts / advice["tool_life"] == pytest.approx(
            played["used_life"]["T0101"], rel=1e-3
        )
        assert bool(played["extrapolated"]) == advice["extrapolated"]

    Path("slow.nc").write_text(PROGRAM.format(approach=5.0, speed=180, feed=0.2))
    made = json.loads(
        printed("program", "slow.nc", *options, "--adapt", "words", "--out", "slow.simulated.nc")
    )
    again = json.loads(printed("program", "slow.simulated.nc", *options))
    assert again["totals"] == made["adapted"]["totals"]
    assert again["totals"]["parts"]["T0101"] >= made["totals"]["parts"]["T0101"]
    assert again["totals"]["max_load"] <= 1.0
