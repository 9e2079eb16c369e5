"""The tasks: what each id asks, and which class specifies it.

    id                        class            actions      an episode
    RoughTurning-v0           RoughTurningEnv  speed, feed  one edge on unknown bars
    RoughTurning-Paper-v0     PaperEnv         speed, feed  one edge, without disturbances
    RoughTurning-Override-v1  OverrideEnv      feed         one pass: hold the spindle load
    RoughTurning-Surface-v1   SurfaceEnv       feed         15 s: hold a roughness
    RoughTurning-Shift-v0     ShiftEnv         + new edge   two hours, many edges
    RoughTurning-Batch-v0     BatchEnv         ten numbers  twenty blanks; a step is a part
    RoughTurning-Family-v1    FamilyEnv        + new edge   another lathe, about five edges

Print a specification with ``print(turning_env.tasks.ShiftEnv.__doc__)``, or with
``print(turning_env.RoughTurningEnv.__doc__)`` and ``print(turning_env.FamilyEnv.__doc__)``.

Each class below has its own preset; all share one transition. Whatever a specification leaves out
is as for ``RoughTurningEnv``.
"""

from turning_env.env import RoughTurningEnv

__all__: list[str] = []
"""``help`` shows the classes of ``__all__`` with all methods of Gymnasium, which hide the above."""


class PaperEnv(RoughTurningEnv):
    """``RoughTurning-Paper-v0``: the published simulation of the grid search.

    Source: Alaskari and Oraby 2018. Differs from ``RoughTurningEnv`` by the preset `paper`: control
    intervals of one minute; set points (the action maps linearly onto vc = 50-200 m/min and f =
    0.06-0.60 mm/rev); no disturbance, noise, lag or air; an edge that does not break; and wear by
    the paper's clock-time rule. A policy can game that rule by idling through the first step, so an
    agent's return here says nothing about machining.
    """

    _PRESET = "paper"


class OverrideEnv(RoughTurningEnv):
    """``RoughTurning-Override-v1``: hold the spindle load by feed override, and finish early.

    Source: fuzzy override paper. One pass over a stepped, slightly eccentric bar of steel E295 on a
    9 kW lathe, spindle at 710 rev/min, programmed feed 0.4 mm/rev. The depth of cut steps through
    1, 2, 3, 1 and 3 mm in sections of 20 mm, and ripples by 2 % every four turns. Depth and
    hardness also vary at random. The target load is 60 % of 9 kW, the observed power limit. At this
    one spindle speed it is also the share of torque, for every drive with a base speed of up to 710
    rev/min. The load lags behind the chip by a turn, 84 ms, and the feed servo by 0.02 s.

    **Action**, `Box(-1, 1, (1,), float32)`, every 12 ms, an interpolator's cycle: feed override,
    from 0 % (-1) to 200 % (1) of the programmed feed. Below 1 % it stays at 1 %.

    **Reward and end.** Every policy that finishes removes the same metal, so time, overload and a
    little edge life make the difference. Terminated when the bar is done (`info["finished"]`), or
    the edge is worn out or broken; truncated after 5 min.
    """

    _PRESET = "override"


class SurfaceEnv(RoughTurningEnv):
    """``RoughTurning-Surface-v1``: hold roughness Ra at a changing reference by feed override.

    Source: roughness control paper. Ck 45 steel, 610 rev/min, depth of cut 1 mm, programmed feed
    0.2 mm/rev. Roughness follows the cutting force: Ra = 0.2401 exp(0.0034 F) um. The force varies
    at random by up to 10 % with the hardness along the bar. The reference of Ra, 1.0 to 3.1 um,
    changes every 3.75 s. The feed servo lags by 0.13 s; the force follows a changed chip within a
    turn. `thrust_force` stands for the paper's resultant cutting force.

    **Action**, `Box(-1, 1, (1,), float32)`, every 10 ms: feed override, from 0 % (-1) to 150 % (1)
    of the programmed feed. Below 1 % it stays at 1 %. **Observation:** also `roughness_reference`,
    -1 at the lowest, 1 at the highest, on a log scale.

    **Reward and end.** `reward_roughness` is -10 times the relative deviation of Ra from its
    reference, integrated over time. In air no surface is made, and the deviation is 1. Metal is
    worth next to nothing, and all episodes take the same time: truncated after 15 s.
    """

    _PRESET = "surface"


class ShiftEnv(RoughTurningEnv):
    """``RoughTurning-Shift-v0``: earn the most profit in two hours, over many edges.

    The policy decides when to change an edge. The episode goes on when an edge ends. A worn-out or
    broken edge is changed within the step. A change takes 2 min, plus 3 min if the edge wore out
    without a command, or plus 10 min if it broke.

    **Action**, `Box(-1, 1, (3,), float32)`: cutting speed and feed as in `RoughTurningEnv`. If the
    third number is above 0, the edge is changed before the step's cut. **Observation:** cutting
    time and nominal wear are the present edge's.

    **Reward and end.** An edge costs 3 min only, because the time to change it passes. A discarded
    edge is charged whole. The return is the shift's profit. Truncated after 120 min.
    """

    _PRESET = "shift"


class BatchEnv(RoughTurningEnv):
    """``RoughTurning-Batch-v0``: rough a batch of blanks in passes at the least cost.

    Source: adaptive part programming paper, with handbook exponents: force ~ S^0.75 t, life ~ V^-5
    S^-1.75 t^-0.75. `thrust_force` stands for the main cutting force, at most 3000 N. An episode
    has twenty blanks, cast by default (scenarios `batch_casting`, `batch_forging`, `batch_rolled`,
    `batch_welded`); their size and hardness differ from the drawing's. The scenarios `batch_p20`,
    `batch_k20`, `batch_p30`, `batch_p01` and `batch_m20` are the paper's typical cases, which also
    limit radial force, torque and roughness. One step turns one part. Passes have equal depth,
    counted from the finished contour outwards. The first pass also takes what the blank has beyond
    the path's allowance. If the blank has less, the first passes cut less, or air. Edges are
    changed as in `ShiftEnv`. After each pass the tool returns, which takes 0.1 min.

    **Action**, `Box(-1, 1, (10,), float32)`: number of passes (the range is divided evenly among 1,
    2, 3 and 4); allowance of the path, 0 (-1) to twice the drawing's (1), 10 mm; then, for each of
    four passes, cutting speed, 60 to 240 m/min, and feed, 0.06 to 0.60 mm/rev.

    **Observation**, of the part before: power and force are means over its last pass, speed and
    feed are that pass's. Beside these, `probed_depth`: `5 * (mean allowance of the next blank /
    drawing's allowance - 1)`, unless `sensors.probe = false`.

    **Reward and end.** As for `ShiftEnv`. Every action removes a blank's whole allowance, so time,
    edges, overload and breakage make the difference. Terminated after twenty parts.
    """

    _PRESET = "batch_casting"
