"""Thousands of decisions among random faults: nothing leaks, and every silence begins standing.

The real daemon at 100 decisions a second; 600 decisions in every run of the tests, 10,000 by
`make reliability`.
"""

import itertools
import random
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from signal import SIGTERM

import pytest

from mbot_protocol.errors import MbotError
from mbot_protocol.wire.keys import TOPICS, Flow
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.telemetry.stream import TelemetryStream

from ..end_to_end.daemon_watch import Observer, open_files, resident_mb
from ..end_to_end.processes import ROBOT_ID, Daemon, Process, until
from ..promised import promised
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .effort import SOAK_DECISIONS
from .faulty_camera import FaultyCamera, Mood
from .motion import FORWARD, configure, script

SILENCE_S = 1.0
"""The daemon speaks to the board at least twice a second, moving or not; what lasts longer is a
silence, and must begin with the wheels standing."""

SEED = 20_221_109

Record = Callable[[str, object], None]


@dataclass(frozen=True)
class Held:
    """What a process holds."""

    memory_mb: float
    threads: int
    names: Counter[str]
    """Of threads."""

    files: int


def held_by(process: Process) -> Held:
    names: Counter[str] = Counter()
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        with suppress(FileNotFoundError):  # a thread that has ended since
            names[(task / "comm").read_text().strip()] += 1
    files = open_files(process.pid)
    return Held(resident_mb(process.pid), names.total(), names, files)


class Rough:
    """A daemon among everything that can go wrong at once."""

    def __init__(self, daemon: Daemon, camera: FaultyCamera, port: Path, chance: random.Random):
        self.daemon = daemon
        self.camera = camera
        self.chance = chance
        self.boards: list[FakeBoard] = []
        self._port = port
        self.plug_in()

    @property
    def board(self) -> FakeBoard:
        return self.boards[-1]

    def plug_in(self) -> None:
        board = FakeBoard().__enter__()
        self._port.unlink(missing_ok=True)
        self._port.symlink_to(board.path)
        self.boards.append(board)

    def faults(self) -> list[Callable[[], None]]:
        return [
            self.bad_camera,
            self.dead_camera,
            self.reset_board,
            self.garbage,
            self.lost_acknowledgements,
            self.unplugged_board,
            self.push,
            self.bad_push,
            self.malformed_messages,
            self.watcher,
            self.stop_and_run,
        ]

    def bad_camera(self) -> None:
        moods: list[Mood] = ["silent", "black", "frozen"]
        self.camera.change(self.chance.choice(moods))
        time.sleep(self.chance.uniform(0.05, 0.8))
        self.camera.change("good")

    def dead_camera(self) -> None:
        self.camera.die()
        time.sleep(self.chance.uniform(0.0, 0.3))
        self.camera.revive()

    def reset_board(self) -> None:
        self.board.reset()

    def garbage(self) -> None:
        for _ in range(10):
            self.board.say(self.chance.randbytes(self.chance.randrange(1, 60)))
            time.sleep(0.01)

    def lost_acknowledgements(self) -> None:
        self.board.acknowledge = False
        time.sleep(self.chance.uniform(0.02, 0.3))
        self.board.acknowledge = True

    def unplugged_board(self) -> None:
        old = self.board
        self.plug_in()
        old.unplug()

    def push(self) -> None:
        name = f"model {self.chance.randrange(10**9)}"
        self.daemon.push(constant_model(0.6, 0.6, name=name))

    def bad_push(self) -> None:
        with suppress(MbotError):
            self.daemon.push(constant_model(float("nan"), 0.0))

    def malformed_messages(self) -> None:
        queries = [topic for topic in TOPICS if topic.flow is Flow.QUERY]
        with Observer(self.daemon.address) as observer:
            for _ in range(20):
                key = self.chance.choice(queries).key(ROBOT_ID)
                list(observer.session.get(key, payload=self.chance.randbytes(80), timeout=10.0))

    def watcher(self) -> None:
        with self.daemon.link() as link, TelemetryStream(link) as stream:
            list(stream.poll(0.2))

    def stop_and_run(self) -> None:
        with self.daemon.link() as link:
            with suppress(MbotError):  # the board may be away
                RemoteControl(link).stop()
            time.sleep(0.1)

    def settle(self) -> None:
        """Wait until nothing is wrong and it drives."""
        self.camera.change("good")

        def drives() -> bool:
            self.daemon.run()  # after a stop, also one by a malformed message on `stop`
            mark = len(self.board.commands)
            time.sleep(0.3)
            driven = [speeds for speeds in self.board.commands[mark:] if speeds[1:] != (0, 0)]
            return bool(driven) and not self.daemon.status().faults

        assert until(drives, 40), [fault.detail for fault in self.daemon.status().faults]


def moving_silences(board: FakeBoard) -> int:
    """How often nothing came for a long time while the wheels turned."""
    return sum(
        next_s - at_s > SILENCE_S and (m1, m2) != (0, 0)
        for (at_s, m1, m2), (next_s, _, _) in itertools.pairwise(board.commands)
    )


@pytest.mark.timeout(1800)
def test_nothing_leaks_and_every_silence_begins_standing(
    tmp_path: Path, record_property: Record
) -> None:
    port = tmp_path / "board"
    daemon = Daemon(tmp_path, str(port))
    configure(daemon, "camera", 'identical_frames = "refuse"')
    chance = random.Random(SEED)
    with ExitStack() as stack:
        camera = stack.enter_context(FaultyCamera(daemon.camera_port))
        rough = Rough(daemon, camera, port, chance)
        process = stack.enter_context(script(daemon, "fast_daemon.py"))
        assert daemon.is_up()
        daemon.push(FORWARD)
        for fault in rough.faults():  # once each, so that what is kept for good is there
            fault()
        rough.settle()
        before, began = held_by(process), daemon.status()
        faults, done = 0, began
        while done.decisions - began.decisions < SOAK_DECISIONS:
            chance.choice(rough.faults())()
            faults += 1
            if faults % 5 == 0:
                rough.settle()
            done = daemon.status()
        rough.settle()
        # Sessions that have ended are given up, and Zenoh's idle threads live for 10 s.
        until(lambda: held_by(process).threads - before.threads <= 2, 30)
        after = held_by(process)
        process.signal(SIGTERM)
        assert process.wait() == 0
        assert rough.board.speeds == (0, 0)
        for board in rough.boards:
            board.unplug()
    record_property("decisions", done.decisions - began.decisions)
    record_property("faults", faults)
    record_property("memory MB", round(after.memory_mb - before.memory_mb, 1))
    record_property("threads", after.threads - before.threads)
    record_property("descriptors", after.files - before.files)
    silences = sum(moving_silences(board) for board in rough.boards)
    record_property("silences while moving", silences)
    assert done.session_id == began.session_id
    assert after.memory_mb - before.memory_mb <= promised("soak-memory")
    assert after.threads - before.threads <= promised("soak-threads"), (
        f"kept {after.names - before.names}"
    )
    assert after.files - before.files <= promised("soak-descriptors")
    assert silences == promised("soak-silences")
    assert all(board.commands[0][1:] == (0, 0) for board in rough.boards if board.commands)
    assert "Traceback" not in daemon.log.read_text()
