"""One simulated robot in its room: drive it, step it, move things, ask where it is."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.motor import wheel_voltages
from mbot_workstation.sim.body.robot_mjcf import ROBOT, WHEELS
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import MjData, MjModel, mujoco
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.floor_textures import FloorTexture
from mbot_workstation.sim.scene.object_mjcf import BELOW_M, object_name, shadow_name
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_mjcf import ROOM, build_model
from mbot_workstation.sim.scene.scene_parameters import SceneParameters


@dataclass(frozen=True, slots=True)
class SceneState:
    """What there is to see at one moment: all a picture needs, and nothing that moves on.

    Attributes:
        joints: MuJoCo's qpos, shape (nq,).
        moved_pos, moved_quat: of each kind of object and its shadow, and of the room; shapes
            (2 k + 1, 3) and (2 k + 1, 4).

    """

    joints: NDArray[np.float64]
    moved_pos: NDArray[np.float64]
    moved_quat: NDArray[np.float64]

    @property
    def robot(self) -> Pose:
        """Where the robot was, on a level floor."""
        x_m, y_m, _, w, _, _, z = self.joints[:7].tolist()
        return Pose(x_m, y_m, 2 * math.atan2(z, w))


class Simulation:
    """Physics of one robot, without pictures, tasks or real time.

    Attributes:
        robot, scene: what was simulated.
        model: the MuJoCo model; a renderer needs it.

    """

    def __init__(
        self,
        robot: RobotParameters | None = None,
        scene: SceneParameters | None = None,
        room_picture: Picture | None = None,
        floors: Sequence[FloorTexture] = (),
    ) -> None:
        self.robot = robot or RobotParameters()
        self.scene = scene or SceneParameters()
        if room_picture is None:
            room_picture = generate_room(seed=0, room=self.scene.room)
        self.model: MjModel = build_model(self.robot, self.scene, room_picture, floors)
        self._data: MjData = mujoco.MjData(self.model)
        self._owed_s = 0.0
        wheels = [self.model.joint(name).dofadr[0] for name in WHEELS]
        self._wheel_dofs = np.array(wheels)
        self._base: int = self.model.body(ROBOT).id
        kinds = range(len(self.scene.objects))
        self._objects = [int(self.model.body(object_name(kind)).mocapid[0]) for kind in kinds]
        self._shadows = [int(self.model.body(shadow_name(kind)).mocapid[0]) for kind in kinds]
        self._room: int = self.model.body(ROOM).mocapid[0]
        self.place_robot(ORIGIN)

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return float(self._data.time)

    @property
    def pose(self) -> Pose:
        """Where the axle's centre is, and where the robot heads."""
        forward = self._data.xmat[self._base].reshape(3, 3)[:, 0]
        x, y, _ = self._data.xpos[self._base]
        return Pose(float(x), float(y), math.atan2(forward[1], forward[0]))

    @property
    def wheel_speeds_rad_s(self) -> tuple[float, float]:
        """Left and right wheel, positive rolls forward."""
        left, right = self._data.qvel[self._wheel_dofs]
        return float(left), float(right)

    @property
    def turn_rate_rad_s(self) -> float:
        """How fast the robot turns, positive to the left."""
        return float(self._data.qvel[5])  # of the free joint, about the body's own z

    def set_duty(self, left: float, right: float, supply_share: float = 1.0) -> None:
        """Set both motors' PWM duty in [-1, 1], positive is forward; it holds until changed.

        `supply_share` is what a sagging battery leaves of the supply's voltage.
        """
        left_v, right_v = wheel_voltages(left, right, self.robot)
        self._data.ctrl[:2] = left_v * supply_share, right_v * supply_share

    def step(self, duration_s: float) -> None:
        """Advance by whole time steps; what is left over counts towards the next call."""
        self._owed_s += duration_s
        timestep_s: float = self.model.opt.timestep
        steps = round(self._owed_s / timestep_s)
        self._owed_s -= steps * timestep_s
        if steps > 0:
            mujoco.mj_step(self.model, self._data, steps)

    def place_robot(self, pose: Pose) -> None:
        """Put the robot down, standing still, motors off."""
        half = pose.yaw_rad / 2
        self._data.qpos[:] = 0
        self._data.qpos[:7] = (pose.x_m, pose.y_m, 0, math.cos(half), 0, 0, math.sin(half))
        self._data.qvel[:] = 0
        self._data.qacc_warmstart[:] = 0
        self._data.ctrl[:] = 0
        self._owed_s = 0.0
        mujoco.mj_forward(self.model, self._data)

    def push(self, x_m: float, y_m: float) -> Pose:
        """Move the robot sideways as it drives, by what it can't drive through; where it is now."""
        pose = self.pose
        self._data.qpos[:2] += x_m, y_m
        self._data.xpos[self._base, :2] += x_m, y_m
        return replace(pose, x_m=pose.x_m + x_m, y_m=pose.y_m + y_m)

    def place_objects(self, places: Mapping[int, Pose]) -> None:
        """Put objects, by their index in the scene, onto the floor, and take the others away."""
        for number, (thing, shadow) in enumerate(zip(self._objects, self._shadows, strict=True)):
            pose = places.get(number)
            where = (0.0, 0.0, BELOW_M) if pose is None else (pose.x_m, pose.y_m, 0.0)
            self._data.mocap_pos[thing] = self._data.mocap_pos[shadow] = where
            self._data.mocap_quat[thing] = _yaw_quaternion(0.0 if pose is None else pose.yaw_rad)

    def place_object(self, pose: Pose, number: int = 0) -> None:
        """Put this object there, and take all others away."""
        self.place_objects({number: pose})

    def turn_room(self, yaw_rad: float) -> None:
        """Turn the panorama so that its middle column lies in this direction."""
        self._data.mocap_quat[self._room] = _yaw_quaternion(yaw_rad)

    def snapshot(self) -> SceneState:
        """A copy of what there is to see, for a renderer in this or another thread."""
        return SceneState(
            self._data.qpos.copy(), self._data.mocap_pos.copy(), self._data.mocap_quat.copy()
        )


def _yaw_quaternion(yaw_rad: float) -> tuple[float, float, float, float]:
    return (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
