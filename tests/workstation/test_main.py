import itertools
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mbot_protocol.beat.whole_chunks import WholeChunks
from mbot_protocol.errors import ARMED_BUT_STANDING
from mbot_protocol.v1.messages_pb2 import (
    Activate,
    CommandReply,
    Fault,
    Model,
    ModelList,
    Notice,
    State,
    Status,
)
from mbot_protocol.wire.keys import (
    ACTIVATE,
    CHUNK_BYTES,
    COMMAND,
    MODELS,
    PUSH_CHUNK,
    PUSH_COMMIT,
    STATUS,
)

from ..free_port import free_port
from ..promised import promised
from ..ran import LIMIT_S, WORKSTATION, ran, without_robot
from ..until import until
from .fake_robot import OLD_MODEL, FakeRobot
from .samples import decision, picture, small_policy

HEAVY = ("mujoco", "zenoh", "onnx", "cv2", "torch", "numpy", "google.protobuf", "mcap")


def environment(robot: FakeRobot | None) -> dict[str, str]:
    return without_robot() | ({"MBOT_ROBOT": robot.address} if robot else {})


def workstation(robot: FakeRobot | None, *arguments: str) -> subprocess.CompletedProcess[str]:
    return ran(*WORKSTATION, *arguments, env=environment(robot))


@contextmanager
def interrupted_after(
    robot: FakeRobot, count: int, name: str, *arguments: str
) -> Iterator[subprocess.Popen[str]]:
    """The command, sent Ctrl-C when the robot has had `count` queries of that name."""
    command = [*WORKSTATION, *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, env=environment(robot), stdout=pipe, stderr=pipe, text=True
    ) as process:
        try:
            assert until(lambda: robot.names().count(name) >= count)
            process.send_signal(signal.SIGINT)
            process.wait(LIMIT_S)
            yield process
        finally:
            process.kill()


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    path = tmp_path / "policy.onnx"
    path.write_bytes(small_policy(weights_bytes=8 * CHUNK_BYTES).SerializeToString())
    return path


def test_help_is_quick_because_it_loads_nothing_heavy() -> None:
    script = """
import sys
sys.argv = ["workstation", "--help"]
from mbot_workstation.main import main
try:
    main()
finally:
    print("loaded:", *sys.modules)
"""
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=LIMIT_S
    )
    page, _, loaded = run.stdout.partition("loaded:")
    for command in ("robots", "telemetry", "push-model", "rollback", "drive"):
        assert command in page
    assert not set(HEAVY) & set(loaded.split())


def test_every_command_explains_itself_with_an_example() -> None:
    commands = ("robots", "telemetry", "push-model", "models", "rollback", "run", "stop", "drive")
    processes = {
        name: subprocess.Popen(
            [*WORKSTATION, name, "--help"], env=environment(None), stdout=subprocess.PIPE, text=True
        )
        for name in commands
    }
    for name, process in processes.items():
        page, _ = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0
        assert f"workstation {name}" in page
        assert "Example" in page


def test_an_unreachable_robot_is_one_line_and_exit_code_4() -> None:
    run = workstation(None, "stop", "--robot", f"127.0.0.1:{free_port()}")
    assert run.returncode == 4
    assert run.stdout == ""
    assert run.stderr.startswith("workstation: no connection to tcp/127.0.0.1:")
    assert run.stderr.count("\n") == 1


def test_run_stop_and_refusal(robot: FakeRobot) -> None:
    assert workstation(robot, "run").stdout == "mbot-1: running\n"
    assert workstation(robot, "stop", "--id", "mbot-1").stdout == "mbot-1: stopped\n"
    robot.replies[COMMAND.name] = lambda _data: CommandReply(schema_version=1, reason="no model")
    run = workstation(robot, "run")
    assert (run.returncode, run.stderr) == (6, "workstation: robot mbot-1 refused: no model\n")


def answers_a_run_with_a_fault(robot: FakeRobot, *later: Status) -> None:
    """What it says of itself: as before the command, and these; the last of them from then on."""
    statuses = itertools.chain((robot.status(), *later), itertools.repeat(later[-1]))
    robot.replies[STATUS.name] = lambda _data: next(statuses)
    robot.replies[COMMAND.name] = lambda _data: CommandReply(
        schema_version=1, accepted=True, state=State.STATE_FAULT
    )


def state_of(robot: FakeRobot, state: State, *faults: Fault) -> Status:
    status = robot.status()
    status.state = state
    status.faults.extend(faults)
    return status


def test_armed_but_standing_says_for_what_it_waits(robot: FakeRobot) -> None:
    faults = (
        Fault(kind="camera-lost", detail="plug it in"),
        Fault(kind="no-model", detail="none yet"),
    )
    answers_a_run_with_a_fault(robot, state_of(robot, State.STATE_FAULT, *faults))
    done = workstation(robot, "run", "--when-ready")
    assert done.returncode == promised("armed-but-standing")
    assert done.returncode == ARMED_BUT_STANDING
    assert (done.stdout, done.stderr) == (
        "mbot-1: armed; it drives when the camera is back and it has a model "
        "(camera-lost: plug it in; no-model: none yet)\n",
        "",
    )
    [command] = robot.commands()
    assert command.run.when_ready
    done = workstation(robot, "run", "--json")
    assert (done.returncode, done.stderr) == (7, "")
    assert json.loads(done.stdout) == {
        "robot_id": "mbot-1",
        "state": "fault",
        "faults": [
            {"kind": "camera-lost", "detail": "plug it in"},
            {"kind": "no-model", "detail": "none yet"},
        ],
    }


def test_a_robot_that_begins_at_its_next_beat_drives(robot: FakeRobot) -> None:
    standing = state_of(robot, State.STATE_FAULT)
    answers_a_run_with_a_fault(robot, standing, state_of(robot, State.STATE_RUNNING))
    run = workstation(robot, "run", "--when-ready", "--json")
    assert (run.returncode, run.stderr) == (0, "")
    assert json.loads(run.stdout) == {"robot_id": "mbot-1", "state": "running", "faults": []}
    answers_a_run_with_a_fault(robot, standing, state_of(robot, State.STATE_RUNNING))
    assert workstation(robot, "run", "--when-ready").stdout == "mbot-1: running\n"


def test_a_robot_that_was_stopped_while_it_waited_is_no_success(robot: FakeRobot) -> None:
    stopped = state_of(robot, State.STATE_STOPPED)
    stopped.last_stop.by, stopped.last_stop.monotonic_ns = (
        "max",
        stopped.now_monotonic_ns - 4 * 10**8,
    )
    answers_a_run_with_a_fault(robot, stopped)
    run = workstation(robot, "run", "--when-ready")
    assert (run.returncode, run.stdout) == (6, "")
    assert run.stderr == (
        "workstation: robot mbot-1: stopped by max 0.4 s ago; look, then run again\n"
    )


def test_drive_sends_again_and_stops_at_the_end(robot: FakeRobot) -> None:
    run = workstation(robot, "drive", "-0.5", "0.25", "--for", "0.9")
    assert (run.returncode, run.stdout) == (0, "mbot-1: stopped\n")
    *drives, stop = robot.commands()
    assert 3 <= len(drives) <= 5
    assert {(c.drive.wheels.left, c.drive.wheels.right) for c in drives} == {(-0.5, 0.25)}
    assert drives[0].drive.hold_ms == 500
    lasts_s = (drives[-1].expires_monotonic_ns - drives[0].expires_monotonic_ns) / 1e9
    assert lasts_s <= 0.9 - 0.5 + 0.01  # no longer than asked for
    assert stop.WhichOneof("action") == "stop"


def test_drive_stops_on_ctrl_c(robot: FakeRobot) -> None:
    with interrupted_after(robot, 2, COMMAND.name, "drive", "1", "1", "--for", "60") as process:
        assert process.returncode == 130
    assert robot.commands()[-1].WhichOneof("action") == "stop"


def test_drive_stops_when_the_robot_refuses(robot: FakeRobot) -> None:
    answer, count = robot.replies[COMMAND.name], iter(range(100))
    robot.replies[COMMAND.name] = lambda data: (
        CommandReply(schema_version=1, reason="too hot") if next(count) == 1 else answer(data)
    )
    run = workstation(robot, "drive", "1", "1", "--for", "60")
    assert (run.returncode, "too hot" in run.stderr) == (6, True)
    assert robot.commands()[-1].WhichOneof("action") == "stop"


@pytest.mark.parametrize("arguments", [("2", "0"), ("nan", "0"), ("0",), ("0", "0", "--far", "1")])
def test_drive_refuses_nonsense(robot: FakeRobot, arguments: tuple[str, ...]) -> None:
    assert workstation(robot, "drive", *arguments).returncode == 2
    assert robot.received == []


def test_a_model_is_pushed(robot: FakeRobot, policy: Path) -> None:
    run = workstation(robot, "push-model", str(policy))
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("mbot-1 now has new ")
    assert run.stderr.splitlines() == [
        "workstation: note: sent without a signature, which mbot-1 takes from anybody "
        "(trust.allow_unsigned)",
        "workstation: note: made for 5 decisions/s",
    ]
    assert robot.active.name == "new"
    again = json.loads(workstation(robot, "push-model", str(policy), "--json").stdout)
    assert (again["robot_id"], again["name"], again["active"]) == ("mbot-1", "new", True)


def test_a_bad_model_needs_no_robot(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a model")
    run = workstation(None, "push-model", str(path), "--robot", f"127.0.0.1:{free_port()}")
    assert run.returncode == 3
    assert "not an ONNX model" in run.stderr


def test_a_key_that_does_not_exist_is_refused_though_nothing_needs_it(
    robot: FakeRobot, policy: Path
) -> None:
    assert workstation(robot, "push-model", str(policy)).returncode == 0
    for command in (("push-model", str(policy)), ("rollback",)):
        run = workstation(robot, *command, "--sign-with", "nobody")
        assert run.returncode == 2
        assert "no key 'nobody' in " in run.stderr


def test_a_push_broken_off_leaves_the_old_model(robot: FakeRobot, policy: Path) -> None:
    answer = robot.replies[PUSH_CHUNK.name]

    def slow(data: bytes):
        time.sleep(0.2)
        return answer(data)

    robot.replies[PUSH_CHUNK.name] = slow
    with interrupted_after(robot, 2, PUSH_CHUNK.name, "push-model", str(policy)) as process:
        assert process.returncode == 130
        assert process.stderr is not None
        assert "interrupted; the robot keeps the model it had" in process.stderr.read()
    assert PUSH_COMMIT.name not in robot.names()
    assert robot.active == OLD_MODEL


def test_with_json_an_error_is_an_object_with_its_kind(tmp_path: Path) -> None:
    done = workstation(None, "check-model", str(tmp_path / "no.onnx"), "--json")
    assert (done.returncode, done.stdout) == (2, "")
    error = json.loads(done.stderr)["error"]
    assert error["kind"] == "configuration"
    assert error.keys() == {"kind", "text", "remedy", "facts"}


def test_models_and_rollback(robot: FakeRobot) -> None:
    assert "active    aaaaaaaaaaaa  old" in workstation(robot, "models").stdout
    listed = json.loads(workstation(robot, "rollback", "b" * 8, "--json").stdout)
    assert [model["previous"] for model in listed] == [False, True]
    sent = [Activate.FromString(data) for name, data in robot.received if name == ACTIVATE.name]
    assert [activate.sha256 for activate in sent] == ["b" * 8]
    assert workstation(robot, "rollback", "no-digest").returncode == 2


def test_robots_lists_the_living_and_names_the_unreachable(robot: FakeRobot) -> None:
    nobody = f"127.0.0.1:{free_port()}"
    run = workstation(robot, "robots", "--robot", robot.address, "--robot", nobody, "--json")
    assert run.returncode == 4
    alive, dead = json.loads(run.stdout)
    assert alive["robot_id"] == "mbot-1"
    assert alive["board_version"] == "mbot-agent 1"
    assert alive["decision_rate_hz"] == 10.0
    assert (dead["robot_id"], dead["state"]) == (None, None)
    assert "nothing listens" in dead["error"]
    table = workstation(robot, "robots")
    assert table.returncode == 0
    assert "mbot-1" in table.stdout
    assert "old aaaaaaaaaaaa" in table.stdout
    assert alive["release"] == "0.1.0+7.abcd"
    assert "0.1.0+7.abcd" in table.stdout


def test_robots_shows_who_takes_unsigned_models(robot: FakeRobot) -> None:
    robot.notices = [Notice(kind="unsigned-models", detail="takes models from anyone")]
    assert "mbot-1: note: unsigned-models: takes" in workstation(robot, "robots").stdout
    (found,) = json.loads(workstation(robot, "robots", "--json").stdout)
    assert found["accepts_unsigned_models"] is True
    assert (found["trusted_keys"], found["model_signed_by"]) == ([], "anna")
    assert found["notices"] == [{"kind": "unsigned-models", "detail": "takes models from anyone"}]


def test_models_tell_who_signed_them_and_which_are_on_trial(robot: FakeRobot) -> None:
    robot.active = Model(sha256="c" * 64, name="new", active=True, signed_by="bert")
    rejected = Model(sha256="d" * 64, name="bad", previous=True, rejected=True)
    robot.replies[MODELS.name] = lambda _data: ModelList(
        schema_version=1, accepted=True, models=[robot.active, rejected]
    )
    lines = workstation(robot, "models").stdout.splitlines()
    assert lines[1].startswith("active, on trial  cccccccccccc")
    assert lines[1].split()[-1] == "bert"
    assert lines[2].startswith("rolled back")


def publishing(robot: FakeRobot, process: subprocess.Popen[str], seconds: float) -> None:
    for sequence in range(round(seconds / 0.1)):
        if process.poll() is not None:
            return
        robot.publish(picture(decision(sequence).unix_time_ns))
        robot.publish(decision(sequence))
        time.sleep(0.1)


def telemetry(robot: FakeRobot, *arguments: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    command = [*WORKSTATION, "telemetry", *arguments]
    return subprocess.Popen(command, env=environment(robot), stdout=pipe, stderr=pipe, text=True)


def test_telemetry_writes_json_lines(robot: FakeRobot) -> None:
    with telemetry(robot, "--json", "--seconds", "2") as process:
        publishing(robot, process, LIMIT_S)
        out, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, errors
    sequences = [json.loads(line)["sequence"] for line in out.splitlines()]
    assert len(sequences) >= 3
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))


def test_telemetry_records_until_ctrl_c(robot: FakeRobot, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with telemetry(robot, "--record", str(path)) as process:
        assert until(path.exists)
        publishing(robot, process, 3.0)
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 130, errors
    assert out.startswith("mbot-1: running, decision ")
    topics = {message.topic.rpartition("/")[2] for message in WholeChunks(path).messages()}
    assert topics == {"decision", "drive", "observation", "log"}
    assert path.read_bytes().endswith(b"MCAP0\r\n")
    assert re.match(rf"workstation: recorded \d+ decisions into {path}; open it in Fox", errors)
    assert "workstation explain POLICY.onnx --recording" in errors
    assert errors.count("\n") == 1
    assert workstation(robot, "telemetry", "--record", str(path)).returncode == 2


def test_it_says_its_version() -> None:
    done = subprocess.run(
        [*WORKSTATION, "--version"], capture_output=True, text=True, check=True, timeout=LIMIT_S
    )
    assert re.fullmatch(r"workstation \d+\.\d+\.\d+\n", done.stdout)
