"""Pins of the mCore: what the motors do, from the registers that decide it, and sensors."""

from dataclasses import dataclass

from mbot_protocol.drive.mcore import SPEED_LIMIT, Joystick
from mbot_protocol.errors import MbotError

_M1_DIR, _M1_PWM, _M2_DIR, _M2_PWM = 1 << 7, 1 << 6, 1 << 4, 1 << 5  # all on port D
_COMPARE_A, _COMPARE_B = 6, 4
"""Where in TCCR0A the two bits are that connect a pin to the timer (data sheet, TCCR0A)."""

_PAIR_PINS = ("B1", "B2")
"""Of the infrared pairs at RJ25 port 2, where the kit has them."""


def felt_lines(floor: tuple[bool, bool], echo_m: float) -> list[str]:
    """What the emulator is told of the sensors (`board_simulator.c`): whether either infrared pair
    sees a floor, and how far away is what answers the ultrasonic sensor; 0: nothing does.
    """
    pins = zip(_PAIR_PINS, floor, strict=True)
    levels = [f"{'high' if seen else 'low'} {pin}" for pin, seen in pins]
    return [*levels, f"echo {round(echo_m * 1000)}"]


_DISCONNECTED, _NON_INVERTING = 0, 2
_FAST_PWM = 3


@dataclass(frozen=True, slots=True)
class MotorPins:
    """The registers, and since when they have had these values.

    Attributes:
        at_us: the board's own time.
        ocr0a, ocr0b: compare values of Timer 0: the duties of M1 and M2 are (value + 1) / 256.
        tccr0a: Timer 0's mode, and whether it has the pins.
        portd, ddrd: levels and directions of the pins.

    """

    at_us: int
    ocr0a: int
    ocr0b: int
    tccr0a: int
    portd: int
    ddrd: int

    @property
    def joystick(self) -> Joystick:
        """The speeds that these pins make, as the board counts them; the sign is DIR's.

        Raises:
            MbotError: the firmware makes its PWM in a way not known here.

        """
        return Joystick(
            self._speed(self.ocr0a, _COMPARE_A, _M1_PWM, _M1_DIR),
            self._speed(self.ocr0b, _COMPARE_B, _M2_PWM, _M2_DIR),
        )

    def _speed(self, compare: int, connection_at: int, pwm: int, direction: int) -> int:
        if not self.ddrd & pwm:
            return 0  # an input: the motor driver's own resistor pulls it low
        connection = self.tccr0a >> connection_at & 3
        if connection == _DISCONNECTED:
            speed = SPEED_LIMIT if self.portd & pwm else 0  # Arduino's way to make 255
        elif connection == _NON_INVERTING and self.tccr0a & 3 == _FAST_PWM:
            speed = compare
        else:
            raise MbotError(
                f"the firmware drives its motors by a mode of Timer 0 not known here (TCCR0A is "
                f"{self.tccr0a:#04x}, expected fast PWM); is it for an mCore board?"
            )
        return speed if self.portd & direction else -speed
