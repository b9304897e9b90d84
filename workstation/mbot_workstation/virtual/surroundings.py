"""What a virtual robot's sensors have around them: a floor or a table, walls, things."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from mbot_workstation.sim.body.feelers import Feelers, Segment
from mbot_workstation.sim.pose import Pose


class FeelingBoard(Protocol):
    """A board whose firmware reads sensors."""

    def feel(self, floor: tuple[bool, bool], echo_m: float) -> None:
        """What both infrared pairs see from now on, and how far the echo is; 0: none."""
        ...


@dataclass(slots=True)
class Surroundings:
    """Of one robot.

    Attributes:
        wall_m: the arena's walls stand at this |x| and |y|.
        reaches_m: of each kind of object, from its middle.
        table_m: width along x and depth along y of the table it stands on; None: on the floor.
        feelers: where its sensors sit.
        track_m: between its wheels.
        has_fallen: whether a wheel has left the table.

    """

    wall_m: float
    reaches_m: tuple[float, ...]
    table_m: tuple[float, float] | None = None
    feelers: Feelers = field(default_factory=Feelers)
    track_m: float = 0.115
    has_fallen: bool = False

    def has_floor(self, x_m: float, y_m: float) -> bool:
        """Whether there is anything to stand on."""
        if self.table_m is None:
            return True
        return abs(x_m) <= self.table_m[0] / 2 and abs(y_m) <= self.table_m[1] / 2

    def tell(self, board: FeelingBoard, robot: Pose, objects: Sequence[tuple[int, Pose]]) -> None:
        """Let a board feel what is around the robot now; objects by their kind."""
        wheels = (robot.point(0.0, side * self.track_m / 2) for side in (1, -1))
        self.has_fallen = self.has_fallen or not all(self.has_floor(*wheel) for wheel in wheels)
        board.feel(
            self.feelers.has_floor(robot, self.has_floor),
            self.feelers.echo_m(robot, [*self._walls(), *self._faces(robot, objects)]),
        )

    def _walls(self) -> list[Segment]:
        far = self.wall_m
        corners = [(far, far), (-far, far), (-far, -far), (far, -far)]
        return list(zip(corners, corners[1:] + corners[:1], strict=True))

    def _faces(self, robot: Pose, objects: Sequence[tuple[int, Pose]]) -> list[Segment]:
        """Each thing as a board that faces the robot: corners and curves send an echo back."""
        faces: list[Segment] = []
        for kind, pose in objects:
            away = math.atan2(pose.y_m - robot.y_m, pose.x_m - robot.x_m)
            reach = self.reaches_m[kind]
            front = Pose(pose.x_m, pose.y_m, away)
            faces.append((front.point(-reach, -reach), front.point(-reach, reach)))
        return faces
