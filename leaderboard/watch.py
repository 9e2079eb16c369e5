"""Film a policy, or two with the same seed side by side, or show one in a window.

python -m leaderboard.watch --env RoughTurning-v0 --policy rescaled_grid_search --beside grid_search --out cut.mp4
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError
from tqdm import tqdm

from leaderboard import film
from leaderboard.__main__ import positive
from leaderboard.film import Frame
from leaderboard.policies import agents, named
from leaderboard.result import ResultError, Task
from train.agents.agent_file import ONNX_SUFFIX
from turning_env import IDS, Scenario
from turning_env.console import described, exits
from turning_env.scoring.policy import PolicySpec

_CAPTION_HEIGHT = 30
_GAP = 8


class Show:
    """One policy's episode, seen step by step.

    Args:
        spec: the policy.
        env_id: of the environment.
        scenario: of the environment.
        seed: determines the edge and the bars.
        render_mode: "rgb_array" or "human".

    Attributes:
        ended: whether the episode has ended.
    """

    def __init__(self, spec: PolicySpec, env_id: str, scenario: Scenario, seed: int, render_mode: str) -> None:
        self._label = spec.label
        self.env: Any = gymnasium.make(env_id, scenario=scenario, render_mode=render_mode)
        self._policy = spec.make(1)
        self._observation, _ = self.env.reset(seed=seed)
        self._policy.reset(np.ones(1, np.bool_))
        self.ended = False

    def advance(self) -> None:
        """Play one step.

        Raises:
            ValueError: the policy's action has the wrong shape or is not finite.
        """
        self._observation, _, terminated, truncated, _ = self.env.step(self._policy.act(self._observation[None])[0])
        self.ended = terminated or truncated

    def frame(self) -> Frame:
        """Return a frame of the present state, under the policy's name."""
        from PIL import Image

        from turning_render.theme import PAPER, write

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
    return 0


def _watch(options: argparse.Namespace) -> None:
    if options.human and options.beside:
        raise ResultError("--human shows one policy: give --out to see two beside each other")
    if not options.human:
        film.check_suffix(options.out)  # before anything is played
    scenario = Scenario.load(options.scenario or IDS[options.env])
    names = [options.agent or options.policy, *([options.beside] if options.beside else [])]
    task = Task(env_id=options.env, scenario=scenario, seeds=[options.seed])
    specs = [policy(name, task) for name in names]
    mode = "human" if options.human else "rgb_array"
    shows = [Show(spec, options.env, scenario, options.seed, mode) for spec in specs]
    try:
        if options.human:
            for _ in steps(shows, options.steps, 1):
                pass
        else:
            film.write(frames(shows, options.steps, options.every), options.out, shows[0].env.metadata["render_fps"])
            print(f"wrote {options.out}")
    finally:
        for show in shows:
            show.env.close()


def policy(name: str, task: Task) -> PolicySpec:
    """Return the rule of a name, or the agent of an ONNX file or a run's folder.

    Raises:
        ResultError: there is none, it cannot play the scenario, or it is an oracle, which knows more than observations.
    """
    if name.endswith(ONNX_SUFFIX) or Path(name).is_dir():
        return agents([Path(name)], task)[0]
    (spec,) = named([name], task)
    if spec.kind == "oracle":
        raise ResultError(f"{name} cannot be watched: only what acts on observations can")
    return spec


def steps(shows: Sequence[Show], most: int | None, every: int) -> Iterator[int]:
    """Play until all have ended, at most so many steps; yields at the start, after every so many, and at the end."""
    yield 0
    done = 0
    with tqdm(total=most, unit="step", dynamic_ncols=True, disable=None) as bar:
        while done != most and not all(show.ended for show in shows):
            for show in shows:
                if not show.ended:
                    show.advance()
            done += 1
            bar.update()
            if done % every == 0 or done == most or all(show.ended for show in shows):
                yield done


def frames(shows: Sequence[Show], most: int | None, every: int) -> Iterator[Frame]:
    """Yield frames side by side; an episode that has ended stands still."""
    for _ in steps(shows, most, every):
        pictures = [show.frame() for show in shows]
        gap = np.full((len(pictures[0]), _GAP, 3), 255, np.uint8)
        frame: Frame = np.concatenate([part for picture in pictures for part in (gap, picture)][1:], axis=1)
        yield frame


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m leaderboard.watch", **described(__doc__))
    parser.add_argument("--env", choices=IDS, default="RoughTurning-v0", help="the environment's id (default: RoughTurning-v0)")
    parser.add_argument("--scenario", metavar="PRESET_OR_TOML", help="scenario instead of the id's own preset")
    who = parser.add_mutually_exclusive_group(required=True)
    who.add_argument("--policy", metavar="NAME", help="a rule-based controller")
    who.add_argument("--agent", metavar="AGENT", help="an agent: an ONNX file, or a run folder of your own")
    parser.add_argument("--beside", metavar="NAME_OR_AGENT", help="another policy or agent, on the same bars, beside the first")
    parser.add_argument("--seed", type=int, default=0, help="determines the edge and the bars (default: 0)")
    parser.add_argument("--steps", type=positive, metavar="N", help="at most so many steps (default: the episode)")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", type=Path, metavar="FILE", help="an .mp4 or .gif of it all, or a .png of its end")
    where.add_argument("--human", action="store_true", help="show it in a window")
    parser.add_argument("--every", type=positive, default=1, metavar="N", help="film every so many steps (default: 1)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
