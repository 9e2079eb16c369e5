"""The edge, with the land that is worn, and how much of its life is used."""

import math

from PIL import Image, ImageDraw

from turning_env.rendering.lane import Lane
from turning_env.rendering.theme import CARD, FAINT, GREEN, INK, INSERT, LAND, OVER, QUIET, RULE, SCALE, Box, Pixels, put, write
from turning_env.scenario import Scenario


class EdgeView:
    """Draws the edge with the land that is worn, and how much of its life is used."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._scenario, self._corner = scenario, (box[0] + 8, box[1] + 146)

    def draw(self, frame: Pixels, lane: Lane) -> None:
        """The edge as it is now."""
        now, criterion = lane.now, self._scenario.tool.wear_criterion
        image = Image.new("RGB", (400, 86), CARD)
        large = Image.new("RGB", (184, 172), CARD)
        draw = ImageDraw.Draw(large)
        broken = now["broken"] > 0.0
        draw.polygon([(20, 18), (164, 18), (150, 160), (34, 160)], fill=INSERT, outline=INK, width=2)
        land = 84.0 * min(now["wear"] / criterion, 1.25)
        if land > 1.0:  # a ragged border, as worn lands have
            ragged = [(24 + 0.12 * land + 4.7 * k, 18 + land * (0.86 + 0.14 * math.sin(2.3 * k))) for k in range(28)]
            draw.polygon([(20, 18), (164, 18), *reversed(ragged)], fill=LAND)
        draw.line((20, 18, 164, 18), fill=INK, width=4)
        for x in range(14, 176, 14):
            draw.line((x, 102, x + 8, 102), fill=OVER, width=3)
        if broken:
            draw.polygon([(110, 10), (176, 10), (176, 92), (150, 70), (142, 44), (122, 38)], fill=CARD)
            draw.line([(110, 18), (122, 38), (142, 44), (150, 70), (160, 86)], fill=OVER, width=4, joint="curve")
        share = min(now["used_life"], 1.0)
        image.paste(large.reduce(SCALE))
        draw = ImageDraw.Draw(image)
        draw.rectangle((100, 65, 390, 73), fill=RULE)
        if share > 0.0:
            colour = OVER if broken or share >= 1.0 else GREEN
            draw.rectangle((100, 65, 100 + 290 * share, 73), fill=colour)
        title = "edge" if self._scenario.control.edge_changes == "end" else f"edge {lane.edge + 1}"
        write(image, (100, 2), title, 13)
        write(image, (100, 22), f"flank wear {now['wear']:.3f} of {criterion:g} mm", 12)
        write(image, (100, 43), f"life used {100 * now['used_life']:.0f} %", 12)
        told = f"{'broke' if broken else 'breaks'} at {now['edge_strength']:.0f} N"
        write(image, (390, 2), told, 11, OVER if broken else FAINT, "right")
        write(image, (390, 43), f"cutting for {now['cutting_time']:.2f} min", 12, QUIET, "right")
        put(frame, image, self._corner)
