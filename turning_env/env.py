"""The single environment, and the specification of the task.

The other ids are specified in ``tasks.py`` and ``family_env.py``; ``batch/driver.py`` runs the
steps.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import logger
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env.batch.driver import Batch, Jobs, action_space, checked_seed, observation_space
from turning_env.info import Info, info_of
from turning_env.physics.quantities import ROW
from turning_env.scenario import Scenario, Source, presets
from turning_env.scenario.section import names_instead

_ONLY_ENV = np.ones(1, np.bool_)
# Constants, because a step takes 6 us, and a look-up of each field would take 1 % of it.
_REWARD = ROW.reward
_TERMINATED = ROW.terminated
_TRUNCATED = ROW.truncated


def check_options(options: Mapping[str, Any] | None, *allowed: str) -> None:
    """Raise ValueError if an option of ``reset`` is not allowed; Minari's options pass."""
    for name in options or ():
        if name in allowed or str(name).startswith("minari_"):
            continue
        if allowed:
            advice = names_instead(str(name), allowed, "")
        else:
            advice = "there are none; pass the scenario to gymnasium.make"
        raise ValueError(f"reset has no option {name!r}; {advice}")


def steps_of_spec(scenario: Scenario) -> int | None:
    """Return the number of steps that a specification states; None if it states none.

    ``gymnasium.make(spec)`` truncates after it. So that it does not report the end of the last part
    as a truncation, there is one step more if a step is a part. No job of a family has it, because
    jobs last differently long.
    """
    steps = scenario.max_episode_steps
    if steps is not None and scenario.control.action == "part":
        return steps + 1
    return steps


class BaseEnv:
    """Base of the single and the vector environment: a batch, its specification and its viewer."""

    _spec: EnvSpec | None = None
    # A ``turning_env.rendering.viewer.Viewer``, whose libraries are optional.
    _viewer: Any = None

    def _set_up(self, batch: Batch, render_mode: str | None, rendered_envs: int) -> None:
        """Take the batch that is stepped, and make a viewer of its first environments if asked."""
        self._batch = batch
        self.scenario = batch.scenario
        self.render_mode = render_mode
        if render_mode is not None:
            # Imported when it is needed: Pillow and pygame are optional.
            from turning_env.rendering.viewer import Viewer

            self._viewer = Viewer(cast(Any, self), batch, rendered_envs)

    @property
    def spec(self) -> EnvSpec | None:
        """The specification that made this environment.

        It serialises to JSON and makes the same environment anywhere.
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else self._portable(spec)

    def _portable(self, spec: EnvSpec) -> EnvSpec:
        """Return a specification that holds values instead of paths, and the number of steps."""
        jobs = self._batch.jobs
        kwargs = dict(spec.kwargs)
        # make_vec passes it on, and leaves the specification's own as it was.
        steps = kwargs.pop("max_episode_steps", spec.max_episode_steps)
        if "scenario" in kwargs and kwargs["scenario"] not in presets():
            kwargs["scenario"] = self.scenario.portable()
        if jobs is not None and "family" in kwargs:
            kwargs["family"] = jobs.family.portable()
        if "autoreset_mode" in kwargs:
            kwargs["autoreset_mode"] = AutoresetMode(kwargs["autoreset_mode"]).value
        if steps is None and jobs is None:
            steps = steps_of_spec(self.scenario)
        return replace(spec, kwargs=kwargs, max_episode_steps=steps)

    def render(self) -> Any:
        """Return a frame in mode "rgb_array"; show it in the window in mode "human".

        A frame is uint8 of shape (640, 960, 3).
        """
        if self._viewer is None:
            logger.warn(
                "without a render mode, render() does nothing: "
                'make the environment with render_mode="rgb_array"'
            )
            return None
        return self._viewer.render()


class RoughTurningEnv(BaseEnv, gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Rough turning of steel bars with one carbide edge; the policy sets cutting speed and feed.

    ## Description

    A lathe roughs an endless row of bars until its cutting edge (one corner of an insert, here
    "edge") is worn out or breaks. Each bar begins with a short approach through air. The agent sets
    cutting speed (vc) and feed (f) once per control interval. Flank wear (VB), thrust force and
    spindle power follow the machinability models of Alaskari and Oraby (2018) for 709M40 steel and
    GC435 inserts. Spindle and feed servo lag behind their commands. Hardness and depth of cut (ap)
    vary from bar to bar and along every bar. Inserts differ in wear and strength. Measured power
    and force are noisy.

    ## Action space

    `Box(-1, 1, (2,), float32)`; other scenarios take 1 to 10 numbers or more (see
    `turning_env.tasks`). Values outside -1..1 are clipped; NaN and infinity raise an error.

    | Index | Action | -1 | 1 |
    |---|---|---|---|
    | 0 | cutting speed | commanded speed divided by exp(0.15) | commanded speed times exp(0.15) |
    | 1 | feed | commanded feed divided by exp(0.40) | commanded feed times exp(0.40) |

    Commands are kept within 50-200 m/min and 0.06-0.60 mm/rev. With `control.action = "set_point"`
    the action maps linearly onto these ranges instead.

    ## Observation space

    `Box(float32)` with 11 entries of order one: the readings of a CNC control. True wear, hardness
    and depth are hidden.

    | Index | Entry | Meaning | Range |
    |---|---|---|---|
    | 0 | power | measured power: `5 * (power / limit at this speed - 1)` | -5 to 15 |
    | 1 | thrust_force | measured thrust force: `5 * (force / limit - 1)` | -5 to 15 |
    | 2 | cutting_speed | actual cutting speed, log scale, -1 lowest, 1 highest | -1 to 1 |
    | 3 | feed | actual feed, log scale, -1 lowest, 1 highest | -1 to 1 |
    | 4 | commanded_cutting_speed | commanded cutting speed, likewise | -1 to 1 |
    | 5 | commanded_feed | commanded feed, likewise | -1 to 1 |
    | 6 | cutting_time | log(1 + cutting time of the edge in min) | 0 to 12 |
    | 7 | nominal_wear | wear predicted by the nominal model over the criterion | 0 to 4 |
    | 8 | power_ratio | measured power: `5 * (power / predicted power - 1)` | -5 to 15 |
    | 9 | force_ratio | measured thrust force: `5 * (force / predicted force - 1)` | -5 to 15 |
    | 10 | cutting | 1 in metal, 0 in air | 0 to 1 |

    Some scenarios add an entry: `roughness_reference` if a roughness is to be held, `probed_depth`
    if blanks are probed, `spindle_heat` if the spindle may be overloaded for a short time,
    `removed_wear` if edges are inspected, `tangles` if stops for tangled chips are observed.
    With `sensors.observes_all`, the hidden state follows:
    `hardness`, `depth_of_cut`, `wear`, `wear_factor` and `edge_strength`.

    ## Reward

    The sum of these terms [s of machine time]; `info` holds each:

    | Term | Value |
    |---|---|
    | reward_metal | + metal removed in the step / reference removal rate (115 cm3/min) |
    | reward_time | - the step's time |
    | reward_edge | - price of an edge (3 min) and its change (2 min) * used share of its life |
    | reward_overload | - overload price (10) * relative excess over 1500 N and 7 kW, over time |
    | reward_breakage | - on breakage: price of the edge's remaining life, and 10 min downtime |

    ## Starting state

    The episode starts with a fresh edge before the first bar's approach, at vc = 125 m/min and
    f = 0.25 mm/rev. Seed and episode determine insert, edge strength and all bars: `reset(seed=s)`
    starts episode 0 of seed s, `reset()` the next episode.

    ## Episode end

    Terminated when the flank wear reaches the criterion (0.3 mm) or the thrust force exceeds the
    edge's strength; the step ends there. Truncated after 60 min of machine time.

    ## Info

    After `reset` and `step`, true values at the step's end: `cutting_speed` and
    `commanded_cutting_speed` [m/min], `feed` and `commanded_feed` [mm/rev], `spindle_speed`
    [rev/min], `feed_velocity` [mm/min], `torque` [N m], `path` [mm], `bar` [-], `cutting` (bool),
    `depth_of_cut` [mm] and `hardness` [-] (0 in air), `cutting_time` [min], `used_life` [-], `wear`
    [mm], `wear_factor` [-], `edge_strength` [N], `thrust_force` and `measured_thrust_force` [N],
    `power` and `measured_power` [kW], `measured_servo_current` [A], `roughness` and
    `roughness_reference` [um], `probed_depth` [mm], `spindle_load` and `spindle_heat` [-] (0 where
    they do not apply), `broken` and `finished` (bool).

    Over the step: `time`, `engaged_time`, `stopped_time`, `overload_time`, `severe_overload_time`,
    `overload_2_percent_time` and `overload_10_percent_time` [s], `mean_thrust_force` [N] and
    `mean_power` [kW] while cutting, `removed` [cm3], `passes`, `edges_used` and `edges_broken` [-],
    `roughness_deviation` (integral of the relative deviation) [s], `excess` = `excess_force` +
    `excess_power` (mean relative excess over each limit [-], positive means violated), the `cost`
    [s], and the terms of the reward [s], with `reward_roughness`, which is 0 here.

    ## Constraint

    With `info["cost"]`, the task is a constrained Markov decision process (CMDP). The cost of a
    step is `severe_overload_time - 0.05 * engaged_time` [s], with the scenario's
    `limits.overload_allowance` of 0.05. A policy is feasible if the sum of an episode's costs is at
    most 0 in expectation over seeds. The leaderboard decides by the same constraint, pooled over
    its seeds. An algorithm that takes the constraint should learn from `reward -
    info["reward_overload"]`, or overload is paid for twice.

    ## Arguments

    `scenario`: the name of a preset (`turning_env.presets()`), the path of a TOML file, a dict of
    the values that differ from the defaults or from its `base`, or a `Scenario`. It sets every
    number named above.

        gymnasium.make(
            "turning_env:RoughTurning-v0",
            scenario={"base": "forging", "limits": {"power": 9.0}},
        )

    `render_mode`: `None`, `"rgb_array"` (`render()` returns a frame, uint8 of shape (640, 960, 3))
    or `"human"` (a window shows every step); with `gymnasium.make` also `"rgb_array_list"`. Drawing
    needs `pip install pillow pygame-ce`. A frame shows the bar with its hidden hardness and
    allowance, the tool, power, force and wear against their limits, and the operating map of speed
    and feed.

    ## Spec

    Store `env.spec` with `to_json`: it holds a preset's name or values, never a path, so it makes
    the same environment anywhere. `gymnasium.make(env.spec)` adds a `TimeLimit` of
    `spec.max_episode_steps`, the largest number of steps, 3600, at which the environment truncates
    itself. Pass `max_episode_steps=-1` if you make the spec with another scenario.

    ## Registered ids

    `turning_env.tasks` and `turning_env.FamilyEnv` (many lathes with wrong nominal models) specify
    the other ids.
    `turning_env.SPLITS` names presets that show how a policy generalises.

    Raises:
        ScenarioError: the scenario cannot be loaded; the message names the field, its value and
            what is allowed.
        ValueError: an action is not finite, a seed is not a whole number from 0 to 2**64 - 1, or an
            option is not allowed.
        gymnasium.error.Error: `step` or `render` before `reset`, `step` after the episode has ended
            (ResetNeeded); rendering lacks a package (DependencyNotInstalled) or a display; the
            window was closed by hand (ClosedEnvironmentError).
    """

    # Gymnasium declares it as a class attribute.
    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 30}  # noqa: RUF012 - see above

    _PRESET = "rough_turning"

    def __init__(
        self, scenario: Source | Jobs | None = None, render_mode: str | None = None
    ) -> None:
        source = self._PRESET if scenario is None else scenario
        self._set_up(Batch(source, 1, single=True), render_mode, rendered_envs=1)
        self.observation_space = observation_space(self.scenario, self._batch.context_size)
        self.action_space = action_space(self.scenario)
        self._under_way = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Info]:
        """Start episode 0 of ``seed``, or without a seed the next episode of the present one.

        There are no options.
        """
        check_options(options)
        batch = self._batch
        if seed is not None:
            seed = checked_seed(seed, 0)
        super().reset(seed=seed)
        if seed is None and not batch.seeded:
            seed = int(self.np_random.integers(2**63))
        if seed is not None:
            batch.seed(0, seed)
        batch.start(_ONLY_ENV)
        self._under_way = True
        if self._viewer is not None:
            self._viewer.note()
        return batch.observation.copy(), batch.info(0)

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, Info]:
        """Run one step. See the class's description for shapes, units and errors."""
        if not self._under_way:
            raise ResetNeeded("call reset() first: no episode is under way")
        batch = self._batch
        try:
            batch.step(action)
        except ValueError as error:
            (size,) = self.action_space.shape or ()
            numbers = "1 finite number" if size == 1 else f"{size} finite numbers"
            raise ValueError(f"an action must be {numbers}, got {action!r}") from error
        if self._viewer is not None:
            self._viewer.note()
        # A list, because Python reads its numbers in a fraction of the time of an array's.
        report = batch.report.tolist()
        terminated = report[_TERMINATED] != 0.0
        truncated = report[_TRUNCATED] != 0.0
        self._under_way = not (terminated or truncated)
        info = info_of(report)
        if batch.jobs is not None:
            info["job"] = int(batch.job_numbers[0])
        return batch.observation.copy(), report[_REWARD], terminated, truncated, info

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()
