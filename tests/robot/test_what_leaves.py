"""Whatever a policy answers, at whatever state of link, board and camera: what leaves is a frame
that the firmware takes, or the wheels stand. And so with every drive that was kept.
"""

import math
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mbot_agent.arming import Mode
from mbot_agent.faults import Fault
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.drive.actions import AS_BUILT, MotorMap, WheelMaps, to_steps
from mbot_protocol.drive.mcore import HEADER, Joystick
from mbot_protocol.drive.wheel_command import Duties, WheelCommand
from mbot_protocol.policy.policy import Policy

from .loop_bench import Bench
from .tiny_models import constant_model

KEPT = sorted((Path(__file__).parents[1] / "data").glob("recorded-drive*"))
WRONG = Fault("wrong", "as the test says")
ANSWERS = st.floats(width=32) | st.sampled_from([0.0, 1.0, -1.0, math.nan, math.inf, -math.inf])


def is_taken(duties: Duties, wheels: WheelMaps = AS_BUILT) -> bool:
    """By the firmware, as docs/mcore-protocol.md has its frames; tests/firmware asks itself."""
    frame = Joystick.of(wheels.at_motors(duties)).to_bytes()
    speeds = [int.from_bytes(frame[at : at + 2], "little", signed=True) for at in (6, 8)]
    head = HEADER + bytes((7, 0, 2, 5))
    return len(frame) == 10 and frame.startswith(head) and all(abs(s) <= 255 for s in speeds)


def in_force(bench: Bench) -> WheelCommand | None:
    """What the board has been told last, unless it was to stop."""
    return (
        None
        if not bench.board.asked or bench.board.asked[-1] == "stop"
        else (bench.board.commands[-1])
    )


@settings(max_examples=150)
@given(
    left=ANSWERS,
    right=ANSWERS,
    mode=st.sampled_from([Mode.IDLE, Mode.WAITING, Mode.RUNNING, Mode.STOPPED]),
    link=st.booleans(),
    board=st.booleans(),
    camera=st.booleans(),
    fresh=st.booleans(),
    reset=st.booleans(),
)
def test_a_frame_leaves_that_the_firmware_takes_or_the_wheels_stand(
    left: float,
    right: float,
    mode: Mode,
    *,
    link: bool,
    board: bool,
    camera: bool,
    fresh: bool,
    reset: bool,
) -> None:
    bench = Bench()
    bench.pilot.use(Policy(constant_model(left, right)))
    bench.tick()
    if mode in (Mode.WAITING, Mode.RUNNING):
        bench.helm.run(bench.stops, when_ready=mode is Mode.WAITING)
    elif mode is Mode.STOPPED:
        bench.run()
        bench.helm.stop()
    bench.link_fault = None if link else WRONG
    bench.board.fault = None if board else WRONG
    bench.camera.fault, bench.camera.fresh = None if camera else WRONG, fresh
    bench.board.resets += reset
    for _ in range(3):
        bench.tick()
    may = mode in (Mode.WAITING, Mode.RUNNING) and link and board and camera and not reset
    finite = math.isfinite(left) and math.isfinite(right)
    command = in_force(bench)
    assert (command is not None) == (may and finite)
    if command is not None:
        assert is_taken(command.duties)
        assert command.guard() is fresh
    assert all(is_taken(one) for one in bench.board.asked if isinstance(one, Duties))


@given(
    steps=st.tuples(*[st.floats(-1e9, 1e9)] * 2),
    trim=st.floats(0, 1, exclude_min=True),
    dead_band=st.integers(0, 200),
    reversed_too=st.booleans(),
)
def test_whatever_a_robots_calibration_is_the_frame_is_taken(
    steps: tuple[float, float], trim: float, dead_band: int, *, reversed_too: bool
) -> None:
    assume(dead_band < 255 * trim)
    motor = MotorMap(reversed_too, trim, dead_band)
    wheels = WheelMaps(motor, motor)
    assert is_taken(wheels.duties(to_steps(*steps)), wheels)


@pytest.mark.parametrize("kept", KEPT, ids=lambda path: path.name)
def test_kept_drives_go_through_todays_guard(kept: Path) -> None:
    """Each decision of then, decided again: the same frame to the board, or none where none was."""
    driven = 0
    for beat in read_drive(kept).beats:
        if not beat.decision.HasField("action"):
            continue
        bench = Bench()
        answer = beat.decision.action
        bench.pilot.use(Policy(constant_model(answer.left, answer.right)))
        bench.run()
        bench.tick()
        command = in_force(bench)
        assert command is not None
        assert is_taken(command.duties)
        board = beat.decision
        assert AS_BUILT.levels(command.duties) == (board.board_m1, board.board_m2)
        driven += 1
    assert driven > 10
