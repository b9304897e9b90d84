"""`mbot-agent check`: is everything there that driving needs, and if not, what to do?"""

import os
import shutil
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mbot_agent.camera import FrameCheck
from mbot_agent.configuration import Configuration
from mbot_agent.frame_sources import frame_source
from mbot_protocol.errors import MbotError
from mbot_protocol.mcore import has_deadman

FRAMES = 10
FULL_DISK_BYTES = 64 << 20


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check.

    Attributes:
        subject: what was looked at.
        verdict: "ok", "warning" (it will drive, but), or "failed" (it will not).
        detail: what was found and what to do.

    """

    subject: str
    verdict: str
    detail: str


def examine(configuration: Configuration) -> list[Finding]:
    """Run every check; takes up to 10 s with a board that does not answer."""
    checks: tuple[tuple[str, Callable[[Configuration], Finding]], ...] = (
        ("camera", _camera),
        ("board", _board),
        ("model", _model),
        ("disk", _disk),
        ("network", _network),
        ("brltty", _brltty),
        ("clock", _clock),
    )
    findings: list[Finding] = []
    for subject, check in checks:
        try:
            findings.append(check(configuration))
        except MbotError as error:
            findings.append(Finding(subject, "failed", str(error)))
    return findings


def _camera(configuration: Configuration) -> Finding:
    check = FrameCheck(configuration.camera)
    with frame_source(configuration.camera) as source:
        started_s = time.monotonic()
        height_px = width_px = 0
        for _ in range(FRAMES):
            picture, captured_ns = source.read()
            height_px, width_px = picture.shape[:2]
            if (fault := check.judge(picture, captured_ns)) is not None:
                return Finding("camera", "failed", fault.detail)
        rate_hz = FRAMES / (time.monotonic() - started_s)
    return Finding(
        "camera",
        "ok",
        f"{configuration.camera.source}: {width_px} x {height_px}, about {rate_hz:.0f} frames/s",
    )


def _board(configuration: Configuration) -> Finding:
    from mbot_agent.board_session import BoardSession

    board = configuration.board
    never, keep_open = os.pipe()
    try:
        with BoardSession.open(board.port, board.baud_rate, never) as session:
            session.handshake(lambda: False)
    finally:
        os.close(never)
        os.close(keep_open)
    found = f"{session.path}: firmware {session.version}"
    if has_deadman(session.version):
        return Finding("board", "ok", found)
    warning = f"{found} keeps its last command for ever if this computer dies"
    if board.accept_no_deadman:
        return Finding("board", "warning", f"{warning}; accepted by board.accept_no_deadman")
    return Finding(
        "board",
        "failed",
        f"{warning}: flash firmware with a time-out, or set board.accept_no_deadman = true",
    )


def _model(configuration: Configuration) -> Finding:
    from mbot_agent.model_store import ModelStore
    from mbot_agent.policy import Policy

    store = ModelStore(configuration.models.path, configuration.models.keep)
    active = store.pointer.active
    if not active:
        return Finding("model", "warning", "none yet: `workstation push-model` sends one")
    policy = Policy(store.read(active))
    rate_hz = configuration.control.decision_rate_hz
    detail = f"{policy.metadata.name}, {active[:12]}, for {policy.metadata.decision_rate_hz:g} Hz"
    if abs(policy.metadata.decision_rate_hz - rate_hz) > 1e-6:
        return Finding("model", "warning", f"{detail}, but control.decision_rate_hz is {rate_hz:g}")
    return Finding("model", "ok", detail)


def _disk(configuration: Configuration) -> Finding:
    path = configuration.models.path
    if not os.access(path, os.W_OK):
        return Finding("disk", "failed", f"cannot write {path}: run as the daemon's user, or chown")
    free_bytes = shutil.disk_usage(path).free
    verdict = "ok" if free_bytes >= FULL_DISK_BYTES else "warning"
    return Finding("disk", verdict, f"{free_bytes / 2**20:.0f} MiB free in {path}")


def _network(configuration: Configuration) -> Finding:
    tls = configuration.network.tls
    for path in () if tls is None else (tls.ca, tls.certificate, tls.key):
        if not os.access(path, os.R_OK):
            return Finding("network", "failed", f"cannot read {path}: is it there, who owns it?")
    return Finding("network", "ok", f"listens on {', '.join(configuration.network.listen)}")


def _brltty(_: Configuration) -> Finding:
    """The braille daemon takes the mCore's CH340 away as soon as it is plugged in."""
    if shutil.which("brltty") is None:
        return Finding("brltty", "ok", "not installed")
    return Finding(
        "brltty", "warning", "installed, and may take the board's port: apt remove brltty"
    )


def _clock(_: Configuration) -> Finding:
    """Nothing depends on the wall clock but the dates in logs and recordings."""
    if shutil.which("timedatectl") is None or not Path("/run/systemd/system").is_dir():
        return Finding("clock", "ok", "not checked: no systemd here; only log dates depend on it")
    answer = subprocess.run(
        ["timedatectl", "show", "--property=NTPSynchronized", "--value"],
        capture_output=True,
        text=True,
        timeout=5,
        check=False,
    )
    if answer.stdout.strip() == "yes":
        return Finding("clock", "ok", "synchronised")
    return Finding(
        "clock", "warning", "not synchronised: dates in logs are wrong, driving is not affected"
    )
