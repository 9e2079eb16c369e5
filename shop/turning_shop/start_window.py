"""Where insert, grade and machine allow cuts without measured data: speeds, feeds and depths."""

from typing import NamedTuple

from turning_shop import WorkshopError
from turning_shop.allowed import feed_ends, with_roughness
from turning_shop.catalogue.inserts import Insert
from turning_shop.catalogue.start_values import feeds_of
from turning_shop.start_question import Question, Setup

from turning_env.numerics.conversions import cutting_speed_at
from turning_env.scenario import Scenario

UNREACHED = 0.5
"""Lowest over highest value of a range that the machine, or the nose radius, ends (assumption)."""


class CutWindow(NamedTuple):
    """Ranges of cuts that insert, grade and machine allow."""

    speeds: tuple[float, float]  # [m/min]
    feeds: tuple[float, float]  # [mm/rev]
    depths: tuple[float, float]  # [mm]
    # Fields of the scenario whose ends are the catalogue's rather than the machine's.
    catalogue_ends: frozenset[str]
    assumptions: tuple[str, ...]


def cut_window_of(setup: Setup) -> CutWindow:
    """Return where insert, grade and machine allow cuts.

    Raises:
        WorkshopError: Stock or edge do not allow the depth of cut, or no speed or feed is left.
    """
    _check_depth(setup)
    speeds = _speeds(setup)
    feeds = _feeds(setup)
    assumptions = speeds.assumptions + feeds.assumptions
    depths = setup.insert.depths
    stated_depth = setup.question.depth
    if stated_depth is None:
        assumptions += (
            f"no --depth is given: {setup.depth:.3g} mm, the usual one of its chip breaker",
        )
    elif not depths[0] <= stated_depth <= depths[1]:
        assumptions += (
            f"{stated_depth:g} mm is outside the {depths[0]:g} to {depths[1]:.2g} mm of its "
            "chip breaker: chips may not break",
        )
    return CutWindow(
        speeds=(speeds.low, speeds.high),
        feeds=(feeds.low, feeds.high),
        depths=depths,
        catalogue_ends=speeds.catalogue_ends | feeds.catalogue_ends,
        assumptions=assumptions,
    )


def _check_depth(setup: Setup) -> None:
    """Raise a WorkshopError if stock or edge do not allow the depth of cut."""
    depth = setup.depth
    insert = setup.insert
    stock = setup.question.stock
    wall = (stock.diameter - stock.bore) / 2.0
    if stock.bore and depth >= wall:
        raise WorkshopError(f"--depth {depth:g} mm cuts through the tube's wall of {wall:g} mm")
    if 2.0 * depth >= stock.diameter:
        raise WorkshopError(
            f"--depth {depth:g} mm reaches the axis of a bar of {stock.diameter:g} mm diameter"
        )
    # The edge is in the cut over depth / sine; a round one is bounded by its diameter.
    max_depth = insert.max_depth if insert.is_round else setup.entering_sine * insert.max_depth
    if depth > max_depth:
        raise WorkshopError(
            f"--depth {depth:g} mm is too deep for {insert.name}: its edge of "
            f"{insert.edge_length:.1f} mm cuts up to {max_depth:.1f} mm; "
            "take more passes or a larger insert"
        )


class _Span(NamedTuple):
    """A range of speeds or feeds."""

    low: float
    high: float
    catalogue_ends: frozenset[str]  # fields of the scenario whose ends are the catalogue's
    assumptions: tuple[str, ...]


def _speeds(setup: Setup) -> _Span:
    """Return the cutting speeds of the catalogue that the machine reaches [m/min]."""
    question = setup.question
    machine = setup.machine
    stated = setup.stated
    ends = {"machine.cutting_speed_min", "machine.cutting_speed_max"}
    assumptions: tuple[str, ...] = ()
    low = setup.start.speeds.low
    high = setup.start.speeds.high
    if "machine.cutting_speed_max" in stated and machine.machine.cutting_speed_max < high:
        high = machine.machine.cutting_speed_max
        ends.discard("machine.cutting_speed_max")
    reached = high
    if machine.spindle.max_speed and "spindle.max_speed" in stated:
        by_spindle = cutting_speed_at(machine.spindle.max_speed, question.stock.diameter)
        reached = min(high, by_spindle)
    if reached <= low:
        assumptions = (
            f"the machine reaches {reached:.0f} m/min at {question.stock.diameter:g} mm diameter, "
            f"less than the catalogue's lowest, {low:.0f} m/min",
        )
        low = UNREACHED * reached
    span = _Span(low, high, catalogue_ends=frozenset(ends), assumptions=assumptions)
    if "machine.cutting_speed_min" not in stated:
        return span
    return _from_lowest(
        span,
        "machine.cutting_speed_min",
        machine.machine.cutting_speed_min,
        highest=reached,
        unit="m/min",
        reason=f"{question.tool} {question.grade} allows in this material",
    )


def _feeds(setup: Setup) -> _Span:
    """Return the feeds of insert and material that the machine has [mm/rev]."""
    question = setup.question
    insert = setup.insert
    machine = setup.machine
    stated = setup.stated
    ends = {"machine.feed_min", "machine.feed_max"}
    assumptions: tuple[str, ...] = ()
    if question.feeds is None:
        # The chip breaker's feeds are those of chips as thick as at 90 degrees.
        low, high = (feed / setup.entering_sine for feed in insert.feeds)
    else:
        low, high = question.feeds
    by_material = feeds_of(setup.material.group)
    if by_material and question.feeds is None:
        # Feeds that the chip breaker and the material both allow. If the chip breaker's window
        # begins above half of the material's highest feed, little or nothing is left of it: then
        # the range begins at that half, so that it does not become empty.
        lowest_of_material, highest_of_material = by_material
        low = min(low, UNREACHED * highest_of_material)
        low = max(low, lowest_of_material)
        high = min(high, highest_of_material)
    if "machine.feed_max" in stated and machine.machine.feed_max < high:
        high = machine.machine.feed_max
        ends.discard("machine.feed_max")
    highest = min(high, _highest_feed(question, insert))
    if low >= highest:
        low = UNREACHED * highest
        assumptions = (
            f"feeds begin at {low:.3g} mm/rev: the nose radius of {insert.nose_radius:g} mm, "
            "the roughness or the machine end them below the chip breaker's window, "
            "where chips may not break",
        )
    span = _Span(low, high, catalogue_ends=frozenset(ends), assumptions=assumptions)
    if "machine.feed_min" not in stated:
        return span
    return _from_lowest(
        span,
        "machine.feed_min",
        machine.machine.feed_min,
        highest=highest,
        unit="mm/rev",
        reason=f"{insert.name} allows, by its nose radius or the roughness",
    )


def _from_lowest(
    span: _Span, field: str, lowest: float, *, highest: float, unit: str, reason: str
) -> _Span:
    """Return a span that does not begin below the machine's lowest value.

    Args:
        span: of the catalogue, up to what the machine reaches.
        field: of the scenario, which states the lowest value.
        lowest: value of the field.
        highest: value that is possible.
        unit: of all values.
        reason: why none above ``highest`` is possible, for people.

    Raises:
        WorkshopError: The lowest value is not below the highest.
    """
    if lowest <= span.low:
        return span
    if lowest >= highest:
        raise WorkshopError(
            f"{field} is {lowest:g} {unit}, but must be below the {highest:.4g} {unit} that "
            f"{reason}"
        )
    return span._replace(low=lowest, catalogue_ends=span.catalogue_ends - {field})


def _highest_feed(question: Question, insert: Insert) -> float:
    """Return the highest feed that nose radius and roughness allow [mm/rev]."""
    tool = {"nose_radius": insert.nose_radius}
    scenario = Scenario.load({"machine": {"feed_max": 10.0}, "tool": tool})
    if question.roughness is not None:
        scenario = with_roughness(scenario, question.roughness, wiper=insert.cut.wiper)
    return feed_ends(scenario)[0].feed
