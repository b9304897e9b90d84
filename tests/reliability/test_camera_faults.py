"""Rows of the fault table: camera stalls or dies; black, frozen, wrong-shape frames."""

import time
from collections.abc import Callable

import pytest

from ..end_to_end.processes import Daemon
from ..robot.fake_board import FakeBoard
from .effort import REPEATS
from .faulty_camera import HEIGHT_PX, WIDTH_PX, FaultyCamera, Mood
from .motion import FORWARD, FORWARD_BOARD, configure, driven_since, driving, stopped_s

Record = Callable[[str, object], None]

LONGEST_BACK_OFF_S = 2.5
"""So long the camera is away: the daemon's attempts have then become as rare as they do."""


@pytest.mark.timeout(300)
@pytest.mark.parametrize("end", ["stalls", "dies"])
def test_the_robot_stops_for_a_camera_that_ends_and_drives_on_with_it(
    daemon: Daemon, board: FakeBoard, end: str, record_property: Record
) -> None:
    stopped_ms: list[float] = []
    recovered_s: list[float] = []
    with FaultyCamera(daemon.camera_port) as camera, driving(daemon, board, daemon.start()):
        for _ in range(REPEATS):
            last_s = camera.change("silent") if end == "stalls" else camera.die()
            assert board.wait_for(0, 0, timeout_s=10)
            time.sleep(LONGEST_BACK_OFF_S)
            stopped_ms.append((stopped_s(board, last_s) - last_s) * 1000)
            back_s = time.monotonic()
            if end == "stalls":
                camera.change("good")
            else:
                camera.revive()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=30)
            recovered_s.append(time.monotonic() - back_s)
            time.sleep(0.5)
    record_property("stopped ms", round(max(stopped_ms)))
    record_property("recovered s", round(max(recovered_s), 2))
    assert max(stopped_ms) < 3000
    assert max(recovered_s) < 20


@pytest.mark.timeout(300)
@pytest.mark.parametrize("mood", ["black", "frozen", "wrong-shape"])
def test_nothing_is_driven_by_a_bad_picture(
    daemon: Daemon, board: FakeBoard, mood: Mood, record_property: Record
) -> None:
    # As for a real sensor, whose noise makes each picture different.
    shape = f"width_px = {WIDTH_PX}\nheight_px = {HEIGHT_PX}"
    configure(daemon, "camera", f'identical_frames = "refuse"\n{shape}')
    stopped_ms: list[float] = []
    with FaultyCamera(daemon.camera_port, mood) as camera, daemon.start():
        assert daemon.is_up()
        daemon.push(FORWARD)
        time.sleep(0.5)
        daemon.run()
        time.sleep(2.0)
        kinds = {fault.kind for fault in daemon.status().faults}
        assert kinds == {f"camera-{mood}"}
        record_property("motor frames", driven_since(board, 0.0))
        assert not board.moved
        for _ in range(REPEATS):
            camera.reopen("good")
            assert board.wait_for(*FORWARD_BOARD, timeout_s=30)
            last_s = camera.change(mood)
            assert board.wait_for(0, 0, timeout_s=10)
            time.sleep(1.0)
            stopped_ms.append((stopped_s(board, last_s) - last_s) * 1000)
    record_property("stopped ms", round(max(stopped_ms)))
    assert max(stopped_ms) < 3000
