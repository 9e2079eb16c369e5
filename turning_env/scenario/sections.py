"""The sections of a scenario: every field with its default, range, unit and source.

Defaults are those of ``RoughTurning-v0``: 709M40 (En 19) steel cut by a GC435 insert on a
Colchester Mascot lathe (Alaskari and Oraby 2018). If the papers state no value, the description
says "assumption". A field that is added later must have a neutral default, because the values that
differ from the defaults identify a scenario.
"""

from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.section import Section, quantity

MAX_DEPTHS = 64
_MIN_SECTION_DEPTH = 0.01  # of a section in metal [mm]
_MAX_SECTION_DEPTH = 50.0  # likewise
_ROUNDING = 1e-6  # relative error that the sum of the sections' lengths may have
"""Largest number of sections of different depth along a bar."""
MAX_DELAY = 4
"""Longest delay of commands [control intervals]."""
MAX_PASSES = 6
"""Largest number of passes of a part."""


class Material(Section):
    """Machinability of the work material with the tool material (default: 709M40 with GC435)."""

    wear: PowerLaw = PowerLaw(
        coefficient=0.00956410,
        cutting_speed=0.577,
        feed=0.168,
        depth_of_cut=0.15,
        time=0.245,
        hardness=0.5,
    )
    """Flank wear of a fresh edge under constant parameters [mm]. Exponents of depth of cut and
    hardness: assumptions."""
    thrust_force: PowerLaw = PowerLaw(
        coefficient=106580.08,
        cutting_speed=-0.484,
        feed=0.236,
        depth_of_cut=0.75,
        wear=1.1,
        hardness=0.75,
    )
    """Thrust force [N]. Exponents of depth of cut and hardness: assumptions."""
    power: PowerLaw = PowerLaw(
        coefficient=0.30338170,
        cutting_speed=0.820,
        feed=0.627,
        depth_of_cut=0.95,
        wear=0.342,
        hardness=0.75,
    )
    """Spindle power [kW]. Exponents of depth of cut and hardness: assumptions."""


class Tool(Section):
    """The cutting edge."""

    wear_criterion: float = quantity(
        0.3, 0.01, 5, "mm", "flank wear at which the edge is worn out (tool-life criterion)"
    )
    wear_rule: Literal["equivalent_time", "clock_time"] = "equivalent_time"
    """Accumulation of wear under changing parameters; "clock_time" is the grid search paper's
    rule."""
    wear_factor_spread: float = quantity(
        0.10, 0, 1, "-", "log standard deviation of wear of inserts (grid search paper, tests)"
    )
    edge_strength: float = quantity(
        2690,
        1,
        1e6,
        "N",
        "median thrust force that breaks an edge (assumption: read while T9 collapsed)",
    )
    edge_strength_spread: float = quantity(
        0.12, 0, 1, "-", "log standard deviation of the edge strength (assumption)"
    )
    nose_radius: float = quantity(
        0, 0, 100, "mm", "nose radius, which bounds the feed that is advised; 0: unknown"
    )
    overhang: float = quantity(
        0, 0, 1e4, "mm", "free length of the boring bar or holder, which bends in advice; 0: rigid"
    )
    shank_diameter: float = quantity(
        0, 0, 1000, "mm", "diameter of the holder's round shank, needed with overhang; 0: unknown"
    )
    shank_modulus: float = quantity(
        210_000, 1e3, 1e6, "N/mm2", "modulus of the shank (steel; carbide 600,000; handbooks)"
    )


class EdgeFailure(Section):
    """Wear and failures of the edge that the papers' laws leave out, as the defaults do."""

    temperature: PowerLaw = PowerLaw(
        coefficient=186.8, cutting_speed=0.4, feed=0.1, depth_of_cut=0.05, wear=0.25, hardness=0.4
    )
    """Temperature of the edge above the workshop [K]. 1000 K in test T9 of the grid search paper,
    when its edge collapsed; scale and exponents: assumptions."""
    collapse_temperature: float = quantity(
        0, 0, 1e4, "K", "temperature above which an edge collapses at once; 0: never"
    )
    tertiary_wear: float = quantity(
        0.25, 0.001, 5, "mm", "flank wear beyond which the rate of wear rises (assumption)"
    )
    tertiary_rate: float = quantity(
        0, 0, 100, "1/mm", "growth of the log rate over the flank wear beyond; 0: none"
    )
    chipping_rate: float = quantity(
        0, 0, 1e3, "1/min", "chipping rate of a worn-out edge loaded with its strength; 0: never"
    )
    chipping_load_exponent: float = quantity(
        3, 0, 20, "-", "exponent of thrust force over edge strength (assumption)"
    )
    chipping_wear_exponent: float = quantity(
        1, 0, 20, "-", "exponent of flank wear over the criterion (assumption)"
    )
    running_in: float = quantity(
        0,
        0,
        100,
        "-",
        "rate of wear of a sharp edge over that of one that has run in, less 1; 0: none",
    )
    running_in_wear: float = quantity(
        0.05, 0.001, 5, "mm", "flank wear over which the rate falls by a factor e (assumption)"
    )
    built_up_edge: float = quantity(
        0, 0, 100, "-", "rate of wear where edges build up most, over that without, less 1; 0: none"
    )
    built_up_speed: float = quantity(
        60, 0.1, 5000, "m/min", "cutting speed at which edges build up most (assumption)"
    )
    built_up_width: float = quantity(
        0.25, 0.01, 3, "-", "log width of the range of speed in which edges build up (assumption)"
    )
    notch_growth: float = quantity(
        0, 0, 20, "-", "notch of a worn-out edge over that which breaks a usual one; 0: none"
    )


class Swarf(Section):
    """Chips: they tangle and stop the machine outside a window of feed and depth of cut."""

    tangle_rate: float = quantity(
        0, 0, 1e3, "1/min", "stops per cutting time outside the window; 0: none"
    )
    tangle_time: float = quantity(1, 0, 1e3, "min", "time to clear tangled chips (assumption)")
    chip_feed_min: float = quantity(
        0.15, 0, 10, "mm/rev", "lowest feed at which chips break (assumption)"
    )
    chip_feed_max: float = quantity(
        0.7, 0, 10, "mm/rev", "highest feed at which chips break (assumption)"
    )
    chip_depth_min: float = quantity(
        1.0, 0, 50, "mm", "smallest depth of cut at which chips break (assumption)"
    )
    chip_depth_max: float = quantity(
        7.0, 0, 50, "mm", "largest depth of cut at which chips break (assumption)"
    )


class Machine(Section):
    """The lathe's ranges and drives."""

    cutting_speed_min: float = quantity(50, 0.1, 5000, "m/min", "lowest cutting speed")
    cutting_speed_max: float = quantity(200, 0.1, 5000, "m/min", "highest cutting speed")
    feed_min: float = quantity(0.06, 0.001, 10, "mm/rev", "lowest feed")
    feed_max: float = quantity(0.60, 0.001, 10, "mm/rev", "highest feed")
    feed_time_constant: float = quantity(
        0.13, 0, 60, "s", "time constant of the feed drive (measured, roughness control paper)"
    )
    spindle_time_constant: float = quantity(
        0.4, 0, 60, "s", "time constant of the spindle drive (assumption)"
    )
    chatter: float = quantity(
        0, 0, 10, "-", "dynamic thrust force over the static one at the worst speed; 0: no chatter"
    )
    chatter_speed: float = quantity(
        500, 1, 1e5, "rev/min", "spindle speed at which the bar chatters most (assumption)"
    )
    chatter_width: float = quantity(
        0.06, 0.001, 3, "-", "log width of the range of speeds in which it chatters (assumption)"
    )
    chip_lag: float = quantity(
        0, 0, 100, "rev", "lag of force and power behind the cut: a chip thickens over a revolution"
    )
    command_delay: float = quantity(
        0, 0, 60, "s", "dead time of the drives, at most 4 control intervals (of LinuxCNC)"
    )
    rated_power: float = quantity(
        7.5, 0.001, 1e4, "kW", "spindle power at a load of 100 % (assumption)"
    )
    return_time: float = quantity(
        0.1, 0, 1e3, "min", "time from the end of a pass to the start of the next (assumption)"
    )


class Spindle(Section):
    """The spindle's motor: torque over speed, idling, short-time overload. Neutral by default."""

    base_speed: float = quantity(
        0,
        0,
        1e5,
        "rev/min",
        "speed up to which the rated torque holds, above it the power; 0: none",
    )
    max_speed: float = quantity(
        0,
        0,
        1e6,
        "rev/min",
        "highest speed, which limits the cutting speed by the diameter; 0: none",
    )
    idle_torque: float = quantity(
        0, 0, 1e5, "N m", "torque of the idling spindle, which adds to that of the cut"
    )
    efficiency: float = quantity(
        1,
        0.1,
        1,
        "-",
        "power at the cut over that of the motor; the shop multiplies limits.power by it",
    )
    short_time_load: float = quantity(
        1, 1, 5, "-", "load allowed until the motor is hot, over that always allowed"
    )
    thermal_time_constant: float = quantity(
        10, 0.1, 1e4, "min", "time constant of the motor's heating (assumption)"
    )
    reading: Literal["power", "torque"] = "power"
    """Meaning of the load that the control reads. "power": share of rated power; "torque": share of
    the torque that the motor has at its present speed (fuzzy override paper)."""


class FeedDrive(Section):
    """Ball screw and permanent-magnet motor of the feed drive.

    Servo current paper, eq. 1 to 9. All values: assumptions.
    """

    guide_friction: float = quantity(200, 0, 1e6, "N", "friction force of the guides, F_0")
    screw_lead: float = quantity(10, 0.1, 1000, "mm", "travel per revolution of the screw, L_0")
    efficiency: float = quantity(0.9, 0.01, 1, "-", "overall efficiency of the transmission, eta")
    preload: float = quantity(1000, 0, 1e6, "N", "preload of the ball screw, F_p0")
    screw_efficiency: float = quantity(
        0.95, 0.01, 1, "-", "efficiency of the ball screw without preload, eta_0"
    )
    pole_pairs: float = quantity(4, 1, 100, "-", "pole pairs of the motor, p")
    flux_linkage: float = quantity(
        0.1, 1e-4, 100, "Wb", "amplitude of the rotor's flux linkage, lambda_m"
    )
    no_load_current_rate: float = quantity(
        0.001, 0, 10, "A min/mm", "growth of the no-load current with feed velocity"
    )
    ripple: float = quantity(0.03, 0, 1, "-", "amplitude of the current's ripple over the current")
    ripples_per_turn: float = quantity(
        24, 0, 1e4, "-", "periods of the ripple per revolution of the screw"
    )


class DrawnSections(NamedTuple):
    """The sections of a bar in the drawing, from its face on; each has one depth of cut."""

    depths: NDArray[np.float64]  # nominal [mm]; 0 is air
    starts: NDArray[np.float64]  # places along the bar [mm]
    ends: NDArray[np.float64]  # likewise


class Workpiece(Section):
    """The bars and their deviations from the drawing."""

    bars: int = quantity(
        0, 0, 1000000, "bars", "number of bars after which the episode ends; 0: unlimited"
    )

    bar_length: float = quantity(300, 1, 1e5, "mm", "length of cut of one bar (assumption)")
    diameter: float = quantity(
        100, 1, 5000, "mm", "diameter at which the bar is turned (assumption)"
    )
    approach: float = quantity(3, 0, 1e4, "mm", "path in air before each bar (assumption)")
    depth_of_cut: float = quantity(
        2.5, 0.01, 50, "mm", "nominal depth of cut; with parts, the nominal allowance"
    )
    depth_profile: tuple[float, ...] = ()
    """Nominal depths of cut of sections of equal length along every bar [mm], 0.01 to 50; empty:
    ``depth_of_cut`` throughout."""
    section_lengths: tuple[float, ...] = ()
    """Lengths of these sections [mm], which add up to ``bar_length``; a section of depth 0 is air.
    Empty: equal lengths."""
    section_speeds: tuple[float, ...] = ()
    """Highest cutting speeds of these sections [m/min], where the spindle's limit counts. Empty:
    the machine's highest."""
    depth_bar_spread: float = quantity(
        0.25, 0, 20, "mm", "standard deviation of depth of cut from bar to bar"
    )
    depth_along_spread: float = quantity(
        0.30, 0, 20, "mm", "standard deviation of depth of cut along a bar"
    )
    depth_correlation_length: float = quantity(
        25, 0.1, 1e5, "mm", "correlation length of depth of cut along a bar (assumption)"
    )
    depth_ripple: float = quantity(
        0, 0, 0.5, "-", "amplitude of the depth's ripple over the depth (run-out)"
    )
    depth_ripple_period: float = quantity(1, 0.001, 1000, "rev", "period of the depth's ripple")
    support: Literal["rigid", "chuck", "tailstock"] = "rigid"
    """Support of the bar. "rigid": it does not bend; "chuck": the chuck alone; "tailstock": chuck
    and tailstock."""
    overhang: float = quantity(
        0, 0, 1e5, "mm", "free length of the bar from the chuck, in advice; 0: length of cut"
    )
    elastic_modulus: float = quantity(
        210_000, 1e3, 1e6, "N/mm2", "modulus of elasticity of the bar (steel, handbooks)"
    )
    radial_share: float = quantity(
        0.7, 0, 1, "-", "radial force, which bends the bar, over thrust force (assumption)"
    )
    hardness_bar_spread: float = quantity(
        0.08, 0, 1, "-", "log standard deviation of hardness from bar to bar"
    )
    hardness_along_spread: float = quantity(
        0.05, 0, 1, "-", "log standard deviation of hardness along a bar"
    )
    hardness_correlation_length: float = quantity(
        40, 0.1, 1e5, "mm", "correlation length of hardness along a bar (assumption)"
    )

    @model_validator(mode="after")
    def _sections_agree(self) -> Self:
        if len(self.depth_profile) > MAX_DEPTHS:
            raise ValueError(
                f"depth_profile has {len(self.depth_profile)} sections, "
                f"more than the allowed {MAX_DEPTHS}"
            )
        for depth in self.depth_profile:
            if depth != 0.0 and not _MIN_SECTION_DEPTH <= depth <= _MAX_SECTION_DEPTH:
                raise ValueError(
                    f"depth_profile: {depth} is outside the allowed range "
                    f"{_MIN_SECTION_DEPTH:g} to {_MAX_SECTION_DEPTH:g} mm"
                )
        for name in ("section_lengths", "section_speeds"):
            values = getattr(self, name)
            if values and len(values) != len(self.depth_profile):
                raise ValueError(
                    f"{name} has {len(values)} numbers, but depth_profile {len(self.depth_profile)}"
                )
            if any(value <= 0.0 for value in values):
                raise ValueError(f"{name} must be above 0")
        total = sum(self.section_lengths)
        if self.section_lengths and abs(total / self.bar_length - 1.0) > _ROUNDING:
            raise ValueError(
                f"section_lengths add up to {total:g} mm, but bar_length is {self.bar_length:g} mm"
            )
        if 0.0 in self.depth_profile and not (self.section_lengths and any(self.depth_profile)):
            raise ValueError("a depth of 0, air, needs section_lengths and another depth above 0")
        return self

    def drawn_sections(self) -> DrawnSections:
        """Return the sections of the drawing: one if the whole bar has one depth."""
        depths = self.depth_profile or (self.depth_of_cut,)
        equal_lengths = (self.bar_length / len(depths),) * len(depths)
        ends = np.cumsum(self.section_lengths or equal_lengths)
        starts = np.concatenate(([0.0], ends[:-1]))
        return DrawnSections(depths=np.array(depths), starts=starts, ends=ends)


class Control(Section):
    """The policy's actions and the length of an episode."""

    interval: float = quantity(
        1.0,
        0.001,
        3600,
        "s",
        "control interval: time of a step, except of one that is a whole part",
    )
    sub_steps: int = quantity(
        10, 1, 10000, "sub-steps", "integration steps per step; with parts, per pass"
    )
    action: Literal["incremental", "set_point", "override", "part"] = "incremental"
    """Meaning of an action. "incremental": changes of the logarithms of speed and feed;
    "set_point": -1 to 1 maps linearly to the ranges of speed and feed; "override": override of the
    programmed feed, at a fixed speed; "part": passes of a whole part, with speed and feed of
    each."""
    edge_changes: Literal["end", "automatic", "commanded"] = "end"
    """Consequence of an edge that is worn out or broken. "end": the episode ends; "automatic": the
    edge is changed, which takes time; "commanded": the same, and a further action changes the edge
    before."""
    aim: Literal["removal", "roughness"] = "removal"
    """Aim of the reward. "removal": remove metal; "roughness": follow a reference of surface
    roughness, which is observed."""
    override_max: float = quantity(2.0, 0.01, 100, "-", "highest feed over the programmed feed")
    passes_max: int = quantity(4, 1, MAX_PASSES, "passes", "largest number of passes of a part")
    cutting_speed_step: float = quantity(
        0.15, 1e-4, 10, "-", "largest change of log cutting speed per step"
    )
    feed_step: float = quantity(0.40, 1e-4, 10, "-", "largest change of log feed per step")
    initial_cutting_speed: float = quantity(
        125, 0.1, 5000, "m/min", "programmed cutting speed, at the start (assumption)"
    )
    initial_feed: float = quantity(
        0.25, 0.001, 10, "mm/rev", "programmed feed, at the start (assumption)"
    )
    time_limit: float = quantity(
        60, 0.001, 1e5, "min", "machine time after which an episode is truncated (assumption)"
    )


class Surface(Section):
    """Roughness of the turned surface, Ra = a exp(b F) with the thrust force F.

    Roughness control paper, equation (5).
    """

    roughness_at_no_force: float = quantity(
        0.2401, 1e-6, 1000, "um", "a, the roughness without force"
    )
    roughness_rate: float = quantity(
        0.0034, 0, 1, "1/N", "b, the growth of log roughness with force"
    )
    reference_min: float = quantity(
        1.0, 1e-3, 1e5, "um", "lowest reference of Ra (roughness control paper, table 1)"
    )
    reference_max: float = quantity(
        3.1, 1e-3, 1e5, "um", "highest reference of Ra (roughness control paper, table 1)"
    )
    reference_time: float = quantity(
        3.75, 1e-3, 1e5, "s", "time between changes of the reference (assumption)"
    )


class Sensors(Section):
    """The sensors between the process and the policy."""

    force: Literal["dynamometer", "servo_current"] = "dynamometer"
    """Sensor of the thrust force. "servo_current": the current of the feed drive's motor is
    measured instead of the force, with the force's lag and noise."""
    probe: bool = False
    """Whether the size of every blank is measured before it is turned; only with parts."""
    inspects_edges: bool = False
    """Whether the flank wear of every edge is measured when it is taken out, without error
    (assumption)."""
    counts_tangles: bool = False
    """Whether stops of the machine for tangled chips are observed."""
    observes_all: bool = False
    """Whether observations also hold the hidden state: hardness, depth of cut, flank wear, and the
    insert's wear factor and strength. On a family, the context then also holds the true laws. No
    machine has such sensors: such a twin of a task shows what hidden state costs."""
    power_noise: float = quantity(
        0.02, 0, 1, "-", "relative standard deviation of measured power (assumption)"
    )
    force_noise: float = quantity(
        0.05, 0, 1, "-", "relative standard deviation of measured thrust force (assumption)"
    )
    power_time_constant: float = quantity(
        0.1, 0, 60, "s", "time constant of measured power (assumption)"
    )
    force_time_constant: float = quantity(
        0.05, 0, 60, "s", "time constant of measured thrust force (assumption)"
    )


class Mismatch(Section):
    """The model mismatch: differences of bars, edges and sensors from the nominal model.

    The nominal model is the rest of the scenario.
    """

    hardness_factor: float = quantity(1, 0.1, 10, "-", "mean hardness of the bars over nominal")
    skin_thickness: float = quantity(
        0, 0, 50, "mm", "thickness of the skin that forging or casting leaves on a blank; 0: none"
    )
    skin_hardness: float = quantity(
        1, 0.1, 10, "-", "hardness of the skin over that of the metal beneath"
    )
    skin_wear: float = quantity(
        1, 0.1, 10, "-", "wear of an edge in skin over wear in metal of the same hardness"
    )
    wear_factor: float = quantity(1, 0.1, 10, "-", "mean wear of the inserts over nominal")
    initial_wear: float = quantity(
        0, 0, 5, "mm", "flank wear of every edge at its start, where the nominal model has none"
    )
    power_bias: float = quantity(0, -0.9, 10, "-", "measured over true power, less 1")
    force_bias: float = quantity(
        0, -0.9, 10, "-", "measured over true thrust force (or servo current, if measured), less 1"
    )
    power_drift: float = quantity(
        0, -0.9, 10, "-", "change of measured over true power until the machine is warm"
    )
    force_drift: float = quantity(
        0, -0.9, 10, "-", "likewise of measured thrust force (or servo current, if measured)"
    )
    thermal_growth: float = quantity(
        0, -5, 5, "mm", "change of the depth of cut until the machine is warm"
    )
    warm_up_time: float = quantity(
        30, 0.1, 1e4, "min", "time constant of the machine's warm-up (assumption)"
    )
    hardness_gradient: float = quantity(
        0, -5, 5, "-", "log hardness at a bar's skin less that at the finished contour"
    )


class Economics(Section):
    """Prices in machine time, which the reward counts, and in money, for ``advise``.

    Machine time is money divided by the machine's hourly rate.
    """

    reference_removal_rate: float = quantity(
        115, 0.001, 1e5, "cm3/min", "removal rate that pays for machine time (assumption)"
    )
    edge_cost: float = quantity(3, 0, 1e4, "min", "price of one edge (assumption)")
    edge_change_time: float = quantity(
        2, 0, 1e4, "min", "time to change an edge (adaptive part programming paper, tau_I)"
    )
    breakage_downtime: float = quantity(
        10, 0, 1e5, "min", "further time lost when an edge breaks (assumption)"
    )
    unplanned_stop: float = quantity(
        3, 0, 1e4, "min", "further time lost when a worn-out edge is changed unasked (assumption)"
    )
    roughness_price: float = quantity(
        10, 0, 1e4, "-", "price of a relative deviation of Ra of 1 [s/s] (assumption)"
    )
    overload_price: float = quantity(
        10, 0, 1e4, "-", "price of a relative excess of 1 over a limit [s/s] (assumption)"
    )
    currency: str = "EUR"
    """Unit of money of the prices below, 1 to 8 characters."""
    machine_rate: float = quantity(
        0, 0, 1e9, "money/h", "hourly rate of the machine; 0: advice counts machine time, not money"
    )
    operator_rate: float = quantity(
        0, 0, 1e9, "money/h", "hourly rate of the operator, on top of the machine's"
    )
    insert_price: float = quantity(
        0, 0, 1e9, "money", "price of an insert; 0: edge_cost of machine time per edge"
    )
    edges_per_insert: float = quantity(4, 1, 100, "edges", "usable edges of an insert")


NO_LIMIT = 1e-12
"""Coefficient of a further limit that is none."""


class FeedLimit(PowerLaw):
    """A further limit: a response that grows with feed, depth of cut and hardness.

    Its largest allowed value bounds the feed. By default it is never reached. Form and use:
    adaptive part programming paper, "boundary conditions".
    """

    coefficient: float = quantity(
        NO_LIMIT,
        NO_LIMIT,
        1e12,
        "response",
        "response at f = d/d0 = H = 1; at the default, no limit",
    )
    most: float = quantity(1.0, 1e-9, 1e9, "response", "largest allowed response")

    @property
    def bounds(self) -> bool:
        """Whether there is a limit."""
        return self.coefficient > NO_LIMIT


class Limits(Section):
    """Limits of the process."""

    thrust_force: float = quantity(
        1500, 0.001, 1e6, "N", "largest allowed thrust force, the resultant of feed and back force"
    )
    power: float = quantity(7, 0.001, 1e4, "kW", "largest allowed spindle power")
    radial_force: FeedLimit = FeedLimit()
    """Radial force P_y [N]. Its excess, as that of the next two, counts as an excess of force if it
    is the largest."""
    torque: FeedLimit = FeedLimit()
    """Spindle torque M [N m]."""
    roughness: FeedLimit = FeedLimit()
    """Height of the roughness, R_z [mm]."""
    overload_tolerance: float = quantity(
        0.05, 0, 1, "-", "relative excess over a limit above which overload is severe"
    )
    overload_allowance: float = quantity(
        0.05, 0, 1, "-", "allowed share of cutting time in severe overload; decides feasibility"
    )


class Sections(Section):
    """The name and the sections of a scenario (``scenario.py``)."""

    name: str = "rough_turning"
    """Also the name of folders of trainings and results, so only characters that are safe in paths
    are allowed."""
    material: Material = Material()
    tool: Tool = Tool()
    edge_failure: EdgeFailure = EdgeFailure()
    swarf: Swarf = Swarf()
    machine: Machine = Machine()
    spindle: Spindle = Spindle()
    feed_drive: FeedDrive = FeedDrive()
    workpiece: Workpiece = Workpiece()
    control: Control = Control()
    surface: Surface = Surface()
    sensors: Sensors = Sensors()
    mismatch: Mismatch = Mismatch()
    economics: Economics = Economics()
    limits: Limits = Limits()
