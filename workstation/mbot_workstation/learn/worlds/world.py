"""One robot at its task, decision by decision, with every effect on the way.

Time runs as on the robot: at a decision's tick the newest picture is already a latency old, and
the command reaches the wheels a latency later. Nothing is drawn here: a world says which moment
the policy sees, so only such moments cost a picture.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbot_protocol.drive.actions import to_steps
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_workstation.learn.worlds.body_swap import robot_geoms, swap_body
from mbot_workstation.learn.worlds.fast_physics import PLACEHOLDER, hasten, hide, placeholders
from mbot_workstation.learn.worlds.robot_camera import Glimpse, RobotCamera
from mbot_workstation.learn.worlds.world_settings import WorldSettings
from mbot_workstation.sim.body.motor import pwm_duties
from mbot_workstation.sim.body.own_view import parts_in_view
from mbot_workstation.sim.body.robot_mjcf import part_name
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.frame_edges import FrameEdges
from mbot_workstation.sim.effects.body_record import body_record
from mbot_workstation.sim.effects.effects import IDEAL, RealWorldEffects
from mbot_workstation.sim.effects.home_looks import draw_home
from mbot_workstation.sim.effects.perturbed_robot import (
    observing_camera,
    perturbed_robot,
    perturbed_wheel_maps,
)
from mbot_workstation.sim.effects.scene_looks import draw_look
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import SceneDresser, SceneLook, nominal_look
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.tasks.episode import DECISION_S, NOTHING, Moment, Setting
from mbot_workstation.tasks.find import find_task
from mbot_workstation.tasks.lesson import Lesson
from mbot_workstation.tasks.task import Task

CONTACT_GRID_S = 0.020
"""Where something can happen it is looked for this often: every 8 mm at full speed."""

FASTEST_M_S = 0.6
"""No robot of any preset drives faster: until that speed can bridge the gap, nothing is met. A
calibrated one may."""

OVERSHOOT = 1.1
"""Of a robot's free speed, for its front is further out than its wheels."""

CHANGING = (
    *("left_gain", "right_gain", "speed_scale", "dead_band_scale", "friction_scale"),
    "camera_latency_ms",
)
"""Effects of a robot that changes on the way: a battery, a gear, another floor, a busy computer."""

USUAL_TURN_RAD_S = 1.2
"""Standard deviation of a scattered robot's turn rate; a search turn has about 2 at its fastest."""

SLACK_S = 1e-6
"""Sums of decimal seconds are not exact."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a decision brought.

    Attributes:
        reward: sum of the task's scores.
        happening: the last thing that happened in it, in the task's words.
        ended: whether the episode is over.

    """

    reward: float = 0.0
    happening: str = NOTHING
    ended: bool = False


class World:
    """Robot, arena and task of one environment; `seed` and `begin` it before anything else.

    Attributes:
        task: what the robot is to do.
        episode: of it.
        room: index of the room around the robot.
        lesson: of the episode.
        glimpse: the moment the next observation shows.
        camera: makes the observation of it.

    """

    def __init__(self, settings: WorldSettings) -> None:
        self.task = find_task(settings.task)
        self._ranges = settings.ranges
        self._rooms = len(settings.rooms)
        # The robot's daemon knows its calibrated camera: what the policy sees is free of it, but
        # for the rim that the camera's frames do not reach.
        self._edges = FrameEdges(settings.robot.camera)
        self._nominal = replace(settings.robot, camera=observing_camera(IDEAL))
        self.simulation = Simulation(
            self._nominal, settings.scene, PLACEHOLDER, placeholders(settings.floors)
        )
        hasten(self.simulation.model)
        seen = parts_in_view(self._nominal, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg)
        model = self.simulation.model
        hide(model, [i for i in robot_geoms(model) if part_name(model, i) not in seen])
        self._objects = settings.scene.objects
        self._nominal_look = nominal_look(settings.scene)
        self._dresser = SceneDresser(self.simulation.model, 1 + len(settings.floors), self._objects)

    def seed(self, rng: np.random.Generator) -> None:
        """Take all random numbers from here on from this generator."""
        self._rng = rng
        self.camera = RobotCamera(int(rng.integers(2**32)), self._edges)
        self._effects: RealWorldEffects | None = None

    def begin(self, lesson: Lesson) -> None:
        """Start an episode: another robot in another room, standing in the origin."""
        effects = lesson.draw_robot(self._ranges, self._rng)
        if effects != self._effects:
            self._become(effects)
        self._change = self._draw_change(lesson, effects)
        look = self._draw_look(effects, lesson.lookalikes)
        self.lesson = lesson
        self.room = int(self._rng.integers(self._rooms))
        self.camera.begin(self._rng.uniform(0, 2 * math.pi))
        setting = Setting(
            contact_radius_m=self._nominal.touch_radius_m,
            border_m=self.simulation.scene.arena.border_m,
            footprints=tuple(
                thing.footprint.scaled(worn.scale)
                for thing, worn in zip(self._objects, look.objects, strict=True)
            ),
            standing=look.standing,
        )
        self.episode = self.task.begin(lesson, setting, self._rng)
        look = look.furnished(self.task.pieces(self.episode))
        self._dresser.wear(look, effects.cube_brightness, effects.floor_brightness)
        self._pose = ORIGIN
        self.simulation.place_robot(ORIGIN)
        self._place_objects()
        self._decisions = 0
        self._now_s = 0.0
        self._commands: deque[tuple[float, float, float]] = deque()
        self._glimpses: deque[Glimpse] = deque()
        self._looks = 0
        self._plan_look()
        self._look_if_due()
        self.glimpse = self._glimpses.popleft()

    @property
    def body(self) -> tuple[float, ...]:
        """What the robot makes of its commands: a BODY_RECORD."""
        return self._body

    @property
    def robot(self) -> Pose:
        """Where the robot is."""
        return self._pose

    def facts(self) -> tuple[Any, ...]:
        """What the task says of itself now: its `facts`."""
        return self.episode.facts(
            Moment(
                robot=self._pose,
                now_s=self._now_s,
                seen_from=self.glimpse.state.robot,
                seen_s=self.glimpse.time_s,
                camera_ahead_m=self.simulation.robot.camera_mount.ahead_m,
            )
        )

    def info(self, outcome: Outcome | None = None) -> dict[str, Any]:
        """What an environment says beside observation and reward: see `info_of`."""
        happening = NOTHING if outcome is None else outcome.happening
        return info_of(self.task, self.facts(), happening, self.lesson.name)

    def scatter(self) -> None:
        """Be where a picture may be taken, perhaps in a turn; nothing drives until `begin`."""
        sight, rng = self.task.sight, self._rng
        if sight is None:
            raise RuntimeError(f"the task {self.task.name} says nothing of its pictures")
        self._pose = sight.scatter(self.episode, rng)
        self.simulation.place_robot(self._pose)
        self._place_objects()
        self._now_s += DECISION_S
        turn_rate_rad_s = rng.normal(0, USUAL_TURN_RAD_S) if rng.random() < 0.5 else 0.0
        self.glimpse = Glimpse(self.simulation.snapshot(), turn_rate_rad_s, self._now_s)

    def decide(self, left: float, right: float) -> Outcome:
        """Carry out one decision of 0.4 s.

        Args:
            left, right: the policy's action; beyond [-1, 1] is clipped.

        """
        if self.episode.ended:
            raise RuntimeError("the episode has ended: begin() another one")
        if self._change is not None and self._decisions == self._change[0]:
            self._embody(self._change[1])
        end_s = (self._decisions + 1) * DECISION_S
        self._command(left, right)
        reward, happening = 0.0, NOTHING
        while self._now_s < end_s - SLACK_S:
            score, event = self._advance(min(end_s, self._next_s()))
            reward += score
            happening = happening if event == NOTHING else event
            if self.episode.ended:
                self.glimpse = self._look()
                return Outcome(reward, happening, ended=True)
            self._obey_if_due()
            self._look_if_due()
        self._decisions += 1
        self.glimpse = self._glimpses.popleft()
        return Outcome(reward, happening, ended=False)

    def _draw_change(
        self, lesson: Lesson, effects: RealWorldEffects
    ) -> tuple[int, RealWorldEffects] | None:
        """After which decision this robot becomes which other one, if it does."""
        drawn = lesson.draw_change(self._ranges, self._rng)
        if drawn is None:
            return None
        after, other = drawn
        return after, replace(effects, **{name: getattr(other, name) for name in CHANGING})

    def _become(self, effects: RealWorldEffects) -> None:
        robot = self._embody(effects)
        self.camera.become(effects, robot.camera_mount.pitch_down_deg)

    def _embody(self, effects: RealWorldEffects) -> RobotParameters:
        """Give the robot another body, wherever it is and however fast it drives."""
        robot = perturbed_robot(self._nominal, effects)
        swap_body(self.simulation, robot)
        self._wheels = perturbed_wheel_maps(robot.wheel_maps, effects)
        gain = max(robot.left_motor.gain, robot.right_motor.gain)
        free_m_s = robot.free_speed_rad_s * robot.wheel_radius_m * gain
        self._fastest_m_s = max(FASTEST_M_S, free_m_s * OVERSHOOT)
        self._effects = effects
        self._body = body_record(effects, self._nominal)
        return robot

    def _draw_look(self, effects: RealWorldEffects, lookalikes: float) -> SceneLook:
        variety, clutter = effects.scene_variety, effects.clutter
        if variety <= 0 or self._rng.random() >= variety:
            return self._nominal_look
        if clutter > 0 and self._rng.random() < clutter:
            return draw_home(self._rng, self._objects)
        return draw_look(self._rng, self._objects, lookalikes)

    def _command(self, left: float, right: float) -> None:
        effects = self._known_effects
        told = self._wheels.duties(to_steps(left, right))
        wait_ms = effects.action_latency_ms + self._rng.random() * effects.action_jitter_ms
        due_s = self._decisions * DECISION_S + wait_ms / 1000
        if self._commands:  # a line keeps its order
            due_s = max(due_s, self._commands[-1][0])
        self._commands.append((due_s, *pwm_duties(told)))
        self._obey_if_due()

    def _obey_if_due(self) -> None:
        while self._commands and self._commands[0][0] <= self._now_s + SLACK_S:
            _, left, right = self._commands.popleft()
            draw = (abs(left) + abs(right)) / 2
            sag = self._known_effects.battery_sag
            self.simulation.set_duty(left, right, supply_share=1 - sag * draw)

    def _plan_look(self) -> None:
        """When the picture for the next decision is taken that has none yet."""
        effects = self._known_effects
        age_ms = effects.camera_latency_ms + self._rng.random() * effects.frame_interval_ms
        self._look_s = self._looks * DECISION_S - age_ms / 1000
        self._looks += 1

    def _look_if_due(self) -> None:
        while self._look_s <= self._now_s + SLACK_S:
            self._glimpses.append(self._look())
            self._plan_look()

    def _look(self) -> Glimpse:
        simulation = self.simulation
        return Glimpse(simulation.snapshot(), simulation.turn_rate_rad_s, self._now_s)

    def _next_s(self) -> float:
        return min(self._look_s, self._commands[0][0]) if self._commands else self._look_s

    def _advance(self, until_s: float) -> tuple[float, str]:
        """Drive until then, or until the episode ends; the scores and what happened last."""
        episode, score, happening = self.episode, 0.0, NOTHING
        while (left_s := until_s - self._now_s) > SLACK_S:
            way_m = episode.free_way_m(self._pose)
            step_s = min(left_s, max(CONTACT_GRID_S, way_m / self._fastest_m_s))
            self.simulation.step(step_s)
            self._now_s += step_s
            self._pose = self.simulation.pose
            step = episode.advance(self._pose, step_s)
            score += step.score
            happening = happening if step.happening == NOTHING else step.happening
            if step.ended:
                break
            if step.robot_to_origin:
                self.simulation.place_robot(ORIGIN)
                self._pose = ORIGIN
            elif step.pushed_m != (0.0, 0.0):
                self._pose = self.simulation.push(*step.pushed_m)
            if step.happening != NOTHING and self.episode.places() != self._places:
                self._place_objects()
        return score, happening

    def _place_objects(self) -> None:
        self._places = self.episode.places()
        self.simulation.place_objects(self._places)
        self.simulation.turn_room(self._rng.uniform(-math.pi, math.pi))

    @property
    def _known_effects(self) -> RealWorldEffects:
        if self._effects is None:
            raise RuntimeError("begin() an episode first")
        return self._effects


def info_of(task: Task, facts: Sequence[Any], happening: str, lesson: str) -> dict[str, Any]:
    """The info dictionary after a step: the task's facts, what happened, the lesson's name."""
    assert task.facts.names is not None
    known = dict(zip(task.facts.names, facts, strict=True))
    return {**known, "happening": str(happening), "lesson": lesson}
