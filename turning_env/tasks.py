"""Specifications of the ids beside ``RoughTurning-v0``, each on a preset of its own. The transition is the same.

``RoughTurning-v0`` also has shift splits, presets that show how policies made for it do elsewhere: ``turning_env.SPLITS``.
"""

from turning_env.env import RoughTurningEnv
from turning_env.scenario import Source


class PaperEnv(RoughTurningEnv):
    """``RoughTurning-Paper-v0``: the published simulation of the grid search (Alaskari and Oraby 2018).

    Differs from ``RoughTurningEnv`` by the preset `paper`: control intervals of one minute, set points (the action maps linearly
    onto 50-200 m/min and 0.06-0.60 mm/rev), no disturbance, no noise, no lag, no air, an edge that does not break, and wear by
    the paper's clock-time rule. That rule can be gamed by idling through the first step: an agent's return here says nothing
    of machining.

    ## Version history

    * v0: initial version.
    """

    def __init__(self, scenario: Source = "paper", render_mode: str | None = None) -> None:
        super().__init__(scenario, render_mode)


class OverrideEnv(RoughTurningEnv):
    """``RoughTurning-Override-v0``: hold the spindle load by feed override, and finish early (fuzzy override paper).

    ## Description

    One pass over a stepped, slightly eccentric bar of steel E295 on a 9 kW lathe, spindle at 710 rev/min, programmed feed
    0.4 mm/rev. The depth of cut steps through 1, 2, 3, 1 and 3 mm in sections of 20 mm, and ripples by 2 % every four
    turns; depth and hardness vary besides. Every 12 ms, an interpolator's cycle, the policy sets the feed override. The
    target load is 60 % of 9 kW; what exceeds it is charged as overload, and so is time. The feed servo lags by 0.13 s.

    ## Action space

    `Box(-1, 1, (1,), float32)`: feed override, -1 is 0 %, 1 is 200 % of the programmed feed. At 0 %, 1 % is left.

    ## Observation space

    That of `RoughTurningEnv`; the power limit is the target load, 5.4 kW. The spindle load is power over 9 kW.

    ## Reward and end

    As for `RoughTurningEnv`; the metal is the same for whoever finishes, so that time, overload and the small use of the edge
    decide. Terminated when the bar is done (`info["finished"]`), worn or broken; truncated after 5 min.

    ## Version history

    * v0: initial version.
    """

    def __init__(self, scenario: Source = "override", render_mode: str | None = None) -> None:
        super().__init__(scenario, render_mode)


class SurfaceEnv(RoughTurningEnv):
    """``RoughTurning-Surface-v0``: hold roughness Ra at a changing reference by feed override (roughness control paper).

    ## Description

    Ck 45 steel, 610 rev/min, depth of cut 1 mm, programmed feed 0.2 mm/rev. Roughness follows the cutting force, Ra = 0.2401
    exp(0.0034 F) um; the force changes at random by up to 10 %, as hardness does along the bar. Every 10 ms the controller
    sets the feed override. The reference of Ra, 1.0 to 3.1 um, changes every 3.75 s. Feed servo 0.13 s; the force follows a
    changed chip within a turn. `thrust_force` stands for the paper's resultant cutting force.

    ## Action space

    `Box(-1, 1, (1,), float32)`: feed override, -1 is 0 %, 1 is 150 % of the programmed feed. At 0 %, 1 % is left.

    ## Observation space

    That of `RoughTurningEnv`, and one entry more: `roughness_reference`, -1 at the lowest, 1 at the highest, on a log scale.

    ## Reward and end

    `reward_roughness` is minus 10 times the relative deviation of Ra from its reference, integrated over time; metal is worth
    next to nothing, and time passes alike for all. Truncated after 15 s.

    ## Version history

    * v0: initial version.
    """

    def __init__(self, scenario: Source = "surface", render_mode: str | None = None) -> None:
        super().__init__(scenario, render_mode)


class ShiftEnv(RoughTurningEnv):
    """``RoughTurning-Shift-v0``: the most profit from two hours over many edges, which the policy changes in time.

    ## Description

    `RoughTurningEnv` without its end: an edge that is worn out or broken is changed, and the time that this takes passes
    within the step: 2 min, and 3 min more if it was worn out unannounced or 10 min more if it broke. The policy can
    change an edge before.

    ## Action space

    `Box(-1, 1, (3,), float32)`: cutting speed and feed as in `RoughTurningEnv`; above 0, the third changes the edge before
    the step's cut.

    ## Observation space

    That of `RoughTurningEnv`; cutting time and nominal wear are the present edge's.

    ## Reward and end

    As for `RoughTurningEnv`, but that the edge's price (3 min) holds no time to change it, since that passes, and that a
    discarded edge is charged whole. The return is the shift's profit. Truncated after 120 min.

    ## Version history

    * v0: initial version.
    """

    def __init__(self, scenario: Source = "shift", render_mode: str | None = None) -> None:
        super().__init__(scenario, render_mode)


class BatchEnv(RoughTurningEnv):
    """``RoughTurning-Batch-v0``: the cheapest way to rough a batch of blanks in passes (adaptive part programming paper).

    ## Description

    The adaptive part programming paper's laws, with handbook exponents: force as S^0.75 t, life as V^-5 S^-1.75 t^-0.75.
    `thrust_force` stands for the main cutting force, of at most 3000 N. Twenty blanks, cast by default (scenarios
    `batch_casting`, `batch_forging`, `batch_rolled`, `batch_welded`), whose size and hardness differ from the drawing's.
    One step turns one part: the action names the number of passes, the allowance that the path is made for, and speed and
    feed of each pass. Passes have equal depth, counted from the finished contour outwards: what the blank has beyond the
    path's allowance falls to the first pass, and where it has less, passes cut less, or air. An edge that is worn out or
    broken is changed, as in `ShiftEnv`. After each pass the tool returns, which takes 0.1 min.

    ## Action space

    `Box(-1, 1, (10,), float32)`

    | Index      | Action                       | -1          | 1                           |
    |------------|------------------------------|-------------|-----------------------------|
    | 0          | number of passes             | 1           | 4                           |
    | 1          | allowance of the path        | 0           | twice the drawing's (10 mm) |
    | 2, 4, 6, 8 | cutting speed of pass 1 to 4 | 60 m/min    | 240 m/min                   |
    | 3, 5, 7, 9 | feed of pass 1 to 4          | 0.06 mm/rev | 0.60 mm/rev                 |

    The four numbers of passes share the first action's range evenly.

    ## Observation space

    That of `RoughTurningEnv`, of the part before: power and force are means over its last pass, speed and feed are that
    pass's. One entry more, `probed_depth`: `5 * (mean allowance of the next blank / drawing's allowance - 1)`. With
    `sensors.probe = false` blanks are not probed and the entry is missing.

    ## Reward and end

    As for `ShiftEnv`. All of a blank's allowance is removed whatever the action, so that time, edges, overload and breakage
    decide. Terminated after twenty parts.

    ## Version history

    * v0: initial version.
    """

    def __init__(self, scenario: Source = "batch_casting", render_mode: str | None = None) -> None:
        super().__init__(scenario, render_mode)
