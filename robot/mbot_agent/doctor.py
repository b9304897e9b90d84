"""`mbot-agent check`: is everything there that driving needs, and if not, what to do?"""

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from mbot_agent.board.board_session import BoardSession
from mbot_agent.camera.frame_sources import frame_source
from mbot_agent.camera.picture_check import PictureCheck
from mbot_agent.camera.source_contract import CameraError, JpegError
from mbot_agent.configuration import Configuration, address_advice, shown_source
from mbot_agent.faults import fault_ahead
from mbot_protocol.drive.senses import Senses
from mbot_protocol.errors import MbotError
from mbot_protocol.signing.public_key import PublicKey

FRAMES = 10
FEELING_S = 0.4
"""Several pings of the ultrasonic sensor."""

FULL_DISK_BYTES = 64 << 20


@dataclass(frozen=True, slots=True)
class Check:
    """The result of one check.

    Attributes:
        subject: what was looked at.
        verdict: "ok", "warning" (it will drive, but), or "failed" (it will not).
        detail: what was found and what to do.

    """

    subject: str
    verdict: str
    detail: str


def examine(
    configuration: Configuration, keys: Mapping[Path, tuple[PublicKey, ...]]
) -> list[Check]:
    """Run every check; takes up to 10 s with a board that does not answer.

    Args:
        configuration: with all that completes it.
        keys: whose models are taken, by the file that says so.

    """
    checks: tuple[tuple[str, Callable[[Configuration], Check]], ...] = (
        ("camera", _camera),
        ("lens", examine_lens),
        ("board", _board),
        ("trust", lambda configuration: examine_trust(configuration, keys)),
        ("model", _model),
        ("disk", _disk),
        ("network", _network),
        ("brltty", _brltty),
        ("clock", _clock),
    )
    findings: list[Check] = []
    for subject, check in checks:
        try:
            findings.append(check(configuration))
        except MbotError as error:
            findings.append(Check(subject, "failed", str(error)))
        except Exception as error:
            # A camera's library, a serial driver, a file of anybody's: each may raise anything, and
            # must not keep the other findings from whoever asks.
            reason = " ".join(f"{type(error).__name__} {error}".split())
            findings.append(Check(subject, "failed", f"could not be looked at: {reason}"))
    return findings


def _camera(configuration: Configuration) -> Check:
    try:
        return _seen(configuration)
    except CameraError as error:
        advice = address_advice(configuration.camera.source)
        return Check("camera", "failed", f"{error}{advice}")


def _seen(configuration: Configuration) -> Check:
    check = PictureCheck(configuration.camera)
    with frame_source(configuration.camera) as source:
        started_s = time.monotonic()
        height_px = width_px = 0
        for _ in range(FRAMES):
            shot = source.read()
            height_px, width_px = shot.shape[:2]
            try:
                fault = check.judge(shot.picture(), shot.captured_ns)
            except JpegError as error:
                return Check("camera", "failed", f"sends a damaged picture: {error}")
            if fault is not None:
                return Check("camera", "failed", fault.detail)
        rate_hz = FRAMES / (time.monotonic() - started_s)
    shown = shown_source(configuration.camera.source)
    return Check("camera", "ok", f"{shown}: {width_px} x {height_px}, about {rate_hz:.0f} frames/s")


def examine_lens(configuration: Configuration) -> Check:
    """What the picture pipeline takes the camera for."""
    camera = configuration.camera
    if camera.intrinsics is None:
        return Check(
            "lens",
            "warning",
            f"not calibrated: taken for {camera.horizontal_fov_deg:g} x "
            f"{camera.vertical_fov_deg:g} degrees without distortion; `workstation calibrate "
            "camera` measures it",
        )
    size = f"{camera.intrinsics.width_px} x {camera.intrinsics.height_px}"
    origin = configuration.calibration or "[camera.intrinsics]"
    return Check("lens", "ok", f"calibrated at {size}, from {origin}")


def _board(configuration: Configuration) -> Check:
    from mbot_agent.board.board_kinds import opener

    board = configuration.board
    with opener(board)(board, None) as session:
        session.handshake(lambda: False)
        senses = _felt(session, configuration)
    firmware = session.firmware
    found = f"{session.path}: firmware {firmware.version}"
    if firmware.mistaken:
        return Check("board", "failed", f"{session.path}: {firmware.mistaken}")
    if firmware.has_deadman:
        held_back = senses is None or fault_ahead(senses) is not None
        felt = senses.words if senses else "tells of no sensors: [senses] takes mbot-deadman 3"
        verdict = "warning" if held_back and configuration.senses.are_read else "ok"
        return Check("board", verdict, f"{found}; {felt}")
    warning = f"{found} keeps its last command for ever if this computer dies"
    if board.accept_no_deadman:
        return Check("board", "warning", f"{warning}; accepted by board.accept_no_deadman")
    return Check(
        "board",
        "failed",
        f"{warning}: use firmware with a time-out, or set board.accept_no_deadman = true",
    )


def _felt(session: BoardSession, configuration: Configuration) -> Senses | None:
    """What the board feels now, its reflexes as configured; None: it does not tell."""
    settings, until_s = configuration.senses, time.monotonic() + FEELING_S
    if settings.edge == "off":
        settings = msgspec.structs.replace(settings, edge="tell")
    if session.watch(settings, configuration.motors):
        while time.monotonic() < until_s:
            session.wait(until_s - time.monotonic())
    return session.senses


def examine_trust(
    configuration: Configuration, keys: Mapping[Path, tuple[PublicKey, ...]]
) -> Check:
    """Whose models will be taken, and which file says so; `keys` as `examine`."""
    if configuration.trust.allow_unsigned:
        return Check("trust", "warning", "takes anybody's models: trust.allow_unsigned is set")
    found = [
        f"{', '.join(key.name for key in named)} ({path})" for path, named in keys.items() if named
    ]
    if not found:
        return Check(
            "trust",
            "warning",
            "no key, so no model is taken: `workstation keys new` makes one and says how it gets "
            "here",
        )
    return Check("trust", "ok", f"takes models signed by {', '.join(found)}")


def _model(configuration: Configuration) -> Check:
    from mbot_agent.models.model_directory import ModelDirectory
    from mbot_agent.models.sequence_floors import SequenceFloors
    from mbot_agent.models.trust import Trust
    from mbot_protocol.policy.policy import Policy

    none = Check("model", "warning", "none yet: `workstation push-model` sends one")
    if not configuration.models.path.is_dir():  # the daemon makes it, and whose it is matters
        return none
    store = ModelDirectory(configuration.models.path, configuration.models.keep)
    active = store.activation.active
    if not active:
        return none
    floors = SequenceFloors(configuration.models.path)
    Trust(configuration.trust, configuration.robot_id, floors).signer_of(
        active, store.label(active)
    )
    policy = Policy(store.read(active))
    rate_hz = configuration.control.decision_rate_hz
    detail = f"{policy.metadata.name}, {active[:12]}, for {policy.metadata.decision_rate_hz:g} Hz"
    if abs(policy.metadata.decision_rate_hz - rate_hz) > 1e-6:
        return Check("model", "warning", f"{detail}, but control.decision_rate_hz is {rate_hz:g}")
    return Check("model", "ok", detail)


def _disk(configuration: Configuration) -> Check:
    wanted = configuration.models.path
    path = next(folder for folder in (wanted, *wanted.absolute().parents) if folder.is_dir())
    if not os.access(path, os.W_OK):
        return Check("disk", "failed", f"cannot write {path}: run as the daemon's user, or chown")
    owner, above = path.stat().st_uid, path.parent.stat().st_uid
    if path == wanted and owner == 0 != above:  # root may write it, and would not notice
        return Check("disk", "failed", f"{path} is root's, and not the daemon's: chown -R it")
    free_bytes = shutil.disk_usage(path).free
    verdict = "ok" if free_bytes >= FULL_DISK_BYTES else "warning"
    return Check("disk", verdict, f"{free_bytes / 2**20:.0f} MiB free in {path}")


def _network(configuration: Configuration) -> Check:
    from mbot_agent.network.listening import obstacle

    network = configuration.network
    found = f"listens on {', '.join(network.listen)}"
    obstacles = [there for there in map(obstacle, network.listen) if there is not None]
    if strange := [there.reason for there in obstacles if not there.is_agent]:
        return Check("network", "failed", f"cannot listen: {'; '.join(strange)} (network.listen)")
    if obstacles:
        found += ", as the daemon that runs does"
    if network.tls is None:
        return Check("network", "ok", found)
    from mbot_agent.network.tls_files import check_certificates

    validity = check_certificates(network.tls, configuration.robot_id)
    if validity.advice:
        return Check("network", "warning" if validity.usable else "failed", validity.advice)
    people = ", ".join(configuration.access.people) or "nobody"
    routers = "".join(f", by router {name}" for name in configuration.access.routers)
    return Check(
        "network", "ok", f"{found} for {people}{routers}, certificate until {validity.until}"
    )


def _brltty(_: Configuration) -> Check:
    """The braille daemon takes the mCore's CH340 away as soon as it is plugged in."""
    if shutil.which("brltty") is None:
        return Check("brltty", "ok", "not installed")
    return Check("brltty", "warning", "installed, and may take the board's port: apt remove brltty")


def _clock(_: Configuration) -> Check:
    """Nothing depends on the wall clock but the dates in logs and recordings."""
    if shutil.which("timedatectl") is None or not Path("/run/systemd/system").is_dir():
        return Check("clock", "ok", "not checked: no systemd here; only log dates depend on it")
    answer = subprocess.run(
        ["timedatectl", "show", "--property=NTPSynchronized", "--value"],
        capture_output=True,
        text=True,
        timeout=5,
        check=False,
    )
    if answer.stdout.strip() == "yes":
        return Check("clock", "ok", "synchronised")
    return Check(
        "clock", "warning", "not synchronised: dates in logs are wrong, driving is not affected"
    )
