"""What is set and what it gives, in numbers."""

from PIL import Image, ImageDraw

from turning_env.rendering.lane import Lane
from turning_env.rendering.theme import CARD, INK, QUIET, RULE, Box, Pixels, put, write
from turning_env.scenario import Scenario


class Readings:
    """Writes what is set and what it gives."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._scenario, self._corner = scenario, (box[0] + 8, box[1] + 234)
        self._parts = scenario.control.action == "part"

    def draw(self, frame: Pixels, lane: Lane) -> None:
        """The numbers as they are now."""
        image = Image.new("RGB", (400, 78), CARD)
        ImageDraw.Draw(image).line((8, 0, 392, 0), fill=RULE)
        for number, (name, value, told) in enumerate(self._values(lane)):
            row, column = divmod(number, 2)
            left, y = 8 + 200 * column, 6 + 23 * row
            write(image, (left, y + 1), name, 12, QUIET)
            write(image, (left + 184, y), value, 13, INK if told else QUIET, "right")
        put(frame, image, self._corner)

    def _values(self, lane: Lane) -> list[tuple[str, str, bool]]:
        """Name, value, and whether the controller is told."""
        now, minutes = lane.now, max(lane.now["time"] / 60.0, 1e-9)
        rate = now["removed"] / minutes
        if self._parts:
            values = [
                ("passes", f"{now['passes']:.0f}", True),
                ("part's time", f"{now['time'] / 60.0:.2f} min", True),
                ("metal", f"{now['removed']:.0f} cm3", True),
                ("edges used", f"{now['edges_used']:.2f}", True),
            ]
            if self._scenario.sensors.probe:
                values.append(("next blank's probe", f"{now['probed_depth']:.2f} mm", True))
            return [*values, ("return of the part", f"{lane.reward:.0f} s", True)]
        override = self._scenario.control.action == "override"
        in_metal = now["cutting"] > 0.0
        return [
            ("cutting speed", f"{now['cutting_speed']:.0f} m/min", True),
            ("depth of cut", f"{now['depth_of_cut']:.2f} mm" if in_metal else "air", False),
            ("feed", f"{now['feed']:.3f} mm/rev", True),
            ("hardness", f"{now['hardness']:.2f} of nominal" if in_metal else "air", False),
            ("removal", f"{rate:.0f} cm3/min", True),
            ("override", f"{100 * now['commanded_feed'] / self._scenario.control.initial_feed:.0f} %", True)
            if override
            else ("spindle", f"{now['spindle_speed']:.0f} rev/min", True),
        ]
