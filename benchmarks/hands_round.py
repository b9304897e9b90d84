"""Drives of a simulated robot with an oracle's hand, to learn from as from a real robot's.

    python benchmarks/hands_round.py MODEL.onnx drives --effect left_gain=0.55 --wrong 0.2
    python benchmarks/hands_round.py MODEL.onnx alone --effect left_gain=0.55 --alone

Writes recordings as a robot does, in one room, of robots of one kind. After 20 s without a touch
(`--patience`) the oracle takes over until the next one. `--wrong`: its wheels are anything in so
many beats. Then: `workstation drives keep`, `split`, `train --from RUN --drives`, `promote`.
"""

import argparse
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mbot_protocol.beat.beat import Beat, PolicyInput
from mbot_protocol.beat.channels import RobotFacts
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.drive.actions import AS_BUILT, to_steps
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_protocol.v1.messages_pb2 import Decision, State
from mbot_workstation.learn.drivers.contestants import driver, read_policy
from mbot_workstation.learn.worlds.rooms import EVALUATION_PHOTOGRAPHS, gather_rooms
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.effects.presets import preset

BEATS = 300
"""Two minutes."""

TASK_GOAL = 10
"""Objects of lesson 10."""

BEAT_NS = 400_000_000


def beat(number: int, robot: int, seen: np.ndarray, told: tuple[float, float], anew: bool) -> Beat:
    """What stands in a recording whoever drives."""
    at_ns = 1_700_000_000_000_000_000 + robot * 10**12 + number * BEAT_NS
    decision = Decision(schema_version=1, robot_id="mbot-1", session_id=robot + 1, sequence=number)
    decision.unix_time_ns, decision.started_monotonic_ns = at_ns, number * BEAT_NS + 1
    png = cv2.imencode(".png", cv2.cvtColor(seen, cv2.COLOR_RGB2BGR))[1].tobytes()
    view = FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg
    return Beat(decision, PolicyInput(True, anew, *told, b"", *view), encoded=png, is_exact=True)


@dataclass(frozen=True)
class Round:
    """What is asked for."""

    model: str
    folder: Path
    effects: EffectRanges
    drives: int
    wrong: float
    seed: int
    patience: int
    alone: bool


def drive(given: Round) -> str:
    """Record so many drives; what came of them."""
    drives, seed, ranges = given.drives, given.seed, given.effects
    rng = np.random.default_rng(seed)
    rooms = gather_rooms(EVALUATION_PHOTOGRAPHS[:1], 0, 0)
    policy, oracle = read_policy(given.model), driver("oracle", drives, seed, ranges)
    touches, lost, late = 0, 0, 0
    by_hand, idle = np.zeros(drives, bool), np.zeros(drives, int)
    anew, hands, told = np.ones(drives, bool), 0, np.zeros((drives, 2), np.float32)
    facts = RobotFacts("mbot-1", 1, "1", "x86", 2.5, AS_BUILT)
    with ExitStack() as stack:
        world = stack.enter_context(
            TaskVecEnv(drives, seed=seed, preset=ranges, rooms=rooms, lesson="10")
        )
        writers = []
        for robot in range(drives):
            place = given.folder / "mbot-1" / f"drive-{robot:04d}"
            place.mkdir(parents=True)
            writer = BeatWriter(place / "000.mcap", "mbot-1", "benchmark", facts)
            writers.append(writer)
            stack.callback(writer.close)
        seen: Any = world.reset()
        infos: list[dict[str, Any]] = list(world.reset_infos)
        counted = np.zeros(drives, int)
        for number in range(BEATS):
            answers = np.clip(policy.act(seen), -1, 1)
            shown = np.clip(oracle.act(seen, infos), -1, 1)
            mistaken = rng.random(drives) < given.wrong
            shown[mistaken] = rng.uniform(-1, 1, (int(mistaken.sum()), 2))
            wheels = np.where(by_hand[:, None], shown, answers)
            for robot, writer in enumerate(writers):
                left, right = told[robot].tolist()
                one = beat(number, robot, seen[robot], (left, right), bool(anew[robot]))
                finish(one.decision, wheels[robot], answers[robot], hand=bool(by_hand[robot]))
                writer.write(one)
            hands += int(by_hand.sum())
            seen, _, anew, stepped = world.step(wheels)
            policy.previous_actions = told = wheels.astype(np.float32)
            policy.forget(anew)
            told[anew] = 0
            now = np.array([int(info["touches"]) for info in stepped])
            touched = now > counted
            touches += int(touched.sum())
            lost += int((anew & (now < TASK_GOAL)).sum())
            idle = np.where(touched | anew, 0, idle + 1)
            late += int((idle == given.patience).sum())
            by_hand = (by_hand & ~(touched | anew)) | ((idle >= given.patience) & (not given.alone))
            counted = np.where(anew, 0, now)
            infos = [world.reset_infos[k] if anew[k] else info for k, info in enumerate(stepped)]
    objects = touches + lost
    return (
        f"{drives} drives, {objects} objects, {late} not touched in time "
        f"({late / max(1, objects):.0%}), {lost} never; {hands} of {drives * BEATS} beats by hand"
    )


def finish(decision: Decision, wheels: np.ndarray, answer: np.ndarray, *, hand: bool) -> None:
    """Who drove, and how."""
    steps = to_steps(*wheels.tolist())
    duties = AS_BUILT.duties(steps)
    decision.duty.left, decision.duty.right = duties.left, duties.right
    if hand:
        decision.state, decision.driven_by = State.STATE_MANUAL, "oracle"
        decision.would_have_done.left, decision.would_have_done.right = answer.tolist()
    else:
        decision.state = State.STATE_RUNNING
        decision.action.left, decision.action.right = answer.tolist()
        decision.steps.left, decision.steps.right = steps.left, steps.right


def main() -> None:
    """Record."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("model")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", default="nominal")
    parser.add_argument("--effect", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--alone", action="store_true", help="nobody takes over")
    parser.add_argument("--patience", type=int, default=50, help="decisions without a touch")
    parser.add_argument("--drives", type=int, default=10)
    parser.add_argument("--wrong", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=900)
    given = parser.parse_args()
    pairs = [text.partition("=") for text in given.effect]
    effects = preset(given.preset).changed(**{name: float(value) for name, _, value in pairs})
    known = (given.model, given.folder, effects, given.drives, given.wrong, given.seed)
    print(drive(Round(*known, given.patience, given.alone)), flush=True)


if __name__ == "__main__":
    main()
