"""Write frames as a video, an animated GIF or a still, by the file's suffix; whole or not at all."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leaderboard.result import ResultError
from turning_env.files import replace_file

Frame = NDArray[np.uint8]
"""Shape (height, width, 3), of even height and width."""


def write(frames: Iterator[Frame], path: Path, frames_per_second: int) -> None:
    """Write all frames, or of a still the last, to a file ending in ``.mp4``, ``.gif`` or ``.png``.

    Raises:
        ResultError: the file ends otherwise.
        OSError: it cannot be written.
    """
    check_suffix(path)
    replace_file(path, lambda partial: _WRITERS[path.suffix](frames, partial, frames_per_second))


def check_suffix(path: Path) -> None:
    """Raise ResultError if no film can be written to a file of such a name."""
    if path.suffix not in _WRITERS:
        raise ResultError(f"{path} must end in one of {', '.join(_WRITERS)}")


def _write_video(frames: Iterator[Frame], path: Path, frames_per_second: int) -> None:
    from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter  # type: ignore[import-untyped]

    first = next(frames)
    height, width, _ = first.shape
    # Few bits are enough for areas of one colour; every player knows yuv420p.
    quality = ["-crf", "23", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    video: Any = FFMPEG_VideoWriter(str(path), (width, height), frames_per_second, "libx264", ffmpeg_params=quality)
    with video:
        video.write_frame(first)
        for frame in frames:
            video.write_frame(frame)


def _write_gif(frames: Iterator[Frame], path: Path, frames_per_second: int) -> None:
    from PIL import Image

    palette = Image.new("P", (1, 1))
    palette.putpalette([value for colour in _colours() for value in colour])
    first = Image.fromarray(next(frames))

    def reduced(frame: Image.Image) -> Image.Image:
        return frame.quantize(palette=palette, dither=Image.Dither.NONE)

    rest = (reduced(Image.fromarray(frame)) for frame in frames)
    # Viewers ignore pauses shorter than 2/100 s.
    pause = max(1000 // frames_per_second, 20)
    with path.open("wb") as file:  # Pillow alone would leave it open when interrupted
        reduced(first).save(file, "GIF", save_all=True, append_images=rest, duration=pause, loop=0, optimize=False)


def _colours() -> list[tuple[int, int, int]]:
    """Return the colours of which frames consist: one frame alone would lack some of later ones."""
    from turning_render import theme

    paints = [theme.BLUE, theme.ORANGE, theme.GREEN, theme.VERMILLION, theme.PURPLE, theme.INSERT, theme.LAND, theme.CHIP]
    shares = (1.0, 0.75, 0.5, 0.28, 0.22, 0.07)
    grounds = [theme.CARD, theme.PAPER, theme.RULE, theme.ALLOWANCE]
    tints = [theme.mixed(theme.HARD_TINT, step / 16, theme.SOFT_TINT) for step in range(17)]
    greys = [theme.mixed(theme.INK, step / 16, theme.PAPER) for step in range(1, 17)]
    on_allowed = [theme.mixed(theme.INK, step / 8, theme.mixed(theme.ALLOWED, 0.22)) for step in range(8)]
    return [*grounds, *tints, *greys, *on_allowed, *(theme.mixed(paint, share) for paint in paints for share in shares)]


def _write_still(frames: Iterator[Frame], path: Path, frames_per_second: int) -> None:
    from PIL import Image

    *_, last = frames
    Image.fromarray(last).save(path, optimize=True)


_WRITERS: dict[str, Callable[[Iterator[Frame], Path, int], None]] = {
    ".mp4": _write_video,
    ".gif": _write_gif,
    ".png": _write_still,
}
