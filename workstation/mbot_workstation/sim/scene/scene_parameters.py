"""What surrounds the robot: the arena, the object and the room behind it, nominal values.

The paper shows the scene but gives no figures; these are assumed, so that its rewards and episode
lengths come out (an arena of 6 m with objects up to 2.5 m from its centre).
"""

from dataclasses import dataclass, field

from mbot_workstation.sim.scene.target_object import RED_CUBE, TargetObject


@dataclass(frozen=True, slots=True)
class Arena:
    """The square floor between the walls, centred on the origin.

    Attributes:
        border_m: the axle's centre touches the border at this |x| or |y|.
        wall_m: where the walls stand.
        wall_height_m: how high they are.
        wall_rgb: light grey.

    """

    border_m: float = 2.9
    wall_m: float = 3.0
    wall_height_m: float = 0.20
    wall_rgb: tuple[float, float, float] = (0.85, 0.85, 0.84)


@dataclass(frozen=True, slots=True)
class Room:
    """How the 360-degree photo stands around the arena.

    Attributes:
        distance_m: radius of the upright cylinder it is projected on; finite, so that the room
            grows as the robot approaches it.
        photo_height_m: how high above the floor the photo was taken: a tripod.

    """

    distance_m: float = 5.0
    photo_height_m: float = 1.2


@dataclass(frozen=True, slots=True)
class Light:
    """One directional light, as in the paper, and what the room reflects from all sides.

    The two sum to 1 on a surface that faces the light, which therefore shows its own colour.

    Attributes:
        direction: x, y, z it shines in; any length. From a high window.
        ambient: share of light that comes from everywhere, in [0, 1].

    """

    direction: tuple[float, float, float] = (-0.5, 0.35, -0.8)
    ambient: float = 0.7


@dataclass(frozen=True, slots=True)
class FloorMark:
    """Tape on the floor.

    Attributes:
        points_m: the line that it follows, at least two.
        width_m: 20 mm is common tape.
        rgb: black.

    """

    points_m: tuple[tuple[float, float], ...]
    width_m: float = 0.02
    rgb: tuple[float, float, float] = (0.03, 0.03, 0.03)


@dataclass(frozen=True, slots=True)
class SceneParameters:
    """Everything around the robot.

    Attributes:
        arena, room, light: see there.
        objects: the kinds of object that there are, matte; the task says which stands where.
        marks: on the floor.

    """

    arena: Arena = field(default_factory=Arena)
    objects: tuple[TargetObject, ...] = (RED_CUBE,)
    marks: tuple[FloorMark, ...] = ()
    room: Room = field(default_factory=Room)
    light: Light = field(default_factory=Light)
