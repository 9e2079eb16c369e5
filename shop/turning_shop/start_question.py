"""The question of a job without measured cuts, and what its designations mean.

``start_window.py`` finds where such a job may be cut, and ``start.py`` its laws.
"""

from typing import NamedTuple

from turning_shop import WorkshopError
from turning_shop.catalogue.groups import softest, with_hardness
from turning_shop.catalogue.hardness import MAX_OF_CARBIDE
from turning_shop.catalogue.inserts import Insert, read_insert
from turning_shop.catalogue.materials import NamedMaterial, find_material
from turning_shop.catalogue.start_values import (
    Grade,
    Start,
    check_grade,
    for_conditions,
    read_grade,
    start_of,
    stated_start,
)
from turning_shop.provenance import stated_by

from turning_env.scenario import Scenario
from turning_env.scenario.scenario import flat

USUAL_ENTERING_ANGLE = 90.0  # if none is stated [degree] (assumption)


class Stock(NamedTuple):
    """The bar."""

    diameter: float  # at which it is turned [mm]
    length: float  # of cut [mm]
    bore: float = 0.0  # inner diameter of a tube [mm]; 0: solid


class Question(NamedTuple):
    """Material, insert, grade, stock and wishes, as the user states them."""

    material: str
    tool: str
    grade: str
    stock: Stock
    depth: float | None = None  # of cut [mm]
    machine: str = "rough_turning"  # preset or file
    start_speed: float | None = None  # of the box of inserts [m/min]
    feeds: tuple[float, float] | None = None  # of the box of inserts [mm/rev]
    roughness: float | None = None  # highest theoretical one, Rt [um]
    support: str | None = None  # of the bar: "chuck", "tailstock" or "rigid"
    hardness: float | None = None  # Brinell hardness of the bar [HB]
    conditions: tuple[str, ...] = ()  # of the cut: keys of ``CONDITIONS``
    entering_angle: float | None = None  # of the straight edge to the feed [degree]


class Setup(NamedTuple):
    """A question whose designations are read."""

    question: Question
    material: NamedMaterial
    insert: Insert
    grade: Grade
    machine: Scenario
    stated: frozenset[str]  # fields that the machine's files state
    preset: str  # that has all others
    depth: float  # of cut [mm]
    start: Start

    @property
    def entering_sine(self) -> float:
        """Sine of the entering angle [-]."""
        angle = self.question.entering_angle or USUAL_ENTERING_ANGLE
        return self.insert.entering_sine(angle, self.depth)


def setup_of(question: Question) -> Setup:
    """Return the setup of a question.

    Raises:
        WorkshopError: A designation is unknown, or the grade is made for something else.
        ScenarioError: The machine's file is invalid.
    """
    material = _material(question)
    insert = read_insert(question.tool)
    grade = read_grade(question.grade)
    machine = Scenario.load(question.machine)
    stated: frozenset[str] = frozenset()
    preset = machine.name
    if machine.file is not None:
        values, preset = stated_by(machine.file)
        stated = frozenset(flat(values))
    depth = question.depth
    if depth is None:
        depth = min(insert.cut.depth.usual, insert.max_depth)
    start = _start(question, material, insert=insert, grade=grade, depth=depth)
    return Setup(
        question=question,
        material=material,
        insert=insert,
        grade=grade,
        machine=machine,
        stated=stated,
        preset=preset,
        depth=depth,
        start=start,
    )


def _material(question: Question) -> NamedMaterial:
    """Return the material of a question, at the hardness that it states.

    Raises:
        WorkshopError: The material is unknown, or so hard that it is turned with CBN or ceramics.
    """
    hardness = question.hardness
    if hardness is None:
        return find_material(question.material)
    # The hardness tells the state of delivery, such as +QT.
    material = find_material(question.material.partition("+")[0])
    if hardness > MAX_OF_CARBIDE:
        raise WorkshopError(
            f"--hardness {hardness:.0f} HB: above {MAX_OF_CARBIDE:g} HB (45 HRC) bars are turned "
            "with CBN or ceramics, for which the sources have no start values: measure a cut, and "
            "use calibrate"
        )
    annealed = softest(material.group).hardness
    if not 0.6 * annealed <= hardness <= 2.5 * annealed:
        raise WorkshopError(
            f"--hardness {hardness:.0f} HB: {material.name} has about {annealed:.0f} HB annealed"
        )
    return material._replace(group=with_hardness(material.group, hardness))


def _start(
    question: Question, material: NamedMaterial, *, insert: Insert, grade: Grade, depth: float
) -> Start:
    """Return the start value: that of the box, or else of the table.

    Raises:
        WorkshopError: The table has none, for the grade is made for something else.
    """
    if question.start_speed is None:
        check_grade(material.group, grade)
        start = start_of(material.group, grade)
    else:
        feed = insert.cut.feed.usual
        if question.feeds is not None:
            # The box states its start speed at the middle of its own window.
            feed = sum(question.feeds) / 2
        start = stated_start(question.start_speed, feed, depth)
    return for_conditions(start, question.conditions, material.group)
