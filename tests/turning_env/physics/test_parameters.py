"""The table of parameters: names and units."""

import pytest

from turning_env import Scenario
from turning_env.physics.parameters import PARAMETERS, by_name
from turning_env.physics.quantities import WIDTH
from turning_env.physics.records import parameter_records


def test_two_parameters_of_one_name_are_refused():
    (feed,) = [parameter for parameter in PARAMETERS if parameter.name == "feed_max"]
    other = feed._replace(field="swarf.feed_max")
    with pytest.raises(
        ValueError,
        match=r"two parameters are named 'feed_max': machine.feed_max and swarf.feed_max",
    ):
        by_name([feed, other])


def test_every_parameter_has_a_name_of_its_own():
    assert len(by_name(PARAMETERS)) == len(PARAMETERS)


def test_fields_have_the_units_of_their_sections():
    parameters = by_name(PARAMETERS)
    assert parameters["feed_max"].unit == "mm/rev"
    assert parameters["depth_profile"].unit == "mm"
    assert parameters["probe"].unit == "-"


@pytest.mark.parametrize("name", ["feed_max", "tangle_time", "overload_price", "warm_up_time"])
def test_a_field_is_read_from_its_section(name):
    parameter = by_name(PARAMETERS)[name]
    section, field = parameter.field.split(".")
    scenario = Scenario()
    expected = getattr(getattr(scenario, section), field)
    assert parameter_records(scenario)[name][0].tolist() == [expected] * WIDTH
