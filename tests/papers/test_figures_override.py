from papers.figures import override
from papers.figures.override import SHOWN, drawn, responses
from papers.stepped_bar import stepped_bar
from turning_env import Scenario


def test_every_law_of_override_is_shown_with_all_its_parameters() -> None:
    rules = {name: rule for name, rule in override._RULES.items() if rule.plays(Scenario.load("override"))}
    assert SHOWN.keys() == rules.keys()
    for name, (_, parameters) in SHOWN.items():
        assert parameters.keys() == rules[name].ranges.keys()
        for key, values in rules[name].ranges.items():
            assert values.low <= parameters[key] <= values.high


def test_each_field_shows_its_own_course() -> None:
    scenario = stepped_bar((1.0, 3.0), 10.0)
    courses = responses(scenario)
    titled = [axes for axes in drawn(courses, scenario).axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in titled] == [title for title, _ in SHOWN.values()]
    for axes, run in zip(titled, courses.values(), strict=True):
        assert axes.lines[0].get_xdata()[-1] == run.time[-1]
