"""The robot's nominal dimensions, masses and motors: the one place where they stand.

A calibration replaces them with `dataclasses.replace`; nothing else knows these numbers. Where
the paper gives no figure they are assumptions, marked so, with the spread a real unit may show.
"""

import math
from dataclasses import dataclass, field, replace

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera


@dataclass(frozen=True, slots=True)
class BoxBody:
    """One part of the robot as a solid box: it carries mass and can be seen, it never collides.

    Attributes:
        name: what it is.
        mass_kg: its mass.
        size_m: full edge lengths along x (forward), y (left), z (up).
        centre_m: its centre; x and y from the axle's centre, z from the floor.
        colour_rgb: each in [0, 1].

    """

    name: str
    mass_kg: float
    size_m: tuple[float, float, float]
    centre_m: tuple[float, float, float]
    colour_rgb: tuple[float, float, float]


NOMINAL_BODIES = (
    BoxBody("chassis", 0.30, (0.165, 0.080, 0.020), (0.020, 0.0, 0.037), (0.20, 0.45, 0.75)),
    BoxBody("left motor", 0.06, (0.070, 0.020, 0.022), (0.015, 0.030, 0.0325), (0.85, 0.75, 0.2)),
    BoxBody("right motor", 0.06, (0.070, 0.020, 0.022), (0.015, -0.030, 0.0325), (0.85, 0.75, 0.2)),
    BoxBody("mCore board", 0.04, (0.090, 0.078, 0.015), (-0.030, 0.0, 0.085), (0.15, 0.35, 0.60)),
    BoxBody("battery pack", 0.24, (0.100, 0.065, 0.022), (0.000, 0.0, 0.058), (0.12, 0.12, 0.12)),
    BoxBody("Pi Zero", 0.02, (0.065, 0.030, 0.010), (-0.030, 0.0, 0.100), (0.15, 0.50, 0.25)),
    BoxBody("camera", 0.15, (0.040, 0.038, 0.030), (0.037, 0.0, 0.075), (0.08, 0.08, 0.08)),
)
"""Sizes from public drawings of an mBot, a Pi Zero, an HQ camera with the 6 mm lens and a 5000 mAh
power bank; masses are assumed so that, with the wheels, they sum to the assumed 0.94 kg."""


@dataclass(frozen=True, slots=True)
class MotorParameters:
    """One motor with its gear, as its wheel's speed shows it.

    Attributes:
        gain: strength against the nominal motor; +-0.05 is usual, 0.5 is the paper's handicap.
        backward_share: its strength when it turns the wheel backward, against forward. A brushed
            motor has a better direction, by some percent; 1 if not identified.
        dead_band: share of full duty up to which the wheel stands. Public notes say 40 to 60 of
            255; 50 is the middle.
        bend: exponent of the duty that works: below 1 speed rises fast at first, as it does where
            the winding smooths the PWM's current. 1, a straight line, if not identified.
        time_constant_s: of the wheel's speed after a step of the duty, with the robot's own mass
            to move. Assumed; 0.060-0.120.
        dry_friction: torque with which gear and bearing resist whatever the speed, as a share of
            the nominal motor's at standstill and full duty. It stops the wheel sooner and holds
            it; what it takes from a driven wheel is in the other three. 0 if not identified.

    Raises:
        ValueError: nothing can be simulated with a value. What real robots have is narrower:
            `parameter_table.py`.

    """

    gain: float = 1.0
    backward_share: float = 1.0
    dead_band: float = 50 / 255
    bend: float = 1.0
    time_constant_s: float = 0.090
    dry_friction: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain > 0):
            raise ValueError(f"gain is {self.gain}, expected above 0")
        if not (math.isfinite(self.backward_share) and self.backward_share > 0):
            raise ValueError(f"backward_share is {self.backward_share}, expected above 0")
        if not 0 <= self.dead_band < 1:
            raise ValueError(f"dead_band is {self.dead_band}, expected from 0 to below 1")
        if not 0.2 <= self.bend <= 3:
            raise ValueError(f"bend is {self.bend}, expected 0.2 to 3")
        if not 0.005 <= self.time_constant_s <= 2:
            raise ValueError(f"time constant is {self.time_constant_s} s, expected 0.005 to 2")
        if not 0 <= self.dry_friction < 1:
            raise ValueError(f"dry_friction is {self.dry_friction}, expected from 0 to below 1")


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Where the camera sits on the robot. All assumed; height +-5 mm, angles +-1 to 1.5 degrees.

    Attributes:
        height_m: of the optical centre above the floor.
        ahead_m: of the axle's centre.
        left_m: of the robot's middle.
        pitch_down_deg: how far the optical axis points below the horizon.
        yaw_left_deg: how far it points to the left.
        roll_clockwise_deg: how far the camera is turned clockwise as seen from behind it.

    """

    height_m: float = 0.075
    ahead_m: float = 0.060
    left_m: float = 0.0
    pitch_down_deg: float = 5.0
    yaw_left_deg: float = 0.0
    roll_clockwise_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class RobotParameters:
    """Everything that makes one robot differ from another.

    Attributes:
        bodies: the boxes that make up its mass.
        mass_ahead_m: the whole robot's centre of mass ahead of the axle, where driving has shown
            it; None is what the bodies make.
        inertia_scale: likewise of the body's moments of inertia, against what the bodies make.
        wheel_radius_m: public mBot notes say 0.030 to 0.0325; +-0.0006.
        wheel_mass_kg: of one wheel; assumed.
        wheel_friction: rubber on vinyl, sliding (handbook range 0.7-1.0; the paper found no
            considerable slip).
        track_m: between the wheels' centres; public measurement, others say 0.110; +-0.002.
        caster_ahead_m: where the passive wheel touches the floor, ahead of the axle (public
            drawings: the mini caster is in front).
        rolling_drag_n: force of caster and bearings against driving ahead or back. It costs a weak
            motor a larger share of its speed, and takes more of a wheel that drives alone. 0 if
            not identified.
        turning_drag_n_m: torque of caster and tyres against a turn. 0 if not identified; a caster
            with 0.15 N of friction makes 0.01.
        turning_knee_rad_s: turn rate from which on that drag is at its limit; below it is in
            proportion. What slides mostly ahead resists going sideways only by its share: a caster
            75 mm ahead at 0.37 m/s goes sideways half as fast at 2.5 rad/s. Assumed.
        load_loss: share of the free speed lost under the robot's own load, by the caster and in
            the bearings (paper: "lower under load", no figure); assumed.
        free_speed_rpm: of a wheel at full duty without load: measured in the paper at 3.7 V;
            other units 105-132.
        supply_v: the voltage it was measured at (paper).
        battery_sag: share of it lost while both motors drive at full duty. 0 if not identified;
            the paper measured none, thanks to its second battery.
        battery_fade: share of the motors' strength that a session takes from a fresh battery. 0 if
            not identified. What is simulated has a fresh one: see `discharged`.
        left_motor, right_motor: see MotorParameters.
        wheel_maps: how its daemon turns a policy's steps into the board's speeds.
        camera: intrinsics, data sheet until calibrated. Its size only sets their scale.
        camera_mount: see CameraMount.
        touch_radius_m: the body as the task sees it, a circle about the axle's centre; assumed.

    """

    bodies: tuple[BoxBody, ...] = NOMINAL_BODIES
    mass_ahead_m: float | None = None
    inertia_scale: float = 1.0
    wheel_radius_m: float = 0.0325
    wheel_mass_kg: float = 0.035
    wheel_friction: float = 0.9
    track_m: float = 0.115
    caster_ahead_m: float = 0.075
    rolling_drag_n: float = 0.0
    turning_drag_n_m: float = 0.0
    turning_knee_rad_s: float = 2.5
    load_loss: float = 0.02
    free_speed_rpm: float = 120.0
    supply_v: float = 3.7
    battery_sag: float = 0.0
    battery_fade: float = 0.0
    left_motor: MotorParameters = field(default_factory=MotorParameters)
    right_motor: MotorParameters = field(default_factory=MotorParameters)
    wheel_maps: WheelMaps = field(default_factory=WheelMaps)
    camera: CameraModel = field(default_factory=lambda: nominal_pi_camera(320, 240))
    camera_mount: CameraMount = field(default_factory=CameraMount)
    touch_radius_m: float = 0.090

    def discharged(self, share: float) -> "RobotParameters":
        """The robot after this share of a session, in [0, 1], as one with weaker motors."""
        left = 1 - share * self.battery_fade
        return replace(
            self,
            left_motor=replace(self.left_motor, gain=self.left_motor.gain * left),
            right_motor=replace(self.right_motor, gain=self.right_motor.gain * left),
        )

    @property
    def mass_kg(self) -> float:
        """The whole robot's mass."""
        return sum(body.mass_kg for body in self.bodies) + 2 * self.wheel_mass_kg

    @property
    def centre_of_mass_m(self) -> float:
        """Of the whole robot, ahead of the axle."""
        if self.mass_ahead_m is not None:
            return self.mass_ahead_m
        return sum(body.mass_kg * body.centre_m[0] for body in self.bodies) / self.mass_kg

    @property
    def free_speed_rad_s(self) -> float:
        """`free_speed_rpm` in rad/s."""
        return self.free_speed_rpm * 2 * math.pi / 60
