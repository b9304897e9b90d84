"""Gathers what helps to help: versions, what a robot says of itself, settings, the check's verdict.

Whatever can't be had leaves its error in place of itself.
"""

import io
import json
import platform
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import tomli_w
from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import read_text
from mbot_protocol.v1.messages_pb2 import ModelList
from mbot_protocol.wire.keys import MODELS
from mbot_workstation.fleet.link.recording_fetch import list_recordings
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.support.redaction import redacted, redacted_values

FOLDER = "mbot-support"

PACKAGES = (
    *("mbot-agent", "eclipse-zenoh", "numpy", "onnxruntime", "opencv-python-headless", "pyserial"),
    *("protobuf", "msgspec", "mujoco-core", "onnx", "torch", "typer", "PyNaCl", "cryptography"),
)
CHECK_TIMEOUT_S = 60.0
JOURNAL_LINES = 500

Files = dict[str, str]
"""Texts by file name."""


def of_this_machine() -> Files:
    """Versions, and the last lines of a daemon that runs here as a service."""
    packages: dict[str, str] = {}
    for name in PACKAGES:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = "not installed"
    system = {"system": platform.platform(), "python": sys.version, "packages": packages}
    files = {"versions.json": json_text(system)}
    if shutil.which("journalctl"):
        journal = ["journalctl", "-u", "mbot-agent", "-n", str(JOURNAL_LINES), "--no-pager"]
        files["journal.txt"] = redacted(_output(journal))
    return files


def of_robot(make_link: Callable[[], RobotLink]) -> Files:
    """What a robot says of itself: state, faults and notices, models, recordings."""
    try:
        with make_link() as link:
            status = link.status()
            asked: dict[str, Callable[[], Message]] = {
                "models.json": lambda: link.query(MODELS, None, ModelList),
                "recordings.json": lambda: list_recordings(link),
            }
            files = {"status.json": json_text(_plain(status))}
            for name, ask in asked.items():
                files[name] = json_text(_or_error(lambda ask=ask: _plain(ask())))
            return files
    except MbotError as error:
        return {"status.json": json_text({"error": str(error)})}


def of_configuration(path: Path) -> Files:
    """A robot's configuration here, and what `mbot-agent check` says of it.

    Raises:
        ConfigurationError: it can't be read.

    """
    text = read_text(path)
    try:
        settings = tomli_w.dumps(redacted_values(tomllib.loads(text)))
    except tomllib.TOMLDecodeError as error:
        settings = f"# not shown: it is not valid TOML: {redacted(str(error))}\n"
    beside = Path(sys.executable).with_name("mbot-agent")
    program = str(beside) if beside.is_file() else shutil.which("mbot-agent")
    verdict = "mbot-agent is not installed here\n"
    if program is not None:
        verdict = _output([program, "check", "--config", str(path)])
    return {"settings.toml": settings, "check.txt": redacted(verdict)}


def write_archive(path: Path, files: Files) -> None:
    """Write them as a .tar.gz; raises ConfigurationError where that can't be written."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        for name, text in files.items():
            data = text.encode(errors="replace")
            entry = tarfile.TarInfo(f"{FOLDER}/{name}")
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))
    try:
        atomic_file.replace(path, buffer.getvalue(), mode=0o600)
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None


def _output(command: list[str]) -> str:
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=CHECK_TIMEOUT_S,
            text=True,
            errors="replace",
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{command[0]}: {error}\n"
    return f"{done.stdout}exit code {done.returncode}\n"


def _or_error(ask: Callable[[], Any]) -> Any:
    try:
        return ask()
    except MbotError as error:
        return {"error": str(error)}


def _plain(message: Message) -> dict[str, Any]:
    return MessageToDict(message, preserving_proto_field_name=True)


def json_text(value: Any) -> str:
    """A document without what is secret in it."""
    return json.dumps(redacted_values(value), indent=2, ensure_ascii=False) + "\n"
