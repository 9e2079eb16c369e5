"""All figures, in the order of the index."""

from papers.figures import blanks, contours, life, optima, override, rivals, roughness, servo, surfaces
from papers.figures.plate import Plate

_GRID_SEARCH = (*optima.PLATES, *contours.PLATES, *surfaces.PLATES, *life.PLATES, *rivals.PLATES)
PLATES: dict[str, Plate] = {
    plate.name: plate
    for plate in (
        *sorted(_GRID_SEARCH, key=lambda plate: plate.name),
        *override.PLATES,
        *roughness.PLATES,
        *blanks.PLATES,
        *servo.PLATES,
    )
}
"""By name; a further figure is added to its group's file."""


def chosen(names: list[str] | None) -> list[Plate]:
    """The figures of some names in the order of the index; without names, all.

    Raises:
        ValueError: a name is that of no figure; says which there are.
    """
    unknown = [name for name in names or () if name not in PLATES]
    if unknown:
        raise ValueError(f"there is no figure {', '.join(unknown)}; there are {', '.join(PLATES)}")
    return [plate for name, plate in PLATES.items() if names is None or name in names]
