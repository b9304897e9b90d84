"""deploy/install.sh, run for real into a temporary root.

The programs that would change the machine are stand-ins that write what they were asked to a log;
the script's own file handling is real.
"""

import contextlib
import os
import pty
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from mbot_agent import configuration
from mbot_protocol.wire.keys import check_robot_id

from ..ran import ran

CHECKOUT = Path(__file__).parents[2]
SCRIPT = CHECKOUT / "deploy" / "install.sh"
UNIT = CHECKOUT / "deploy" / "systemd" / "mbot-agent.service"

LOG = 'echo "${0##*/} $*" >> "$FAKE/log"\n'

FAKES = {
    "apt-get": LOG + '[ "$1" != install ] || [ ! -e "$FAKE/apt-fails" ] || exit 100\n'
    '[ "$1" != install ] || for name in "$@"; do echo "$name 1.0" >> "$FAKE/packages"; done\n',
    "chown": LOG,
    "dpkg": 'case $1 in --print-architecture) cat "$FAKE/architecture" ;;\n'
    '--compare-versions) [ "$(printf "%s\\n" "$2" "$4" | sort -V | head -n 1)" = "$2" ] &&'
    ' [ "$2" != "$4" ] ;;\nesac\n',
    "dpkg-query": 'line=$(grep "^$3 " "$FAKE/packages") || exit 1\n'
    'case $2 in *Status*) printf installed ;; *Version*) printf "%s" "${line#* }" ;; esac\n',
    "getent": '[ -e "$FAKE/user" ]\n',
    "id": 'cat "$FAKE/uid"\n',
    "modprobe": LOG + "exit 1\n",
    "runuser": LOG + 'while [ "$1" != -- ]; do shift; done\nshift\nexec "$@"\n',
    "systemd-run": LOG + 'while [ "$1" != -- ]; do shift; done\nshift\nexec "$@"\n',
    "systemctl": '[ "$1" = is-active ] && { [ -e "$FAKE/active" ]; exit; }\n'
    '[ "$1" = show ] && { [ ! -e "$FAKE/active" ] ||'
    ' printf "ActiveState=active\\nMainPID=7\\nStatusText=idle\\n"; exit; }\n' + LOG,
    "systemd-sysusers": LOG + 'touch "$FAKE/user"\n',
    "udevadm": LOG,
    "uname": 'cat "$FAKE/machine"\n',
    "userdel": LOG + 'rm "$FAKE/user"\n',
    "venv-agent": LOG + 'if [ "$1" = try ] && [ -e "$FAKE/try-fails" ]; then\n'
    'echo "no such model" >&2; exit 3; fi\n'
    '[ "$1" = try ] || { echo "board: not found"; [ ! -e "$FAKE/check-fails" ]; }\n',
    # The system's interpreter (`-m venv ... DIR`, or the real updater) and the venv's (`-m pip`).
    "python3": f'[ "$1" != -I ] || exec {sys.executable} "$@"\n' + LOG + "case $2 in\n"
    "venv) for directory; do :; done\n"
    'mkdir -p "$directory/bin" "$directory/lib/python3.11/site-packages/pip"\n'
    'cp "$0" "$directory/bin/python" ;;\n'
    'pip) [ ! -e "$FAKE/pip-fails" ] || exit 1\n'
    'cp "$FAKE/bin/venv-agent" "${0%/*}/mbot-agent" ;;\nesac\n',
}


@dataclass(frozen=True)
class Machine:
    """A temporary root and what its stand-ins know and have been asked."""

    root: Path
    fake: Path

    def install(
        self, *options: str, stdin: int = subprocess.DEVNULL
    ) -> subprocess.CompletedProcess[str]:
        environment = {
            "PATH": f"{self.fake / 'bin'}:{os.defpath}",
            "FAKE": str(self.fake),
            "MBOT_INSTALL_ROOT": str(self.root),
            "MBOT_INSTALL_PYTHON": str(self.fake / "bin" / "python3"),
        }
        return subprocess.run(
            ["sh", SCRIPT, *options],
            env=environment,
            stdin=stdin,
            capture_output=True,
            text=True,
            check=False,
        )

    def installed(self, *options: str, stdin: int = subprocess.DEVNULL) -> str:
        result = self.install(*options, stdin=stdin)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    def asked(self) -> list[str]:
        """What the stand-ins were asked so far."""
        log = self.fake / "log"
        return log.read_text().splitlines() if log.exists() else []

    def forget(self) -> None:
        (self.fake / "log").unlink(missing_ok=True)

    def knows(self, name: str, text: str = "") -> None:
        (self.fake / name).write_text(text)

    def files(self) -> dict[str, bytes]:
        """Everything below the root."""
        return {
            str(path.relative_to(self.root)): path.read_bytes()
            for path in self.root.rglob("*")
            if path.is_file()
        }

    @property
    def release(self) -> Path:
        """The folder that runs."""
        return (self.root / "opt/mbot-agent/current").resolve()

    @property
    def configuration(self) -> Path:
        return self.root / "etc/mbot-agent/config.toml"

    @property
    def camera(self) -> str:
        """The source that the daemon would open."""
        return configuration.load(self.configuration).camera.source


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """A 64-bit Raspberry Pi OS Bookworm, freshly written to its card, with root at the keyboard."""
    machine = Machine(tmp_path / "root", tmp_path / "fake")
    binaries = machine.fake / "bin"
    binaries.mkdir(parents=True)
    for name, body in FAKES.items():
        (binaries / name).write_text("#!/bin/sh\n" + body)
        (binaries / name).chmod(0o755)
    etc = machine.root / "etc"
    etc.mkdir(parents=True)
    (machine.root / "var/tmp").mkdir(parents=True)
    (etc / "os-release").write_text("ID=debian\nVERSION_CODENAME=bookworm\n")
    (etc / "hostname").write_text("Rover-7.local\n")
    machine.knows("uid", "0\n")
    machine.knows("architecture", "arm64\n")
    machine.knows("machine", "aarch64\n")
    machine.knows("packages")
    return machine


@contextlib.contextmanager
def typed(text: str) -> Iterator[int]:
    """A terminal at which somebody has typed this."""
    ours, theirs = pty.openpty()
    try:
        os.write(ours, text.encode())
        yield theirs
    finally:
        os.close(ours)
        os.close(theirs)


def index_of(lines: list[str], start: str) -> int:
    return next(number for number, line in enumerate(lines) if line.startswith(start))


def test_fresh_install_puts_everything_in_place(machine: Machine) -> None:
    output = machine.installed()

    files = machine.files()
    for name in (
        "etc/systemd/system/mbot-agent.service",
        "etc/udev/rules.d/60-mbot.rules",
        "etc/udev/rules.d/95-mbot-brltty.rules",
        "etc/modules-load.d/mbot-agent.conf",
        "etc/sysusers.d/mbot-agent.conf",
        "etc/systemd/system/mbot-agent-update.path",
        "etc/systemd/system/mbot-agent-recover.service",
    ):
        assert name in files
    assert files["etc/systemd/system/mbot-agent.service"] == UNIT.read_bytes()
    command = machine.root / "usr/local/bin/mbot-agent"
    assert command.readlink() == machine.root / "opt/mbot-agent/current/venv/bin/mbot-agent"
    assert command.resolve() == machine.release / "venv/bin/mbot-agent"
    assert configuration.load(machine.configuration).robot_id == "rover-7"
    assert (machine.root / "var/lib/mbot-agent").stat().st_mode & 0o777 == 0o700
    assert (machine.root / "etc/mbot-agent/tls").stat().st_mode & 0o777 == 0o750
    assert (machine.root / "etc/mbot-agent/calibration").stat().st_mode & 0o777 == 0o755
    assert "sudo systemctl start mbot-agent" in output


def test_service_is_enabled_and_checked_but_never_started(machine: Machine) -> None:
    output = machine.installed()

    asked = machine.asked()
    assert index_of(asked, "systemctl daemon-reload") < index_of(asked, "systemctl enable")
    assert index_of(asked, "systemctl enable") < index_of(
        asked, "runuser -u mbot-agent -- env HOME"
    )
    assert "board: not found" in output
    watched = "systemctl enable --now mbot-agent-update.path"
    started = [line for line in asked if re.match(r"systemctl (start|restart|.*--now)", line)]
    assert started == [watched]


@pytest.mark.parametrize("release", ["bookworm", "trixie"])
@pytest.mark.parametrize("architecture", ["arm64", "amd64"])
def test_root_installs_nothing_that_is_not_pinned_by_its_digest(
    machine: Machine, release: str, architecture: str
) -> None:
    (machine.root / "etc/os-release").write_text(f'VERSION_CODENAME="{release}"\n')
    machine.knows("architecture", f"{architecture}\n")
    machine.installed("--without-picamera2")
    asked = machine.asked()
    *pinned, own = (line.split() for line in asked if "-m pip install" in line)
    assert own[-1] == str(CHECKOUT)
    assert {"--no-index", "--no-deps", "--no-build-isolation"} <= set(own)
    files = [Path(words[words.index("-r") + 1]) for words in pinned]
    assert [file.name for file in files] == [f"{release}-{architecture}.txt", "build.txt"]
    for words, file in zip(pinned, files, strict=True):
        assert {"--require-hashes", "--no-deps", "--only-binary=:all:"} <= set(words)
        assert file.is_file()
    assert "-m venv --system-site-packages" in "\n".join(asked)


def test_all_that_the_robot_and_its_build_want_is_pinned() -> None:
    """What `make pins` would write; on Bookworm numpy and OpenCV are older ones."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    tested = dict(re.findall(r"(?m)^(.+)==(.+)$", (CHECKOUT / "constraints.txt").read_text()))
    wanted = [*project["project"]["dependencies"]]
    wanted += project["project"]["optional-dependencies"]["robot"]
    for path in (CHECKOUT / "deploy/requirements").iterdir():
        words = project["build-system"]["requires"] if path.stem == "build" else wanted
        pins = re.findall(r"(?m)^(\S+)==(\S+) --hash=sha256:[0-9a-f]{64}$", path.read_text())
        assert len(pins) == len(path.read_text().splitlines()) - 1
        assert {re.split("[<>=; ]", word)[0] for word in words} <= dict(pins).keys()
        own = {"numpy", "opencv-python-headless"} if "bookworm" in path.name else set()
        assert all(tested.get(name, pin) == pin for name, pin in pins if name not in own)


def test_second_install_changes_nothing_and_keeps_an_edited_configuration(
    machine: Machine,
) -> None:
    machine.installed()
    machine.configuration.write_text(
        machine.configuration.read_text().replace("accept_no_deadman = false", "# mine")
    )
    model = machine.root / "var/lib/mbot-agent/models/policy.onnx"
    model.parent.mkdir()
    model.write_bytes(b"model")
    before = machine.files()
    machine.forget()

    machine.installed()

    assert machine.files() == before
    asked = "\n".join(machine.asked())
    assert "apt-get" not in asked
    assert "-m venv" not in asked
    assert "-m pip install" not in asked  # the same content is the same release


def test_a_first_configuration_is_put_there_as_it_is_and_only_once(
    machine: Machine, tmp_path: Path
) -> None:
    own = tmp_path / "own.toml"
    for text in ('robot_id = "mine"\n', 'robot_id = "other"\n'):
        own.write_text(text)
        machine.installed("--config", str(own))
        assert machine.configuration.read_text() == 'robot_id = "mine"\n'
    assert machine.configuration.stat().st_mode & 0o777 == 0o640
    assert f"chown root:mbot-agent {machine.configuration}" in machine.asked()
    refused = machine.install("--config", str(tmp_path / "none.toml"))
    assert (refused.returncode, len(refused.stderr.splitlines())) == (2, 1)


def test_what_no_robot_needs_is_not_kept(machine: Machine) -> None:
    machine.installed()
    packages = machine.release / "venv/lib/python3.11/site-packages"
    assert list(packages.iterdir()) == []  # pip was there


def test_the_next_system_gets_a_release_of_its_own(machine: Machine) -> None:
    machine.installed()
    before = machine.release
    (machine.root / "etc/os-release").write_text("VERSION_CODENAME=trixie\n")
    machine.forget()
    machine.installed()
    assert "-m venv" in "\n".join(machine.asked())
    assert machine.release != before
    assert (before / "whole").exists()  # the golden one


def test_a_running_daemon_runs_on_until_it_is_restarted_with_the_new_release(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine.installed()
    (machine.root / "etc/os-release").write_text("VERSION_CODENAME=trixie\n")
    machine.knows("active")
    machine.forget()
    output = machine.installed()
    asked = machine.asked()
    assert index_of(asked, "python -m pip install") < index_of(asked, "systemctl restart")
    assert not [line for line in asked if line.startswith("systemctl stop")]
    assert "was running and runs again" in output
    assert "systemd-run" in "\n".join(asked)
    assert not [line for line in asked if line.endswith("mbot-agent check")]  # it has the board


@pytest.mark.parametrize("step", ["pip", "try"])
def test_a_failed_update_leaves_the_running_daemon_running_and_says_so(
    machine: Machine, step: str
) -> None:
    machine.installed()
    current = machine.release
    (machine.root / "etc/os-release").write_text("VERSION_CODENAME=trixie\n")
    machine.knows("active")
    if step == "pip":
        machine.knows("pip-fails")
    else:  # of the new one only
        old = current / "venv/bin/mbot-agent"
        old.write_text("#!/bin/sh\nexit 0\n")
        machine.knows("try-fails")
    machine.forget()
    result = machine.install()
    assert result.returncode == 1
    assert "the update failed, see above; mbot-agent runs on as it was" in result.stderr
    assert machine.release == current
    assert not [line for line in machine.asked() if re.match(r"systemctl (stop|restart)", line)]


def test_an_installation_of_before_releases_is_taken_over(machine: Machine) -> None:
    old = machine.root / "opt/mbot-agent/venv/bin/mbot-agent"
    old.parent.mkdir(parents=True)
    old.write_text("#!/bin/sh\n")
    unit = machine.root / "etc/systemd/system/mbot-agent.service"
    unit.parent.mkdir(parents=True)
    unit.write_text("[Service]\n")
    machine.configuration.parent.mkdir(parents=True)
    machine.configuration.write_text('robot_id = "mine"\n')
    machine.knows("active")
    assert "Taking over" in machine.installed()
    assert machine.configuration.read_text() == 'robot_id = "mine"\n'
    assert unit.is_symlink()
    assert not old.exists()  # what runs has shown itself
    assert "Taking over" not in machine.installed()


def test_a_release_that_is_none_is_refused(machine: Machine, tmp_path: Path) -> None:
    archive = tmp_path / "release.tar"
    archive.write_bytes(b"no release")
    result = machine.install(str(archive))
    assert result.returncode == 1
    assert "the archive is damaged or no release" in result.stderr
    assert not (machine.root / "opt/mbot-agent/current").exists()
    assert "there is no release" in machine.install(str(tmp_path / "nothing.tar")).stderr


def test_uninstall_keeps_configuration_and_models(machine: Machine) -> None:
    machine.installed()
    model = machine.root / "var/lib/mbot-agent/policy.onnx"
    model.write_bytes(b"model")
    machine.forget()

    for _ in range(2):
        machine.installed("--uninstall")

    assert set(machine.files()) == {
        "etc/os-release",
        "etc/hostname",
        "etc/mbot-agent/config.toml",
        "var/lib/mbot-agent/policy.onnx",
    }
    assert not os.path.lexists(machine.root / "usr/local/bin/mbot-agent")
    disabled = [x for x in machine.asked() if x.startswith("systemctl disable --now mbot-agent.s")]
    assert len(disabled) == 1
    assert (machine.fake / "user").exists()


def test_purge_leaves_nothing(machine: Machine) -> None:
    before = machine.files()
    machine.installed()
    units = machine.root / "etc/systemd/system"
    edited = [units / f"{path.name}.d" for path in UNIT.parent.iterdir()]
    assert len(edited) > 4
    for folder in edited:  # as `systemctl edit` does
        folder.mkdir()
        (folder / "override.conf").write_text("[Unit]\n")
    machine.installed("--uninstall")
    assert all(folder.exists() for folder in edited)
    for _ in range(2):
        machine.installed("--uninstall", "--purge")
    assert machine.files() == before
    assert not list(units.iterdir())
    assert not (machine.root / "etc/mbot-agent").exists()
    assert not (machine.root / "var/lib/mbot-agent").exists()
    assert machine.asked().count("userdel mbot-agent") == 1


def test_install_after_purge_works(machine: Machine) -> None:
    machine.installed()
    machine.installed("--uninstall", "--purge")
    machine.installed()
    assert machine.configuration.exists()


@pytest.mark.parametrize(
    ("facts", "options", "status", "words"),
    [
        ({"architecture": "armhf", "machine": "armv6l"}, (), 1, "ARMv6"),
        ({"architecture": "armhf", "machine": "aarch64"}, (), 1, "32-bit"),
        ({"architecture": "riscv64", "machine": "riscv64"}, (), 1, "arm64 is needed"),
        ({"architecture": "amd64", "machine": "x86_64"}, (), 1, "--without-picamera2"),
        ({"uid": "1000"}, (), 1, "sudo"),
        ({"uid": "1000"}, ("--uninstall",), 1, "sudo"),
        ({}, ("--bogus",), 2, "--bogus"),
        ({}, ("--purge",), 2, "--uninstall"),
        ({}, ("--camera",), 2, "wants a source"),
        ({}, ("--camera", ""), 2, "wants a source"),
        ({}, ("--camera", "--dry-run"), 2, "wants a source"),
        ({}, ("--camera", 'a"'), 2, "quotes"),
        ({}, ("--camera", "/dev/video0\n"), 2, "newlines"),
        ({}, ("--camera", "rtsp://10.0.0.5/stream"), 2, "ffmpeg:"),
        ({}, ("--camera", "picamera2", "--without-picamera2"), 2, "contradicts"),
        ({}, ("--camera", "/dev/video0", "--config", str(UNIT)), 2, "--camera or --config"),
    ],
)
def test_refusals_are_one_line_and_change_nothing(
    machine: Machine, facts: dict[str, str], options: tuple[str, ...], status: int, words: str
) -> None:
    for name, text in facts.items():
        machine.knows(name, text + "\n")
    before = machine.files()

    result = machine.install(*options)

    assert result.returncode == status
    assert len(result.stderr.splitlines()) == 1
    assert words in result.stderr
    assert machine.files() == before
    assert machine.asked() == []


@pytest.mark.parametrize("text", ["VERSION_CODENAME=bullseye\n", ""])
def test_other_releases_are_refused(machine: Machine, text: str) -> None:
    (machine.root / "etc/os-release").write_text(text)
    result = machine.install()
    assert result.returncode == 1
    assert "expected Raspberry Pi OS bookworm or trixie" in result.stderr


def test_dry_run_needs_no_root_and_changes_nothing(machine: Machine) -> None:
    machine.knows("uid", "1000\n")
    before = machine.files()
    output = machine.installed("--dry-run")
    machine.installed("--uninstall", "--purge", "--dry-run")
    assert machine.files() == before
    assert machine.asked() == []
    assert "would run: systemctl enable mbot-agent.service" in output
    assert "would run: apt-get update" in output


def test_help_names_every_option(machine: Machine) -> None:
    output = machine.installed("--help")
    named = re.findall(r"^  (--[a-z0-9-]+)", output, re.MULTILINE)
    known = re.findall(r"^ {8}(--[a-z0-9-]+)(?: \| -h)?\)", SCRIPT.read_text(), re.MULTILINE)
    assert len(known) == 7
    assert set(named) == set(known)


def test_other_cameras_need_no_picamera2(machine: Machine) -> None:
    machine.knows("architecture", "amd64\n")
    output = machine.installed("--without-picamera2")
    assert "picamera2" not in (machine.fake / "packages").read_text()
    said = [line for line in output.splitlines() if 'source = "' in line]
    assert len(said) == 1  # which line to add, where nobody can be asked
    assert "[camera]" in said[0]
    assert machine.camera == "picamera2"


@pytest.mark.parametrize(
    "source",
    [
        "/dev/video0",
        "/dev/v4l/by-id/usb-Cam_1&2|3 [4]-video-index0",
        "http://rosa:a$b`c@10.0.0.5:8090/stream.mjpg?a=1&b=#2",
        "ffmpeg:rtsp://10.0.0.5/stream",
    ],
)
def test_a_first_configuration_gets_the_camera_that_was_named(
    machine: Machine, source: str
) -> None:
    before = (CHECKOUT / "deploy/config.toml").read_text().splitlines()
    output = machine.installed("--without-picamera2", "--camera", source)
    assert machine.camera == source
    after = machine.configuration.read_text().splitlines()
    changed = [new for old, new in zip(before, after, strict=True) if old != new]
    assert changed == ['robot_id = "rover-7"', f'source = "{source}"']
    assert 'source = "' not in output


def test_an_existing_configuration_keeps_its_camera_and_the_line_to_change_is_told(
    machine: Machine,
) -> None:
    machine.installed("--without-picamera2", "--camera", "/dev/video0")
    assert "--camera changes" not in machine.installed("--camera", "/dev/video0")
    before = machine.configuration.read_bytes()
    output = machine.installed("--without-picamera2", "--camera", "/dev/video2")
    assert machine.configuration.read_bytes() == before
    assert "config.toml is kept" in output
    assert 'in [camera], change to: source = "/dev/video2"' in output


def test_at_a_terminal_the_camera_is_asked_for_once(machine: Machine) -> None:
    with typed(" /dev/video1 \n") as terminal:
        output = machine.installed("--without-picamera2", stdin=terminal)
        assert "Camera's source" in output
        assert machine.camera == "/dev/video1"
        for options in (
            ("--without-picamera2",),  # there is a configuration
            ("--uninstall", "--purge"),
            ("--without-picamera2", "--dry-run"),
            (),
        ):
            assert "Camera's source" not in machine.installed(*options, stdin=terminal)


@pytest.mark.parametrize("answer", ["\n", "\x04"])
def test_no_answer_leaves_the_camera_for_later(machine: Machine, answer: str) -> None:
    with typed(answer) as terminal:
        output = machine.installed("--without-picamera2", stdin=terminal)
    assert 'source = "/dev/video0"' in output
    assert machine.camera == "picamera2"


def test_a_wrong_answer_is_one_line_and_changes_nothing(machine: Machine) -> None:
    before = machine.files()
    with typed('a"b\n') as terminal:
        result = machine.install("--without-picamera2", stdin=terminal)
    assert (result.returncode, len(result.stderr.splitlines())) == (2, 1)
    assert machine.files() == before
    assert machine.asked() == []


def test_no_source_gets_past_its_quotes(machine: Machine) -> None:
    """Any character is refused, or comes out as it went in."""
    plain = "".join(chr(number) for number in range(32, 127) if chr(number) not in "\"'\\")
    for character in ({chr(number) for number in range(1, 256)} | {"\u2028"}) - set(plain):
        result = machine.install("--without-picamera2", "--camera", f"/dev/{character}")
        assert (result.returncode, len(result.stderr.splitlines())) == (2, 1), character
    assert machine.asked() == []
    machine.installed("--without-picamera2", "--camera", f"/dev/{plain}")
    assert machine.camera == f"/dev/{plain}"


@pytest.mark.parametrize(
    ("hostname", "robot_id"),
    [
        ("mbot-3", "mbot-3"),
        ("Robot_A.lab.example", "robot_a"),
        ("-x", "x"),
        ("a*/b", "ab"),
        ("a" * 63, "a" * 32),
        ("***", "mbot-1"),
        ("", "mbot-1"),
    ],
)
def test_robot_is_named_after_its_host(machine: Machine, hostname: str, robot_id: str) -> None:
    (machine.root / "etc/hostname").write_text(hostname + "\n")
    machine.installed()
    assert configuration.load(machine.configuration).robot_id == check_robot_id(robot_id)


def test_default_hostname_is_pointed_out(machine: Machine) -> None:
    (machine.root / "etc/hostname").write_text("raspberrypi\n")
    assert "change robot_id" in machine.installed()


def test_a_key_is_asked_for_until_there_is_one(machine: Machine) -> None:
    assert "workstation keys new" in machine.installed()
    text = machine.configuration.read_text()
    machine.configuration.write_text(text.replace("keys = []", 'keys = ["ed25519:AAAA= anna"]'))
    assert "workstation keys new" not in machine.installed()
    machine.configuration.write_text(text)
    sent = machine.configuration.with_name("trusted-keys.toml")  # by `workstation enroll`
    sent.write_text("# ed25519:...\n\nkeys = []\n")
    assert "workstation keys new" in machine.installed()
    sent.write_text('# ed25519:...\n\nkeys = [\n    "ed25519:AAAA= anna",\n]\n')
    assert "workstation keys new" not in machine.installed()


def test_a_discontent_check_does_not_undo_the_install(machine: Machine) -> None:
    machine.knows("check-fails")
    assert "mend it before the start" in machine.installed()


@pytest.mark.parametrize("step", ["apt", "pip"])
def test_failed_download_ends_it_before_the_service_is_enabled(machine: Machine, step: str) -> None:
    machine.knows(f"{step}-fails")
    result = machine.install()
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1
    assert ("--without-picamera2" in result.stderr) is (step == "apt")
    assert not [line for line in machine.asked() if line.startswith("systemctl enable")]
    (machine.fake / f"{step}-fails").unlink()
    machine.installed()


@pytest.mark.parametrize(("version", "warned"), [("6.4-4", True), ("6.5-7+deb12u1", False)])
def test_old_brltty_is_pointed_out(machine: Machine, version: str, warned: bool) -> None:
    machine.knows("packages", f"brltty {version}\n")
    assert ("warning: brltty" in machine.installed()) is warned


def test_the_updater_has_all_it_needs_and_nothing_else(machine: Machine) -> None:
    machine.installed()
    files = machine.root / "opt/mbot-agent/updater"
    from mbot_workstation.fleet.releases.make_release import put_updater

    put_updater(machine.root / "compared")
    assert {str(path.relative_to(files)) for path in files.rglob("*.py")} == {
        str(path.relative_to(machine.root / "compared"))
        for path in (machine.root / "compared").rglob("*.py")
    }


def test_the_unit_starts_what_the_script_installs(machine: Machine) -> None:
    machine.installed()
    started = re.search(r"^ExecStart=(\S+)", UNIT.read_text(), re.MULTILINE)
    assert started
    assert (machine.root / started[1].lstrip("/")).exists()


def test_shellcheck_has_nothing_to_say() -> None:
    shellcheck = Path(sys.executable).with_name("shellcheck")  # of the extra [dev]
    result = ran(shellcheck, SCRIPT)
    assert result.returncode == 0, result.stdout
