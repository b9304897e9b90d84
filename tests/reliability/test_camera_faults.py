"""Rows of the fault table: camera stalls or dies; black, frozen, wrong-shape frames."""

import time
from collections.abc import Callable

import pytest

from ..end_to_end.processes import LONGER_THAN_FORGIVEN_S, Daemon, beats_on, until
from ..promised import promised
from ..robot.fake_board import FakeBoard
from .effort import second_worst, within
from .faulty_camera import HEIGHT_PX, WIDTH_PX, FaultyCamera, Mood
from .motion import (
    FORWARD,
    FORWARD_BOARD,
    configure,
    driven_since,
    drives_again,
    driving,
    stopped_s,
)

Record = Callable[[str, object], None]


@pytest.mark.timeout(300)
@pytest.mark.parametrize("end", ["stalls", "dies"])
def test_the_robot_stops_for_a_camera_that_ends(
    daemon: Daemon, board: FakeBoard, end: str, record_property: Record
) -> None:
    """For longer than is forgiven: with the camera back it is ready, and waits for a word."""
    recovered_s: list[float] = []
    with FaultyCamera(daemon.camera_port) as camera, driving(daemon, board, daemon.start()):

        def stopped_ms() -> float:
            last_s = camera.change("silent") if end == "stalls" else camera.die()
            assert board.wait_for(0, 0, timeout_s=10)
            time.sleep(LONGER_THAN_FORGIVEN_S)
            found_ms = (stopped_s(board, last_s) - last_s) * 1000
            back_s = time.monotonic()
            if end == "stalls":
                camera.change("good")
            else:
                camera.revive()
            assert until(lambda: not daemon.status().faults, 30)
            recovered_s.append(time.monotonic() - back_s)
            assert beats_on(daemon.status, 1)
            assert not driven_since(board, back_s)
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=30)
            return found_ms

        found = within(promised("camera-stopped"), stopped_ms)
    record_property("stopped ms", round(max(found)))
    record_property("recovered s", round(max(recovered_s), 2))
    assert second_worst(recovered_s) <= promised("camera-recovered")


@pytest.mark.timeout(300)
def test_a_short_gap_of_the_camera_is_forgiven(
    daemon: Daemon, board: FakeBoard, record_property: Record
) -> None:
    with FaultyCamera(daemon.camera_port) as camera, driving(daemon, board, daemon.start()):

        def recovered_s() -> float:
            camera.change("silent")
            assert board.wait_for(0, 0, timeout_s=10)
            time.sleep(0.5)
            back_s = time.monotonic()
            camera.change("good")
            assert board.wait_for(*FORWARD_BOARD, timeout_s=30)
            return time.monotonic() - back_s

        found = within(promised("short-gap-driven-on"), recovered_s)
        assert daemon.status().last_stop.count == 1
    record_property("drives on s", round(max(found), 2))


@pytest.mark.timeout(300)
@pytest.mark.parametrize("mood", ["black", "frozen", "wrong-shape"])
def test_nothing_is_driven_by_a_bad_picture(
    daemon: Daemon, board: FakeBoard, mood: Mood, record_property: Record
) -> None:
    # As for a real sensor, whose noise makes each picture different.
    shape = f"width_px = {WIDTH_PX}\nheight_px = {HEIGHT_PX}"
    configure(daemon, "camera", f'identical_frames = "refuse"\n{shape}')
    with FaultyCamera(daemon.camera_port, mood) as camera, daemon.start():

        def is_named() -> bool:
            return {fault.kind for fault in daemon.status().faults} == {f"camera-{mood}"}

        assert daemon.is_up()
        daemon.push(FORWARD)
        assert until(is_named)
        daemon.run()
        assert beats_on(daemon.status)
        assert is_named()
        frames = driven_since(board, 0.0)
        record_property("motor frames", frames)
        assert frames == promised("bad-picture-driven")

        def stopped_ms() -> float:
            camera.reopen("good")
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=30)
            last_s = camera.change(mood)
            assert board.wait_for(0, 0, timeout_s=10)
            assert beats_on(daemon.status)
            return (stopped_s(board, last_s) - last_s) * 1000

        found = within(promised("camera-stopped"), stopped_ms)
        camera.reopen("good")
        assert drives_again(daemon, board)
    record_property("stopped ms", round(max(found)))
