"""Makes a simulated robot another one without compiling the scene anew.

Only the robot is compiled, which takes half a millisecond, by the same `add_robot` as always; its
numbers are then copied into the running model. So there is no second set of formulas for what a
wheel radius or a time constant means to MuJoCo.
"""

from collections.abc import Sequence

from mbot_workstation.sim.body.robot_mjcf import (
    ROBOT,
    ROBOT_CAMERA,
    WHEELS,
    add_robot,
    floor_frictions,
)
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import MjModel, mujoco
from mbot_workstation.sim.simulation import Simulation

_OF_BODIES = (
    "body_pos",
    "body_quat",
    "body_ipos",
    "body_iquat",
    "body_mass",
    "body_subtreemass",
    "body_inertia",
    "body_invweight0",
)
_OF_GEOMS = ("geom_size", "geom_aabb", "geom_rbound", "geom_pos", "geom_quat")
_OF_JOINTS = ("jnt_pos", "jnt_axis", "qpos0", "qpos_spring")
_OF_DOFS = (
    "dof_armature",
    "dof_damping",
    "dof_frictionloss",
    "dof_invweight0",
    "dof_M0",
    "dof_length",
)
_OF_ACTUATORS = (
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_dynprm",
    "actuator_acc0",
    "actuator_forcerange",
)
_OF_CAMERAS = (
    "cam_pos",
    "cam_quat",
    "cam_pos0",
    "cam_poscom0",
    "cam_mat0",
    "cam_fovy",
    "cam_resolution",
    "cam_sensorsize",
    "cam_intrinsic",
)


def swap_body(simulation: Simulation, robot: RobotParameters) -> None:
    """Give a simulation another robot, with the same parts, in the same room.

    Place the robot anew afterwards, unless its measures stay the same.
    """
    spec = mujoco.MjSpec()
    add_robot(spec, robot)
    swapped = spec.compile()
    _copy_robot(swapped, simulation.model)
    for name, friction in floor_frictions(robot).items():
        simulation.model.pair(name).friction = friction
    simulation.robot = robot


def _copy_robot(source: MjModel, target: MjModel) -> None:
    _copy(source, target, _OF_BODIES, _bodies(source), _bodies(target))
    _copy(source, target, _OF_GEOMS, _geoms(source), _geoms(target))
    everything = slice(None)  # nothing but the robot has joints and motors
    for names in (_OF_JOINTS, _OF_DOFS, _OF_ACTUATORS):
        _copy(source, target, names, everything, everything)
    cameras = [slice(i, i + 1) for i in (m.camera(ROBOT_CAMERA).id for m in (source, target))]
    _copy(source, target, _OF_CAMERAS, cameras[0], cameras[1])
    target.body_subtreemass[0] = source.body_subtreemass[0]  # all that moves is the robot
    target.stat.meaninertia = source.stat.meaninertia


def _copy(
    source: MjModel, target: MjModel, names: Sequence[str], rows_from: slice, rows_to: slice
) -> None:
    for name in names:
        getattr(target, name)[rows_to] = getattr(source, name)[rows_from]


def _bodies(model: MjModel) -> slice:
    """The robot's bodies: the base and the wheels below it, which follow it."""
    first = model.body(ROBOT).id
    return slice(first, first + 1 + len(WHEELS))


def _geoms(model: MjModel) -> slice:
    bodies = _bodies(model)
    first = model.body_geomadr[bodies.start]
    return slice(first, first + int(model.body_geomnum[bodies].sum()))


def robot_geoms(model: MjModel) -> range:
    """The ids of the robot's own shapes."""
    geoms = _geoms(model)
    return range(geoms.start, geoms.stop)
