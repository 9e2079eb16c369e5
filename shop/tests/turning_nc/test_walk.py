"""The walk of a process engineer, from a messy sheet to advice and an adapted program.

No two numbers of the walk disagree.
"""

import contextlib
import io
import itertools
import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("shapely")

from matplotlib.text import Text
from turning_shop.__main__ import main
from turning_shop.advise import advise, headline
from turning_shop.plots import draw_sheet
from turning_shop.provenance import load

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


OPTIONS = ("--stock", "bar:105x320", "--json")


def messy_sheet() -> str:
    """Return measured cuts as they come: two header lines, decimal commas, means, remarks."""
    rng = np.random.default_rng(0)
    rows = []
    settings = itertools.product((150, 220, 300), (0.15, 0.3, 0.45), (2, 3.5))
    for edge, (speed, feed, depth) in enumerate(settings, 1):
        life = 20.0 * (220 / speed) ** 4 * (0.3 / feed) ** 0.6
        for share in (0.3, 0.6, 1.0):
            time = life * share
            wear = 0.3 * share**0.7 * np.exp(0.05 * rng.normal())
            power = 1.02 * speed * feed**0.78 * depth * wear**0.13 * 60  # [W]
            power *= np.exp(0.01 * rng.normal())
            cut = f"{edge};{speed};{feed};{depth}"
            rows.append(f"{cut};{time:.1f};{1000 * wear:.0f};{power:.0f};ok")
    rows.insert(9, "Mittelwert;187;0.2;2.7;11.1;150;6000;")
    headers = [
        "\ufeffVersuch 7;;;;;;;",
        "Schneide;vc;fn;ap;Zeit;VB;P;Bemerkung",
        ";m/min;mm/U;mm;min;um;W;",
    ]
    return "\n".join([*headers, *(row.replace(".", ",") for row in rows)])


def printed(*words: str) -> str:
    """Return what a command prints."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        assert main(list(words)) == 0
    return output.getvalue()


class Walk(NamedTuple):
    """The files and the output of a walk from measured cuts to advice."""

    folder: Path
    text: str  # advice as text
    advice: dict[str, Any]  # the first advice as JSON

    @property
    def sentence(self) -> str:
        """The recommendation in the text."""
        return next(line for line in self.text.splitlines() if line.startswith("Cut "))

    def play(self, program: str, *options: str) -> dict[str, Any]:
        """Return the results of a program of the folder."""
        words = ("program", str(self.folder / program), *OPTIONS, *options)
        scenario = str(self.folder / "priced.toml")
        return json.loads(printed(*words, "--scenario", scenario))


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Walk:
    folder = tmp_path_factory.mktemp("walk")
    (folder / "machine.toml").write_text(MACHINE, "utf-8")
    (folder / "cuts.csv").write_text(messy_sheet(), "utf-8")
    (folder / "priced.toml").write_text(PRICED, "utf-8")
    base = str(folder / "machine.toml")
    tool = str(folder / "tool.toml")
    printed("calibrate", str(folder / "cuts.csv"), "--base", base, "--out", tool)
    advise_words = ("advise", str(folder / "priced.toml"), "--seeds", "0")
    text = printed(*advise_words, "--page", str(folder / "page.html"))
    results = json.loads(printed(*advise_words, "--json"))
    return Walk(folder, text, advice=results["advice"][0])


@pytest.mark.slow
def test_sentence_table_and_json_of_the_advice_have_the_same_numbers(walk: Walk) -> None:
    advice = walk.advice
    cells = re.fullmatch(
        r"Cut (\S+) m/min, (\S+) mm/rev, change after (\d+) parts: "
        r"(\S+) EUR a part( \(.*\))?( \*)?",
        walk.sentence,
    )
    assert cells is not None
    assert float(cells[1]) == advice["cutting_speed"]
    assert float(cells[2]) == advice["feed"]
    assert float(cells[3]) == advice["parts"]
    assert float(cells[4]) == round(advice["cost"], 2)
    assert bool(cells[6]) == advice["extrapolated"]

    lines = walk.text.splitlines()
    row = next(line for line in lines if line.startswith("least cost ")).split()
    assert row[2:7] == [
        f"{advice['cutting_speed']:g}",
        f"{advice['feed']:g}",
        f"{advice['parts']:g}",
        f"{advice['wear']:.3g}",
        f"{advice['tool_life']:.1f}",
    ]
    assert f"{advice['cost']:.2f}" in row


@pytest.mark.slow
def test_page_and_drawing_say_what_the_text_says(walk: Walk) -> None:
    scenario, evidence = load(walk.folder / "priced.toml")
    advice = advise(scenario, evidence)
    page = (walk.folder / "page.html").read_text("utf-8")
    texts = draw_sheet(scenario, evidence, advice).findobj(Text)
    drawing = "\n".join(text.get_text() for text in texts)
    sentences = list(headline(scenario, evidence, advice))
    assert sentences[0] == walk.sentence
    for sentence in sentences:
        assert sentence in walk.text
        assert sentence in page
        assert sentence in drawing

    data = re.search(r'id="data">(.*?)</script>', page)
    assert data is not None
    shown = json.loads(data[1])
    steps = shown["advice"][0]["at"]
    at = {
        axis["name"]: axis["values"][step] for axis, step in zip(shown["axes"], steps, strict=True)
    }
    for name in ("cutting_speed", "feed", "wear"):
        assert at[name] == pytest.approx(walk.advice[name])


@pytest.mark.parametrize("approach", [0.0, 0.7, 5.0, 40.0])
def test_a_program_with_the_advised_cut_has_the_advised_life_and_load(
    walk: Walk, approach: float
) -> None:
    advice = walk.advice
    speed = advice["cutting_speed"]
    text = PROGRAM.format(approach=approach, speed=speed, feed=advice["feed"])
    (walk.folder / "cut.nc").write_text(text)
    totals = walk.play("cut.nc")["totals"]
    assert totals["parts"]["T0101"] == advice["parts"]
    assert totals["change_wear"]["T0101"] == advice["wear"]
    assert totals["max_load"] == pytest.approx(advice["power_share"], rel=1e-3)
    assert bool(totals["extrapolated"]) == advice["extrapolated"]

    time_in_air = approach * totals["time_in_metal"] / 300.0
    assert totals["time_at_feed_in_air"] == pytest.approx(time_in_air, abs=0.01)
    minutes = advice["parts"] * totals["time_in_metal"] / 60.0
    assert advice["minutes"] == pytest.approx(minutes, rel=1e-3)
    used_life = advice["minutes"] / advice["parts"] / advice["tool_life"]
    assert used_life == pytest.approx(totals["used_life"]["T0101"], rel=1e-3)


def test_an_adapted_program_plays_as_it_was_announced(walk: Walk) -> None:
    (walk.folder / "slow.nc").write_text(PROGRAM.format(approach=5.0, speed=180, feed=0.2))
    out = str(walk.folder / "slow.simulated.nc")
    results = walk.play("slow.nc", "--adapt", "words", "--out", out)
    totals = walk.play("slow.simulated.nc")["totals"]
    assert totals == results["adapted"]["totals"]
    assert totals["parts"]["T0101"] >= results["totals"]["parts"]["T0101"]
    assert totals["max_load"] <= 1.0
