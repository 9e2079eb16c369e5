"""Film a policy, or two with the same seed side by side, or show one in a window.

python -m leaderboard.watch --policy rescaled_grid_search --beside grid_search --out cut.mp4
python -m leaderboard.watch --env RoughTurning-Family-v1 --policy self_tuning --out job.gif
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError
from numpy.typing import NDArray

from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import ONNX_SUFFIX
from leaderboard.family import episode_of, family_task
from leaderboard.policies import agents, named
from leaderboard.result import ResultError, Task
from turning_env import ALL_IDS, FAMILY_ID, IDS, Scenario
from turning_env.console import DONE, Parser, described, exits, positive
from turning_env.files import replace_file
from turning_env.progress import progress
from turning_env.scenario.arguments import environment_id

Frame = NDArray[np.uint8]  # shape (height, width, 3), of even height and width
_CAPTION_HEIGHT = 30  # [px]
_GAP = 8  # [px], between two policies


class Show:
    """One policy's episode on the only seed or job of a task, shown step by step."""

    def __init__(self, spec: PolicySpec, task: Task, render_mode: str) -> None:
        self._label = spec.label
        (seed,) = task.seeds
        episode = episode_of(spec, task.scenario, seed)
        arguments = episode.arguments
        self.env: Any = gymnasium.make(task.env_id, **arguments, render_mode=render_mode)
        self._policy = episode.policy
        self._observation, _ = self.env.reset(seed=seed)
        self._policy.reset(np.ones(1, np.bool_))
        self.ended = False

    def advance(self) -> None:
        """Play one step.

        Raise ValueError if the policy's action has the wrong shape or is not finite.
        """
        actions = self._policy.act(self._observation[None])
        self._observation, _, terminated, truncated, _ = self.env.step(actions[0])
        self.ended = terminated or truncated

    def frame(self) -> Frame:
        """Return a frame of the present state, under the policy's name."""
        from PIL import Image

        from turning_env.rendering.theme import PAPER, write

        picture: Frame = self.env.render()
        caption = Image.new("RGB", (picture.shape[1], _CAPTION_HEIGHT), PAPER)
        write(caption, (16, 10), f"policy: {self._label}", 15)
        return np.concatenate([np.asarray(caption), picture])


@exits(ValueError, gymnasium.error.Error, interrupted="interrupted; nothing was written")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    options = _parser().parse_args(arguments)
    try:
        _watch(options)
    except ClosedEnvironmentError:
        print("the window was closed", file=sys.stderr)
    return DONE


def _watch(options: argparse.Namespace) -> None:
    if options.human and options.beside:
        raise ResultError("--human shows one policy: give --out to see two beside each other")
    if not options.human and options.out.suffix not in _WRITERS:
        raise ResultError(f"{options.out} must end in one of {', '.join(_WRITERS)}")
    names = [options.agent or options.policy]
    if options.beside:
        names.append(options.beside)
    task = _task(options)
    render_mode = "human" if options.human else "rgb_array"
    shows = [Show(policy(name, task), task, render_mode) for name in names]
    try:
        if options.human:
            for _ in steps(shows, options.steps, every=1):
                pass
        else:
            _write(shows, options.out, max_steps=options.steps, every=options.every)
            print(f"wrote {options.out}")
    finally:
        for show in shows:
            show.env.close()


def _task(options: argparse.Namespace) -> Task:
    """Return the task of which the seed, or the job, is watched."""
    seeds = [options.seed]
    if options.env == FAMILY_ID:
        split = options.split or "train"
        task = family_task(options.scenario or "shop", split, count=max(options.seed, 0) + 1)
        return task.model_copy(update={"seeds": seeds})
    if options.split:
        raise ResultError(f"--split is of {FAMILY_ID}, not of {options.env}")
    scenario = Scenario.load(options.scenario or IDS[options.env])
    return Task(env_id=options.env, scenario=scenario, seeds=seeds)


def _write(shows: Sequence[Show], path: Path, max_steps: int | None, every: int) -> None:
    """Write the film of some shows side by side, or a still of its end."""
    write = _WRITERS[path.suffix]
    film = frames(shows, max_steps, every)
    rate = shows[0].env.metadata["render_fps"]
    replace_file(path, lambda partial: write(film, partial, rate))


def policy(name: str, task: Task) -> PolicySpec:
    """Return the rule of a name, or the agent of a file or a run's folder.

    Raise ResultError if it needs more than observations.
    """
    if name.endswith(ONNX_SUFFIX) or Path(name).is_dir():
        return agents([Path(name)], task)[0]
    (spec,) = named([name], task)
    if spec.kind == "oracle":
        raise ResultError(f"{name} cannot be watched: only what acts on observations can")
    return spec


def steps(shows: Sequence[Show], max_steps: int | None, every: int) -> Iterator[int]:
    """Play until all episodes have ended, or ``max_steps`` steps have been played.

    Yield the number of steps played: 0 at the start, then after every ``every`` steps, and at the
    end.
    """
    yield 0
    done = 0
    is_over = False
    with progress(total=max_steps, unit="step", dynamic_ncols=True) as bar:
        while not is_over:
            for show in shows:
                if not show.ended:
                    show.advance()
            done += 1
            bar.update()
            is_over = done == max_steps or all(show.ended for show in shows)
            if is_over or done % every == 0:
                yield done


def frames(shows: Sequence[Show], max_steps: int | None, every: int) -> Iterator[Frame]:
    """Yield frames side by side; an episode that has ended stays at its last frame."""
    for _ in steps(shows, max_steps, every):
        first, *others = [show.frame() for show in shows]
        gap = np.full((len(first), _GAP, 3), 255, np.uint8)  # white
        parts = [first]
        for frame in others:
            parts += [gap, frame]
        yield np.concatenate(parts, axis=1)


def _write_video(frames: Iterator[Frame], path: Path, frames_per_second: int) -> None:
    from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter  # type: ignore[import-untyped]

    first = next(frames)
    height, width, _ = first.shape
    # Few bits are enough for areas of one colour; every player knows yuv420p.
    quality = ["-crf", "23", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    video: Any = FFMPEG_VideoWriter(
        str(path), (width, height), frames_per_second, "libx264", ffmpeg_params=quality
    )
    with video:
        video.write_frame(first)
        for frame in frames:
            video.write_frame(frame)


def _write_gif(frames: Iterator[Frame], path: Path, frames_per_second: int) -> None:
    from PIL import Image

    # All colours of the film are in its first frame. This method keeps rare ones, too.
    first = Image.fromarray(next(frames)).quantize(
        method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
    )
    rest = (
        Image.fromarray(frame).quantize(palette=first, dither=Image.Dither.NONE) for frame in frames
    )
    # Viewers ignore pauses shorter than 2/100 s.
    pause = max(1000 // frames_per_second, 20)  # [ms]
    with path.open("wb") as file:  # Pillow alone would leave it open when interrupted
        first.save(
            file, "GIF", save_all=True, append_images=rest, duration=pause, loop=0, optimize=True
        )


def _write_still(frames: Iterator[Frame], path: Path, frames_per_second: int) -> None:
    from PIL import Image

    *_, last = frames
    Image.fromarray(last).save(path, optimize=True)


_WRITERS: dict[str, Callable[[Iterator[Frame], Path, int], None]] = {
    ".mp4": _write_video,
    ".gif": _write_gif,
    ".png": _write_still,
}
"""Functions that write a video, an animated GIF or a still of the end, by the file's suffix."""


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m leaderboard.watch", **described(__doc__))
    parser.add_argument(
        "--env",
        type=environment_id,
        choices=ALL_IDS,
        default="RoughTurning-v0",
        help="the environment's id (default: RoughTurning-v0)",
    )
    parser.add_argument(
        "--scenario", metavar="PRESET_OR_TOML", help="scenario or family instead of the id's own"
    )
    parser.add_argument("--split", metavar="NAME", help="split of a family (default: train)")
    policies = parser.add_mutually_exclusive_group(required=True)
    policies.add_argument("--policy", metavar="NAME", help="a rule-based controller")
    policies.add_argument(
        "--agent", metavar="AGENT", help="an agent: an ONNX file, or a run folder of your own"
    )
    parser.add_argument(
        "--beside",
        metavar="NAME_OR_AGENT",
        help="another policy or agent, on the same bars, beside the first",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="determines the edge and the bars, or is the job's number (default: 0)",
    )
    parser.add_argument(
        "--steps", type=positive, metavar="N", help="at most so many steps (default: the episode)"
    )
    outputs = parser.add_mutually_exclusive_group(required=True)
    outputs.add_argument(
        "--out", type=Path, metavar="FILE", help="an .mp4 or .gif of it all, or a .png of its end"
    )
    outputs.add_argument("--human", action="store_true", help="show it in a window")
    parser.add_argument(
        "--every",
        type=positive,
        default=1,
        metavar="N",
        help="film every so many steps (default: 1)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
