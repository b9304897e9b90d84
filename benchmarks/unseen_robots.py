"""Six robots from two simulators of their own: truth that the identification was not tuned on."""

from brush_robot import BrushRobot
from carpet_robot import CarpetRobot
from unseen_robot import UnseenRobot

UNSEEN: dict[str, UnseenRobot] = {
    "brush": BrushRobot(),
    "brush, worn left motor": BrushRobot(contact_v=(0.8, 0.12), resistance=(8.5, 6.2)),
    "brush, slippery and heavy": BrushRobot(mass=1.25, inertia=0.003, ahead=0.02, grip=0.3),
    "carpet": CarpetRobot(),
    "carpet, weak right motor": CarpetRobot(top=(12.7, 8.2)),
    "carpet, old": CarpetRobot(
        mass=1.12,
        inertia=0.0027,
        radius=(0.0328, 0.0322),
        top=(11.7, 11.9),
        lag=(0.06, 0.066),
        fading=(0.05, 0.04),
        rolling=0.045,
        scrub=0.25,
    ),
}
"""Of each simulator one healthy robot, one with a motor at about two thirds, one on bad ground or
past its best."""
