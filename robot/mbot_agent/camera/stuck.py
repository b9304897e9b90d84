"""Notices that the wheels turn for nothing: a wall, a cable, a robot that lies on its side.

While the policy drives, each observation is compared with the first one of the stretch. If it
differs by no more than its sensor and its automatic exposure explain, for as long and as far as
must show in any picture of a robot that moves, the robot is stuck.

How far two such are apart, RMS over 16 x 16 areas in grey levels of 255 (simulated, in pictures of
3 s): at a wall at most 0.4, with five times the usual noise; in 713 episodes of driving, by two
drivers, with five presets of cameras and rooms, at least 5.7. The bar lies between 1.0 and 2.2.
"""

import math
import sys
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_agent.faults import Fault
from mbot_agent.tick import Tick
from mbot_protocol.drive.picture import Picture
from mbot_protocol.drive.wheel_command import STOP, Duties

STILL_FOR_NS = 3_000_000_000
"""So long at least; latency, start-up of the motors and a slipping start are over in a tenth."""

WAY_M = 0.5
"""And so far would a wheel have come at least: by then even a plain wall that fills the picture has
come to its end or shows its foot. On the spot it is more than one turn."""

LOOSE_BAND = 65 / 255
"""Duty up to which a wheel may stand by itself: public notes say 40 to 60 of 255."""

SLOWEST_M_S = 0.3
"""At full speed: units have 105 to 132 rpm (public), 0.36 m/s and more, less a sixth for a battery
that is nearly empty."""

AREA_PX = 4
"""Side of an area: the noise of 16 pixels averages to a quarter, what has moved does not."""

ROUNDING = 1.0
"""Variance in levels of plain areas of two pictures, since both were rounded to whole ones."""

NOISE_MARGIN = 2.0
"""Of what white noise leaves in areas: JPEG and noise reduction leave more of it (1.2 measured)."""

NOISIEST = 4.0
"""Levels between two pixels of two observations, three times those of the noisiest camera of all
presets. More is a picture that moves, such as a carpet's."""

MOST_GAIN = 2.0
"""By which levels may grow or shrink: two stops of an automatic exposure. More was a lamp."""

_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, slots=True)
class _View:
    """One observation in grey levels, shape (64, 64), and its areas', shape (16, 16).

    Of brightness only: noise reduction leaves blotches of colour, as large as areas.
    """

    levels: NDArray[np.float32]
    areas: NDArray[np.float32]


class StuckCheck:
    """Asked once a decision, with the finished beat, on the loop's thread.

    Attributes:
        fault: since when it was found until somebody sets the robot in motion; any thread may ask.

    """

    def __init__(self) -> None:
        self.fault: Fault | None = None
        self._first: _View | None = None
        self._begun_ns = self._last_ns = 0
        self._told = STOP
        self._ways_m = np.zeros(2)

    def judge(self, tick: Tick) -> Fault | None:
        """The fault, if this beat shows it for the first time."""
        if tick.orders.is_armed:
            self.fault = None
        if tick.observation is None or tick.duties.is_stop:
            self._first = None
            return None
        seen = _view(tick.observation)
        self._ways_m += _speeds_m_s(self._told) * (tick.started_ns - self._last_ns) / 1e9
        self._told, self._last_ns = tick.duties, tick.started_ns
        if self._first is None or has_moved(self._first, seen):
            self._first, self._begun_ns = seen, tick.started_ns
            self._ways_m[:] = 0
            return None
        still_ns = tick.started_ns - self._begun_ns
        if still_ns < STILL_FOR_NS or abs(self._ways_m).max() < WAY_M:
            return None
        self._first = None
        self.fault = Fault(
            "stuck",
            f"the wheels were driven for {still_ns / 1e9:.1f} s and the picture stands still: "
            "free the robot",
        )
        return self.fault


def has_moved(first: _View, now: _View) -> bool:
    """Whether two views differ by more than noise, rounding and exposure explain."""
    gain = _gain(first.areas, now.areas)
    pixels = now.levels[::2] - gain * first.levels[::2]
    # Neighbours differ by noise, but for the few between which something has an edge.
    steps = np.abs(pixels[:, 1:] - pixels[:, :-1])
    noise = min(float(np.median(steps)) * _MAD_TO_SIGMA / math.sqrt(2), NOISIEST)
    allowed = ROUNDING + (NOISE_MARGIN * noise / AREA_PX) ** 2
    return float((now.areas - gain * first.areas).var()) > allowed


def _gain(first: NDArray[np.float32], now: NDArray[np.float32]) -> float:
    """The contrast of one view in terms of the other, as far as an exposure may change it."""
    contrast = first - first.mean()
    power = max(float((contrast * contrast).sum()), sys.float_info.min)  # a plain one has none
    gain = float((contrast * now).sum()) / power
    return min(max(gain, 1 / MOST_GAIN), MOST_GAIN)


def _view(observation: Picture) -> _View:
    levels = cv2.cvtColor(observation.astype(np.float32), cv2.COLOR_RGB2GRAY)
    height_px, width_px = levels.shape
    size = width_px // AREA_PX, height_px // AREA_PX
    areas = cv2.resize(levels, size, interpolation=cv2.INTER_AREA)
    return _View(np.asarray(levels, np.float32), np.asarray(areas, np.float32))


def _speeds_m_s(told: Duties) -> NDArray[np.float64]:
    """How fast left and right wheel turn at least, of a weak robot."""
    duties = np.array((told.left, told.right), np.float64)
    share = (np.abs(duties) - LOOSE_BAND).clip(0) / (1 - LOOSE_BAND)
    return np.sign(duties) * share * SLOWEST_M_S
