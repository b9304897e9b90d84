"""A geared DC motor from what can be measured on the finished robot: speed, dead band, time."""

import math
from dataclasses import dataclass

from mbot_protocol.drive.actions import LEVELS
from mbot_protocol.drive.wheel_command import Duties
from mbot_workstation.sim.body.robot_parameters import MotorParameters, RobotParameters
from mbot_workstation.sim.engine import TIMESTEP_S

ROTOR_INERTIA_KG_M2 = 2e-5
"""Of the motor's rotor behind the 1:48 gear, at the wheel; assumed, 4 % of what the wheel has to
move. Without it the wheels would be so light that the contact solver has to work harder."""


@dataclass(frozen=True, slots=True)
class MotorConstants:
    """The two constants of an ideal DC motor, seen at the wheel.

    Its torque is constant * (voltage - constant * speed) / resistance.

    Attributes:
        constant_v_s: back-EMF constant [V s/rad], equal to the torque constant [N m/A].
        resistance_ohm: of the winding.

    """

    constant_v_s: float
    resistance_ohm: float


def motor_constants(robot: RobotParameters, motor: MotorParameters) -> MotorConstants:
    """The constants that give the measured free speed and time constant.

    A wheel with inertia J driven by such a motor approaches its free speed V / K with the time
    constant J R / K^2. J is half the robot's mass at the wheel's rim, the wheel itself (a solid
    sphere, as simulated) and the rotor. A robot that turns on the spot moves its own inertia
    instead and is quicker: 55 ms where driving straight takes 90 (measured).

    By as much as the load and a step of the simulation make the robot answer sooner it is made
    slower, so that what is simulated takes the time constant: 57, 79, 89, 121 and 202 ms for 60,
    80, 90, 120 and 200 (measured; without, 50, 82 and 193 for 60, 90 and 200).
    """
    constant = robot.supply_v / robot.free_speed_rad_s
    rim_mass_kg = robot.mass_kg / 2 + 2 / 5 * robot.wheel_mass_kg
    inertia_kg_m2 = rim_mass_kg * robot.wheel_radius_m**2 + ROTOR_INERTIA_KG_M2
    time_constant_s = (motor.time_constant_s + TIMESTEP_S) * (1 + robot.load_loss)
    return MotorConstants(constant, time_constant_s * constant**2 / inertia_kg_m2)


def wheel_voltages(left: float, right: float, robot: RobotParameters) -> tuple[float, float]:
    """Of both wheels at these duties; what both draw makes the battery's voltage sag."""
    draw = (min(abs(left), 1.0) + min(abs(right), 1.0)) / 2
    supply_v = robot.supply_v * (1 - robot.battery_sag * draw)
    return (
        motor_voltage(left, robot.left_motor, supply_v),
        motor_voltage(right, robot.right_motor, supply_v),
    )


def motor_voltage(duty: float, motor: MotorParameters, supply_v: float) -> float:
    """The voltage at which the simulated wheel, with its dry friction, has the speed it should.

    Up to the dead band the wheel stands; from there its speed rises, in a line but for the motor's
    bend, to the free speed, which was measured with that friction. A duty of 0 is 0 V, not an open
    circuit: the board's driver shorts the motor, which brakes it.

    Args:
        duty: PWM duty in [-1, 1], positive is forward; beyond is clipped.
        motor: its gain in this direction scales the result.
        supply_v: voltage at full duty.

    """
    size = min(abs(duty), 1.0)
    if size <= motor.dead_band:
        return 0.0
    working = ((size - motor.dead_band) / (1 - motor.dead_band)) ** motor.bend
    gain = motor.gain if duty > 0 else motor.gain * motor.backward_share
    return math.copysign((working * gain + motor.dry_friction) * supply_v, duty)


def pwm_duties(told: Duties) -> tuple[float, float]:
    """The PWM duties of the left and the right wheel in [-1, 1], positive is forward.

    The board's timer counts to 256 and makes (n + 1) / 256 of n / 255, exactly 0 of 0 (measured on
    the mCore).
    """
    return _pwm_duty(told.left), _pwm_duty(told.right)


def _pwm_duty(told: float) -> float:
    level = round(abs(told) * LEVELS)
    return math.copysign((level + 1) / 256, told) if level else 0.0
