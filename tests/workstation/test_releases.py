"""Releases made and sent: the same inputs give the same archive, and the outcome is waited for."""

import contextlib
import json
import subprocess
import zipfile
from pathlib import Path

import pytest
from google.protobuf.message import Message

from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_protocol.signing.envelope import RELEASE, Envelope, verify
from mbot_protocol.v1.messages_pb2 import (
    PushChunk,
    PushReply,
    ReleaseBegin,
    ReleaseList,
    ReleaseUpdate,
)
from mbot_protocol.wire.keys import RELEASE_BEGIN, RELEASE_CHUNK, RELEASE_COMMIT, RELEASES, Topic
from mbot_workstation.cli.set_up import UpdateOptions, update
from mbot_workstation.fleet.link.robot_link import M
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases import make_release, robot_wheels, send_release
from mbot_workstation.fleet.releases.robot_wheels import TARGETS

from .called import output_of

KEY, SPARE = SigningKey.ephemeral("first"), SigningKey.ephemeral("spare")


def wheel(folder: Path, name: str, *files: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    with zipfile.ZipFile(path, "w") as file:
        for inside in files or ("a.py",):
            file.writestr(zipfile.ZipInfo(inside), "x = 1\n" * 1000)
    return path


@pytest.fixture
def release(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    needed = wheel(tmp_path / "cache", "some_thing-1.0-py3-none-any.whl").parent
    monkeypatch.setattr(make_release, "fetch_wheels", lambda *_: needed)
    return made(tmp_path)


def made(folder: Path, out: str = "out", firmware: str | None = "mbot-deadman.hex") -> Path:
    daemon = wheel(folder / "daemon", "mbot_agent-0.1.0-py3-none-any.whl")
    (folder / out).mkdir()
    (folder / "mbot-deadman.hex").write_text(":00000001FF\n")
    return make_release.make_release(
        TARGETS[0],
        daemon,
        "0.1+a",
        7,
        5,
        [KEY, SPARE],
        folder / out,
        folder / "cache",
        None if firmware is None else folder / firmware,
    )


def test_a_release_holds_what_a_robot_needs(release: Path) -> None:
    checked = send_release.check_release_file(release)
    paths = {file.path for file in checked.manifest.files}
    assert {
        "requirements.txt",
        "wheels/mbot_agent-0.1.0-py3-none-any.whl",
        "wheels/some_thing-1.0-py3-none-any.whl",
        "deploy/install.sh",
        "deploy/systemd/mbot-agent.service",
        "deploy/udev/60-mbot.rules",
        "firmware/mbot-deadman.hex",
        "updater/__main__.py",
        "updater/mbot_update/update_steps.py",
        "updater/mbot_protocol/signing/release_manifest.py",
    } <= paths
    manifest = checked.manifest
    assert (manifest.version, manifest.sequence, manifest.floor) == ("0.1+a", 7, 5)
    assert (manifest.system, manifest.architecture, manifest.python) == (
        "bookworm",
        "arm64",
        "3.11",
    )
    assert manifest.installed_bytes > 12_000
    for key in (KEY, SPARE):
        envelope = Envelope.with_lines(checked.data, checked.signatures)
        assert verify(RELEASE, envelope, [key.public]) == key.public


def test_a_release_without_firmware_is_asked_for_by_name(
    release: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert release.exists()
    manifest = send_release.check_release_file(made(tmp_path, "without", None)).manifest
    assert not [file.path for file in manifest.files if "firmware" in file.path]
    with pytest.raises(
        ConfigurationError, match=r"no firmware at .*not-made\.hex: `make firmware`"
    ):
        made(tmp_path, "missing", "not-made.hex")
    assert not list((tmp_path / "missing").iterdir())

    monkeypatch.setattr(make_release, "FIRMWARE", tmp_path / "not-made.hex")
    said: list[str] = []
    for options in ([], ["--without-firmware", "--sign-with", "nobody"]):
        words = ["--version", "0", "--sequence", "0", *options]
        monkeypatch.setattr("sys.argv", ["make dist", *words])
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        with pytest.raises(SystemExit):
            make_release.main()
        said += capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert said[0].endswith("`make firmware` compiles it; or give --without-firmware")
    assert "nobody" in said[1]  # it got as far as the key


@pytest.mark.parametrize("target", ["dist", "deb"])
def test_make_compiles_the_firmware_of_a_release(target: str) -> None:
    command = ["make", "--dry-run", "--always-make", target]
    done = subprocess.run(
        command, cwd=make_release.CHECKOUT, capture_output=True, text=True, check=True
    )
    assert done.stdout.index("avr-objcopy") < done.stdout.index("releases.make_release")


def test_every_requirement_is_pinned_by_its_digest(release: Path) -> None:
    import tarfile

    with tarfile.open(release) as tar:
        content = tar.extractfile("requirements.txt")
        assert content is not None
        lines = content.read().decode().splitlines()
    assert len(lines) == 2
    assert all("==" in line and "--hash=sha256:" in line for line in lines)
    assert lines[0].startswith("mbot-agent==0.1.0 ")


def test_the_same_inputs_make_the_same_archive(release: Path, tmp_path: Path) -> None:
    assert made(tmp_path, "again").read_bytes() == release.read_bytes()


def test_what_is_damaged_is_noticed_before_anything_is_sent(release: Path) -> None:
    data = bytearray(release.read_bytes())
    data[-5000] ^= 1
    release.write_bytes(data)
    with pytest.raises(ConfigurationError):
        send_release.check_release_file(release)
    with pytest.raises(ConfigurationError, match="cannot read"):
        send_release.check_release_file(release.with_name("none.tar"))


class FakeLink:
    """A robot that takes a release and then says what the list says."""

    robot_id = "mbot-1"

    def __init__(self, *updates: ReleaseUpdate | None, refuses: str = "") -> None:
        self.updates: list[ReleaseUpdate | None] = [*updates]
        self.refuses = refuses
        self.received = b""

    def query(
        self, topic: Topic, request: Message | None, reply_type: type[M], timeout_s: float = 0.0
    ) -> M:
        reply = self.reply(topic, request)
        assert isinstance(reply, reply_type)
        return reply

    def reply(self, topic: Topic, request: Message | None) -> Message:
        if topic is RELEASES:
            update = self.updates.pop(0) if len(self.updates) > 1 else self.updates[0]
            if update is None:
                raise UnreachableError("it restarts")
            return ReleaseList(accepted=True, update=update)
        assert topic in (RELEASE_BEGIN, RELEASE_CHUNK, RELEASE_COMMIT)
        if isinstance(request, ReleaseBegin) and self.refuses:
            return PushReply(reason=self.refuses)
        if isinstance(request, ReleaseBegin):
            self.received = b""
        if isinstance(request, PushChunk):
            self.received += request.data
        return PushReply(accepted=True, push_id="a1", received_bytes=len(self.received))


def test_all_of_it_is_sent_and_refusals_come_back(release: Path) -> None:
    checked = send_release.check_release_file(release)
    link, seen = FakeLink(), list[tuple[int, int]]()
    number = send_release.send(link, checked, lambda *both: seen.append(both))
    assert number == "a1"
    assert link.received == release.read_bytes()
    assert seen[-1] == (len(link.received), len(link.received))
    with pytest.raises(RefusedError, match="refused the release and runs on: armed"):
        send_release.send(FakeLink(refuses="armed"), checked, lambda *_: None)


def test_the_outcome_is_waited_for_across_the_restart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(send_release, "LOOK_AGAIN_S", 0.0)
    link = FakeLink(
        ReleaseUpdate(request="old", phase="installed"),
        ReleaseUpdate(request="a1", phase="building", goes_on=True),
        None,
        ReleaseUpdate(request="a1", phase="rolled-back", detail="no READY", goes_on=True),
        ReleaseUpdate(request="a1", phase="rolled-back", detail="no READY"),
    )
    phases: list[str] = []
    update = send_release.wait_for_outcome(link, "a1", phases.append)
    assert (update.phase, phases) == ("rolled-back", ["building"])


def test_the_command_ends_with_the_outcome(release: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = FakeLink(ReleaseUpdate(request="a1", phase="installed", detail="0.1+a runs"))
    monkeypatch.setattr(UpdateOptions, "link", lambda _: contextlib.nullcontext(link))
    assert json.loads(output_of(update, release, "--json"))["outcome"] == "installed"
    link.updates[0] = ReleaseUpdate(request="a1", phase="rolled-back", detail="no READY; 0 runs")
    with pytest.raises(RefusedError) as error:
        output_of(update, release)
    assert str(error.value) == "mbot-1 does not run 0.1+a: rolled-back: no READY; 0 runs"


def test_an_updater_that_does_nothing_is_pointed_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(send_release, "LOOK_AGAIN_S", 0.0)
    monkeypatch.setattr(send_release, "TAKEN_UP_WITHIN_S", 0.0)
    link = FakeLink(ReleaseUpdate(request="old", phase="installed", goes_on=True))
    with pytest.raises(UnreachableError, match="its updater does nothing"):
        send_release.wait_for_outcome(link, "a1", lambda _: None)
    monkeypatch.setattr(send_release, "LONGEST_SILENCE_S", 0.0)
    with pytest.raises(UnreachableError, match="does not say"):
        send_release.wait_for_outcome(FakeLink(None), "a1", lambda _: None)


def test_a_wheel_of_which_a_robot_keeps_nothing_is_not_pinned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def download(_: object, folder: Path, __: object) -> None:
        wheel(folder, "lz4-4.4.5-py3-none-any.whl", "lz4/frame.py", "lz4-4.4.5.dist-info/RECORD")
        wheel(folder, "mcap-1.6.0-py3-none-any.whl", "mcap/writer.py")

    (tmp_path / "pyproject.toml").symlink_to(make_release.CHECKOUT / "pyproject.toml")
    monkeypatch.setattr(robot_wheels, "_download", download)
    folder = robot_wheels.fetch_wheels(TARGETS[0], tmp_path, tmp_path / "cache")
    assert [path.name for path in folder.iterdir()] == ["mcap-1.6.0-py3-none-any.whl"]
    pins = (tmp_path / "deploy/requirements/bookworm-arm64.txt").read_text()
    assert "mcap==1.6.0" in pins
    assert "lz4" not in pins


def test_each_target_has_its_pins(tmp_path: Path) -> None:
    for target in TARGETS:
        pins = make_release.CHECKOUT / "deploy/requirements" / f"{target.name}.txt"
        lines = [line for line in pins.read_text().splitlines() if not line.startswith("#")]
        assert any(line.startswith("onnxruntime==") for line in lines)
        assert not [line for line in lines if line.startswith(("lz4==", "zstandard=="))]
        assert all("--hash=sha256:" in line for line in lines)
    assert robot_wheels.requirement(wheel(tmp_path, "a_b-1-py3-none-any.whl")).startswith("a-b==1 ")
