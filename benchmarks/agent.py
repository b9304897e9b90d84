"""What the daemon costs and how fast it is, on the virtual robot, beside a naive baseline.

    python benchmarks/agent.py [--minutes 10] [--json] [--beside TREE]

Prints medians and ratios; with `--beside` also those of another checkout's daemon, in the same run.
Use a quiet machine: the virtual robot draws its camera's pictures on the same processor.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from mbot_protocol.beat.stages import percentile
from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.link.remote_control import NotStandingError, RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.push import push
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.telemetry.stream import TelemetryStream
from mbot_workstation.virtual.child import Child

ADDRESS = "127.0.0.1:17447"
PLAIN_SECONDS = 30.0

CONFIGURATION = """\
robot_id = "benchmark"
[camera]
source = "{camera}"
[board]
port = "{board}"
accept_no_deadman = true
[models]
directory = "{models}"
[trust]
keys = ["{key}"]
[network]
listen = ["tcp/{address}"]
"""

BARS = {
    "decision_p50_ms": 6.0,
    "decision_p99_ms": 20.0,
    "frame_p50_ms": 25.0,
    "frame_p99_ms": 50.0,
    "missed_ticks": 0.0,
    "cpu_share": 0.03,
    "memory_mb": 120.0,
}


def measure(
    minutes: float, beside: Path | None = None, driven: Path | None = None
) -> dict[str, float]:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        places = _start_virtual_robot(stack, folder)
        model = folder / "servo.onnx"
        policy = servo_model(ServoGains(), PolicyMetadata("servo"))
        model.write_bytes(policy.SerializeToString(deterministic=True))
        plain = _run_plain_loop(places, model)
        figures = _run_daemon(folder, places, driven or model, minutes)
        if beside is not None:
            other = folder / "beside"
            other.mkdir()
            with _code_of(beside):
                found = _run_daemon(other, places, model, minutes)
            figures |= {f"beside_{name}": value for name, value in found.items()}
    return figures | {f"plain_{name}": value for name, value in plain.items()}


@contextmanager
def _code_of(tree: Path) -> Iterator[None]:
    """Programs started within run that checkout's code."""
    ours = os.environ.get("PYTHONPATH")
    rooms = (tree / name for name in ("shared/protocol", "robot", "workstation"))
    os.environ["PYTHONPATH"] = os.pathsep.join(str(room.resolve()) for room in rooms)
    try:
        yield
    finally:
        del os.environ["PYTHONPATH"]
        if ours is not None:
            os.environ["PYTHONPATH"] = ours


def _start_virtual_robot(stack: ExitStack, folder: Path) -> dict[str, str]:
    ready = folder / "ready.json"
    arguments = ["virtual-robot", "--plain", "--camera-port", "0"]
    arguments += ["--board", str(folder / "board"), "--ready-file", str(ready)]
    robot = stack.enter_context(Child("workstation", arguments, folder / "robot.log"))
    robot.wait_until(ready.exists, 60, "the virtual robot did not start")
    return json.loads(ready.read_text())


def _run_plain_loop(places: dict[str, str], model: Path) -> dict[str, float]:
    script = Path(__file__).with_name("plain_loop.py")
    command = [sys.executable, str(script), places["camera"], places["board"], str(model)]
    done = subprocess.run(
        [*command, str(PLAIN_SECONDS)], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    return {
        "decision_p50_ms": percentile(found["decision_ms"], 0.5),
        "decision_p99_ms": percentile(found["decision_ms"], 0.99),
        "decisions_per_s": found["decisions_per_s"],
        "cpu_share": found["cpu_share"],
    }


def _run_daemon(
    folder: Path, places: dict[str, str], model: Path, minutes: float
) -> dict[str, float]:
    configuration = folder / "robot.toml"
    key = SigningKey.ephemeral("benchmark")
    configuration.write_text(
        CONFIGURATION.format(
            models=folder / "models", key=key.public.line, address=ADDRESS, **places
        )
    )
    arguments = ["run", "--config", str(configuration)]
    with Child("mbot-agent", arguments, folder / "agent.log") as agent:
        log = folder / "agent.log"
        agent.wait_until(lambda: "is up" in log.read_text(), 30, "the daemon did not start")
        with RobotLink(ADDRESS) as link:
            began_s = time.monotonic()
            push(link, model, lambda _: key)
            push_s = time.monotonic() - began_s
            decisions = _watch(link, agent, minutes * 60)
        cpu_share = decisions.cpu_s / decisions.seconds
    start_s = _time_to_first_decision(folder, configuration)
    return decisions.figures() | {
        "cpu_share": cpu_share,
        "push_to_active_s": push_s,
        "start_to_first_decision_s": start_s,
    }


class Watched:
    """The decisions of a while, and what they cost."""

    def __init__(self) -> None:
        self.decisions: list[Decision] = []
        self.cpu_s = 0.0
        self.seconds = 0.0

    def figures(self) -> dict[str, float]:
        answered = [d for d in self.decisions if d.acknowledged_monotonic_ns]
        decision = [(d.acknowledged_monotonic_ns - d.started_monotonic_ns) / 1e6 for d in answered]
        frame = [(d.acknowledged_monotonic_ns - d.captured_monotonic_ns) / 1e6 for d in answered]
        first, last = self.decisions[0], self.decisions[-1]
        elapsed_s = (last.started_monotonic_ns - first.started_monotonic_ns) / 1e9
        return {
            "decisions": len(self.decisions),
            "decisions_per_s": (last.sequence - first.sequence) / elapsed_s,
            "decision_p50_ms": percentile(decision, 0.5),
            "decision_p99_ms": percentile(decision, 0.99),
            "frame_p50_ms": percentile(frame, 0.5),
            "frame_p99_ms": percentile(frame, 0.99),
            "missed_ticks": last.missed_ticks - first.missed_ticks,
            "memory_mb": max(d.resident_memory_bytes for d in self.decisions) / 2**20,
        }


def _watch(link: RobotLink, agent: Child, seconds: float) -> Watched:
    watched = Watched()
    with TelemetryStream(link) as stream:
        RemoteControl(link).run(when_ready=True)
        began_s, cpu_s = time.monotonic(), agent.cpu_s
        while time.monotonic() - began_s < seconds:
            watched.decisions += [
                sample.message
                for sample in stream.poll(0.2)
                if isinstance(sample.message, Decision) and sample.message.HasField("action")
            ]
        watched.seconds = time.monotonic() - began_s
        watched.cpu_s = agent.cpu_s - cpu_s
        with suppress(NotStandingError):  # an older daemon beside ours does not say
            RemoteControl(link).stop()
    return watched


def _time_to_first_decision(folder: Path, configuration: Path) -> float:
    """From starting the process to the first tick in which it drives, with model and all."""
    configuration.write_text(configuration.read_text() + '[control]\nstart = "running"\n')
    arguments = ["run", "--config", str(configuration)]
    log = folder / "agent-again.log"
    began_s = time.monotonic()
    with Child("mbot-agent", arguments, log) as agent:
        agent.wait_until(lambda: "now running" in log.read_text(), 30, "it did not drive")
        return time.monotonic() - began_s


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="of driving (default: 10)")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--beside", type=Path, help="a checkout whose daemon is measured too")
    parser.add_argument("--model", type=Path, help="what the daemon drives instead of the servo")
    arguments = parser.parse_args()
    figures = measure(arguments.minutes, arguments.beside, arguments.model)
    if arguments.json:
        print(json.dumps(figures))
        return
    print(f"{platform.machine()}, Python {platform.python_version()}, {arguments.minutes:g} min")
    others = ["plain_", *(["beside_"] if arguments.beside else [])]
    heads = "".join(f"{name.strip('_'):>12}{'ratio':>8}" for name in others)
    print(f"{'':28}{'daemon':>10}{'bar':>8}{heads}")
    for name, value in figures.items():
        if name.startswith(("plain_", "beside_")):
            continue
        bar = f"{BARS[name]:g}" if name in BARS else ""
        line = f"{name:28}{value:10.3f}{bar:>8}"
        for prefix in others:
            other = figures.get(f"{prefix}{name}")
            line += f"{other:12.3f}{value / other:8.2f}" if other else " " * 20
        print(line.rstrip())


if __name__ == "__main__":
    main()
