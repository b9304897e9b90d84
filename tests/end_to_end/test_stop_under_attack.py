"""Others' STOPs while somebody who may only look reads nothing, asks too much, or is gone."""

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from itertools import pairwise
from pathlib import Path

import pytest

from mbot_protocol.errors import MbotError
from mbot_protocol.wire.keys import CHUNK_BYTES, Right
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.models.push import push as push_model

from ..promised import promised
from ..reliability.effort import second_worst
from ..reliability.motion import driven_since
from ..reliability.test_self_watch import service_manager
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .deaf_viewer import DRIVE, FILE
from .fleet import LOCALHOST, Fleet
from .processes import HERE, ROBOT_ID, Daemon, Process

Record = Callable[[str, object], None]

FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)
ATTACK_S = 12
STOPS_EVERY_S = 0.5


@pytest.fixture
def enrolled(tmp_path: Path, board: FakeBoard) -> tuple[Daemon, Fleet]:
    """Vera may look; dora may drive."""
    daemon = Daemon(tmp_path, board.path)
    fleet = Fleet(tmp_path / "fleet")
    fleet.enrol(ROBOT_ID, {"vera": [Right.VIEW], "dora": [Right.DRIVE, Right.PUSH]})
    daemon.address = f"{LOCALHOST}:{fleet.ports[ROBOT_ID]}"
    (tmp_path / "enrolment.toml").write_text(fleet.enrolment_text(ROBOT_ID))
    recorded = tmp_path / "recordings" / DRIVE / FILE
    recorded.parent.mkdir(parents=True)
    recorded.write_bytes(bytes(2 * CHUNK_BYTES))
    return daemon, fleet


def push(daemon: Daemon, fleet: Fleet) -> None:
    path = daemon.directory / "model.onnx"
    path.write_bytes(FORWARD)
    with fleet.link(ROBOT_ID, "dora") as link:
        push_model(link, path, lambda _: daemon.key)


@pytest.mark.timeout(120)
@pytest.mark.parametrize("attacker", ["deaf_viewer.py", "stop_flood.py", "vanished_viewer.py"])
def test_no_viewer_keeps_anybody_elses_stop_from_being_confirmed(
    enrolled: tuple[Daemon, Fleet],
    board: FakeBoard,
    attacker: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    record_property: Record,
) -> None:
    daemon, fleet = enrolled
    vera = fleet.security("vera")
    program = [str(HERE / attacker), daemon.address, ROBOT_ID, str(ATTACK_S)]
    program += [str(path) for path in (vera.ca, vera.certificate, vera.key)]
    with service_manager(daemon.directory) as (environment, heard), daemon.camera():
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        with daemon.start() as process, ExitStack() as stack:
            assert daemon.is_up()
            push(daemon, fleet)
            control = RemoteControl(stack.enter_context(fleet.link(ROBOT_ID, "dora")))
            found = Found()
            log = tmp_path / "attack.log"
            with Process(sys.executable, *program, log=log) as attack:
                until_s = time.monotonic() + ATTACK_S
                while time.monotonic() < until_s:
                    found.stop(control, board)
                    if any("WATCHDOG=1" in line for line in heard()):
                        found.fed_s.append(time.monotonic())
                    time.sleep(STOPS_EVERY_S)
                assert attack.wait(30) == 0
            assert process.is_running()
    record_property("STOP worst ms", round(max(found.confirmed_ms), 1))
    record_property("STOP second worst ms", round(second_worst(found.confirmed_ms), 1))
    record_property("drive frames after STOP", sum(found.driven_after))
    record_property("watchdog unfed s", round(found.unfed_s, 1))
    assert second_worst(found.confirmed_ms) <= promised("stop-under-attack")
    # STOP_TIMEOUT_S: none had to be said twice.
    assert max(found.confirmed_ms) < promised("stop-under-attack-worst")
    assert sum(found.driven_after) == promised("driven-under-attack")
    assert found.unfed_s < 3


class Found:
    """What somebody sees who sets the robot in motion and stops it, again and again."""

    def __init__(self) -> None:
        self.confirmed_ms: list[float] = []
        self.driven_after: list[int] = []
        self.fed_s = [time.monotonic()]

    def stop(self, control: RemoteControl, board: FakeBoard) -> None:
        with suppress(MbotError):  # STOPs may be raining down
            control.run()
            board.wait_for(*FORWARD_BOARD, timeout_s=0.5)
        asked_s = time.monotonic()
        assert control.stop() == "stopped"
        self.confirmed_ms.append((time.monotonic() - asked_s) * 1000)
        self.driven_after.append(driven_since(board, asked_s + 0.1))

    @property
    def unfed_s(self) -> float:
        """The longest time without a word to the watchdog, as often as it was looked."""
        return max(later - one for one, later in pairwise(self.fed_s))
