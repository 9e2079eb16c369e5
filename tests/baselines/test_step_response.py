from pathlib import Path

import pytest

from baselines import step_response
from baselines.step_response import SHOWN, draw, main, responses
from baselines.stepped_bar import stepped_bar
from turning_env import Scenario


@pytest.fixture(autouse=True)
def short_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar of two depths, which takes a moment."""
    monkeypatch.setattr(step_response, "stepped_bar", lambda depths: stepped_bar((1.0, 3.0), 10.0))


def test_every_law_of_override_is_shown_with_all_its_parameters() -> None:
    rules = {name: rule for name, rule in step_response._RULES.items() if rule.plays(Scenario.load("override"))}
    assert SHOWN.keys() == rules.keys()
    for name, (_, parameters) in SHOWN.items():
        assert parameters.keys() == rules[name].ranges.keys()
        for key, values in rules[name].ranges.items():
            assert values.low <= parameters[key] <= values.high


def test_each_field_shows_its_own_course() -> None:
    scenario = stepped_bar((1.0, 3.0), 10.0)
    courses = responses(scenario)
    titled = [axes for axes in draw(courses, scenario).axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in titled] == [title for title, _ in SHOWN.values()]
    for axes, run in zip(titled, courses.values(), strict=True):
        assert axes.lines[0].get_xdata()[-1] == run.time[-1]


def test_the_picture_is_written_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "new" / "picture.png"
    assert main(["--out", str(target)]) == 0
    assert target.read_bytes().startswith(b"\x89PNG")
    assert list(target.parent.iterdir()) == [target]
    assert capsys.readouterr().out == f"{target}\n"


def test_a_picture_that_cannot_be_written_is_said_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["--out", str(tmp_path / "file" / "picture.png")]) == 2
    assert "cannot be written" in capsys.readouterr().err
