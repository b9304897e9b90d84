"""What recording a drive costs the robot, and how long 30 minutes take to open, replay and report.

    python benchmarks/recording.py

A loop of true ticks on recorded pictures, and the recorder's own thread beside it; no camera, no
board, no network. Figures depend on the machine; the bars are those of docs/telemetry.md.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from mbot_agent import configuration
from mbot_agent.arming import Mode, Orders
from mbot_agent.hardware import Delivery
from mbot_agent.network.wire_messages import beat_of
from mbot_agent.recording.recording_directory import RecordingDirectory
from mbot_agent.recording.robot_facts import robot_facts
from mbot_agent.tick import Action, Tick
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.drive.actions import to_steps
from mbot_protocol.drive.wheel_command import Duties
from mbot_protocol.policy.policy_contract import Memory
from mbot_workstation.pictures.picture_file import observation

CHECKOUT = Path(__file__).parents[1]
RECORDED = CHECKOUT / "tests" / "data" / "recorded-drive"
SHIPPED = CHECKOUT / "models" / "red-cube.onnx"
LONG_BEATS = 4500
"""30 minutes at 2.5 Hz."""

BARS = {"offer_p99_ms": 1.0, "core_percent": 2.0, "memory_mb": 12.0, "open_s": 3.0}
BARS |= {"replay_s": 20.0, "report_s": 15.0}


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


def thread_cpu_s(name: str) -> float:
    """Processor time of this process's thread of that name, in s; 10 ms exactly."""
    for thread in threading.enumerate():
        if thread.name == name:
            stat = Path(f"/proc/self/task/{thread.native_id}/stat").read_text()
            return sum(map(int, stat.rpartition(")")[2].split()[11:13])) / 100
    return 0.0


def ticks(count: int) -> list[Tick]:
    """Beats of a drive on recorded pictures, a little brighter each time round."""
    pictures = [observation(beat) for beat in read_drive(RECORDED).beats]
    orders, state = Orders(Mode.RUNNING, 1), np.zeros((1, 1, 128), np.float32)
    found: list[Tick] = []
    for number in range(count):
        picture = pictures[number % len(pictures)]
        assert picture is not None
        steps = to_steps(0.5, 0.25)
        found.append(
            Tick(
                number, 0, 0, 0, orders, (), "a" * 64, 1, picture + np.uint8(number % 7), 2,
                Memory(state, steps.action), Action(0.5, 0.25), 3, steps, Duties(0.58, 0.36),
                Delivery(4, 5),
            )
        )  # fmt: skip
    return found


def measure_robot(folder: Path, rate_hz: float, seconds: float) -> dict[str, float]:
    settings = configuration.Recording(leave_free_mb=64)
    facts = robot_facts(configuration.Configuration(robot_id="mbot-1"), 1)
    directory = RecordingDirectory(folder, settings)
    offers_ms: list[float] = []
    beats = ticks(26)
    begun_mb = resident_mb()
    from mbot_agent.recording.recorder import Recorder  # its memory counts

    with Recorder(
        directory, facts, lambda tick: beat_of(tick, "mbot-1", 1, (), facts.wheels)
    ) as recorder:
        began_s, cpu_s = time.monotonic(), thread_cpu_s("recording")
        for number in range(round(seconds * rate_hz)):
            now_ns = time.monotonic_ns()
            tick = replace(beats[number % 26], sequence=number, started_ns=now_ns, due_ns=now_ns)
            begun_ns = time.perf_counter_ns()
            recorder.offer(tick)
            offers_ms.append((time.perf_counter_ns() - begun_ns) / 1e6)
            time.sleep(max(0.0, began_s + (number + 1) / rate_hz - time.monotonic()))
        lasted_s = time.monotonic() - began_s
        core = (thread_cpu_s("recording") - cpu_s) / lasted_s
        grown_mb = resident_mb() - begun_mb
    size = sum(path.stat().st_size for path in folder.rglob("*.mcap"))
    return {
        "offer_p99_ms": float(np.percentile(offers_ms, 99)),
        "core_percent": 100 * core,
        "memory_mb": grown_mb,
        "mb_an_hour": size / lasted_s * 3600 / 1e6,
    }


def long_recording(folder: Path) -> Path:
    """30 minutes as if the shipped policy had driven: the recorded beats, over and over."""
    import msgspec

    from mbot_protocol.beat.writer import BeatWriter

    recorded = read_drive(RECORDED)
    facts = recorded.facts
    assert facts is not None
    digest = hashlib.sha256(SHIPPED.read_bytes()).hexdigest()
    path = folder / "long" / "000.mcap"
    path.parent.mkdir()
    writer = BeatWriter(path, facts.robot_id, "benchmark", facts)
    for number in range(LONG_BEATS):
        beat = recorded.decided[number % len(recorded.decided)]
        assert beat.policy_input is not None
        decision, time_ns = beat.decision, 10**18 + number * 400_000_000
        decision.sequence, decision.unix_time_ns = number, time_ns
        decision.model_sha256 = digest
        decision.started_monotonic_ns = 10**9 + number * 400_000_000
        known = msgspec.structs.replace(beat.policy_input, memory=bytes(4 * 128))
        writer.write(replace(beat, policy_input=known))
        if number % 2:
            writer.sync()
    writer.close()
    return path.parent


def measure_workstation(folder: Path) -> dict[str, float]:
    recording = long_recording(folder)
    began_s = time.perf_counter()
    drive = read_drive(recording)
    open_s = time.perf_counter() - began_s
    assert len(drive.beats) == LONG_BEATS
    code = "from mbot_workstation.main import main; main()"
    command = [sys.executable, "-c", code]
    began_s = time.perf_counter()
    replay = [*command, "replay", str(recording), "--model", str(SHIPPED), "--json"]
    said = subprocess.run(replay, capture_output=True, text=True, check=False).stdout
    replay_s = time.perf_counter() - began_s
    assert json.loads(said)["decisions"] == LONG_BEATS
    began_s = time.perf_counter()
    page = folder / "drive.html"
    report = [*command, "report", str(recording), "--model", str(SHIPPED), "-o", str(page)]
    subprocess.run(report, check=True)
    report_s = time.perf_counter() - began_s
    assert 'class="looked"' in page.read_text()
    return {"open_s": open_s, "replay_s": replay_s, "report_s": report_s}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rate", type=float, default=2.5, help="beats a second")
    parser.add_argument("--seconds", type=float, default=60.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        figures = measure_robot(Path(folder) / "robot", arguments.rate, arguments.seconds)
        figures |= measure_workstation(Path(folder))
    for name, value in figures.items():
        bar = f"  bar {BARS[name]:g}" if name in BARS else ""
        print(f"{name:20} {value:8.3f}{bar}")


if __name__ == "__main__":
    main()
