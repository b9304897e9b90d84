"""Policies that are handed on: what is published, and what is taken of a folder that lies."""

import hashlib
import os
import threading
import urllib.request
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError, MbotError, RefusedError, UnreachableError
from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_protocol.signing.envelope import MODEL
from mbot_workstation.cli.policies import get_policy, list_policies, publish
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.policies.policy_card import (
    PolicyCard,
    RewardInterval,
    Tried,
    fingerprint,
    read_card,
    sign_card,
)
from mbot_workstation.fleet.policies.publishers import Publishers, publishers_file
from mbot_workstation.fleet.policies.shelf import (
    CARD,
    INDEX,
    MODEL_FILE,
    SIGNATURE,
    FewRedirects,
    FolderShelf,
    WebShelf,
    card_on,
    model_on,
    names_on,
    open_shelf,
    put_on,
)
from mbot_workstation.learn.evaluation.episodes import Trial
from mbot_workstation.learn.evaluation.publishing import refuse_unfit, try_beside_servo
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.tasks.fetch.task import TASK

from ..robot.tiny_models import constant_model
from .called import called, output_of

SERVO = servo_model(ServoGains(), PolicyMetadata("servo")).SerializeToString(deterministic=True)
KEY = SigningKey.ephemeral("lab")


def card(model: bytes = SERVO, name: str = "servo", **given: object) -> PolicyCard:
    reward = RewardInterval(20.0, 19.5, 20.5)
    made = PolicyCard(
        name=name,
        publisher="lab (anna)",
        sha256=hashlib.sha256(model).hexdigest(),
        size_bytes=len(model),
        task="fetch",
        object="red cube",
        training={"run": "first", "seed": 1, "lessons": ["10"], "mean_reward": 19.5605},
        evaluation=(Tried("nominal", "10", 50, 0, reward, reward),),
        not_good_at=("dark rooms",),
        based_on="",
        published_unix_s=1_800_000_000,
    )
    return msgspec.structs.replace(made, **given)


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    put_on(tmp_path / "policies", card(), SERVO, KEY)
    return tmp_path / "policies"


def test_what_was_published_is_found_asked_for_once_and_taken(folder: Path) -> None:
    assert "servo" in output_of(list_policies, folder)
    assert "not seen before" in output_of(list_policies, folder)
    marks = fingerprint(KEY.public)
    refused = called(get_policy, folder, "servo").exception
    assert isinstance(refused, RefusedError)
    assert f"--trust {marks}" in str(refused)
    assert not Path("servo.onnx").exists()
    said = output_of(get_policy, folder, "servo", "--trust", marks)
    assert "not good at: dark rooms" in said
    assert "next: workstation push-model servo.onnx" in said
    assert Path("servo.onnx").read_bytes() == SERVO
    assert publishers_file().read_text() == KEY.public.line.replace(" lab", " labanna") + "\n"
    # Its key is known from now on.
    output_of(get_policy, folder, "servo", "-o", "again.onnx")
    assert "not seen before" not in output_of(list_policies, folder, "FETCH")
    assert "there are no policies" in output_of(list_policies, folder, "zebra")


def test_another_key_than_the_one_named_is_refused_though_it_be_known(folder: Path) -> None:
    signed = card_on(FolderShelf(folder), "servo")
    Publishers().admit(signed, fingerprint(KEY.public), lambda _: False)
    with pytest.raises(RefusedError, match="not by 0000"):
        Publishers().admit(signed, "0000", lambda _: True)
    other = SigningKey.ephemeral("lab")
    put_on(folder, card(), SERVO, other)
    with pytest.raises(RefusedError, match="not trusted here"):
        Publishers().admit(card_on(FolderShelf(folder), "servo"), "", lambda _: False)


def test_ones_own_key_needs_no_question(tmp_path: Path) -> None:
    KeyFolder().new("anna")
    put_on(tmp_path / "mine", card(), SERVO, KeyFolder().load("anna", lambda _: ""))
    output_of(get_policy, tmp_path / "mine", "servo")


def refusal(shelf: FolderShelf | WebShelf, name: str = "servo") -> str:
    with pytest.raises(MbotError) as caught:
        model_on(shelf, card_on(shelf, name).card)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_whatever_was_changed_is_refused(folder: Path) -> None:
    shelf, home = FolderShelf(folder), folder / "servo"
    whole = {name: (home / name).read_bytes() for name in (CARD, SIGNATURE, MODEL_FILE)}
    signed = KEY.sign(MODEL, whole[CARD]).line.encode()
    changes = (
        (MODEL_FILE, SERVO + b"\0", "has more than"),
        (MODEL_FILE, SERVO[:-1], "is not the one that the card was signed for"),
        (MODEL_FILE, bytes(len(SERVO)), "is not the one that the card was signed for"),
        (CARD, whole[CARD].replace(b"20.0", b"21.0"), "is not what was signed"),
        (CARD, b"", "is not what was signed"),
        (CARD, b"x" * 70_000, "has more than"),
        (SIGNATURE, b"", "it has none"),
        (SIGNATURE, b"rubbish", "is damaged"),
        (SIGNATURE, signed, "is not what was signed"),
        (SIGNATURE, whole[SIGNATURE] * 2, "is damaged"),
    )
    for name, data, words in changes:
        (home / name).write_bytes(data)
        assert words in refusal(shelf), words
        (home / name).write_bytes(whole[name])
    (home / SIGNATURE).unlink()
    assert "can't read" in refusal(shelf)


def test_no_policy_stands_in_anothers_place(folder: Path) -> None:
    (folder / "servo").rename(folder / "red-cube")
    assert "is another policy's" in refusal(FolderShelf(folder), "red-cube")


@pytest.mark.parametrize("name", ["..", "../servo", "a/b", "/etc", ".hidden", "A", "", "a" * 49])
def test_no_name_leads_elsewhere(folder: Path, name: str) -> None:
    with pytest.raises(ConfigurationError, match=r"is no policy's name"):
        card_on(FolderShelf(folder), name)
    (folder / INDEX).write_bytes(msgspec.json.encode({"policies": [name, "servo"]}))
    assert names_on(FolderShelf(folder)) == ["servo"]


def test_links_and_what_is_no_file_are_not_read(folder: Path, tmp_path: Path) -> None:
    home, shelf = folder / "servo", FolderShelf(folder)
    (tmp_path / "secret").write_bytes((home / CARD).read_bytes())
    (home / CARD).unlink()
    (home / CARD).symlink_to(tmp_path / "secret")
    assert "can't read" in refusal(shelf)
    (home / CARD).unlink()
    os.mkfifo(home / CARD)
    assert "no plain file" in refusal(shelf)
    home.rename(tmp_path / "elsewhere")
    home.symlink_to(tmp_path / "elsewhere")
    assert "can't read" in refusal(shelf)


def test_a_model_that_no_robot_takes_is_not_taken_though_it_is_signed(tmp_path: Path) -> None:
    put_on(tmp_path / "bad", card(b"no model"), b"no model", KEY)
    assert "servo: " in refusal(FolderShelf(tmp_path / "bad"))


@given(st.binary(max_size=300))
def test_no_signed_rubbish_brings_it_down(data: bytes) -> None:
    from mbot_workstation.fleet.policies.policy_card import POLICY

    signature = KEY.sign(POLICY, data).line.encode()
    with pytest.raises(RefusedError):
        read_card(data, signature, "servo")


def test_a_card_of_a_newer_kind_says_so() -> None:
    data, signature = sign_card(card(version=2), KEY)
    with pytest.raises(MbotError, match="upgrade"):
        read_card(data, signature, "servo")


class _Odd(BaseHTTPRequestHandler):
    """A server that means no good."""

    def do_GET(self) -> None:
        if self.path.startswith("/loop"):
            self._leads_to(f"{self.path}x")
        elif self.path.startswith("/file"):
            self._leads_to("file:///etc/passwd")
        elif self.path.startswith("/endless"):
            self.send_response(200)
            self.end_headers()
            try:
                while True:
                    self.wfile.write(bytes(65536))
            except OSError:
                pass
        else:
            self.send_error(404)

    def _leads_to(self, address: str) -> None:
        self.send_response(302)
        self.send_header("Location", address)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


def served(handler: object) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)  # pyright: ignore[reportArgumentType]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def test_a_plain_web_server_is_enough(folder: Path) -> None:
    for address in served(partial(_Quiet, directory=str(folder))):
        assert "servo" in output_of(list_policies, f"{address}/")
        output_of(get_policy, address, "servo", "--trust", fingerprint(KEY.public))
    assert Path("servo.onnx").read_bytes() == SERVO


def test_a_server_that_means_no_good_ends_in_one_line() -> None:
    for address in served(_Odd):
        for path, kind, words in (
            ("loop", UnreachableError, "302"),
            ("file", UnreachableError, "not allowed"),
            ("endless", RefusedError, "has more than"),
            ("nothing", UnreachableError, "404"),
        ):
            with pytest.raises(kind, match=words) as caught:
                names_on(open_shelf(f"{address}/{path}"))
            assert "\n" not in str(caught.value)
    with pytest.raises(UnreachableError, match="can't be read"):
        names_on(WebShelf("http://127.0.0.1:9/policies"))


def test_what_began_secured_stays_so() -> None:
    request, to = urllib.request.Request("https://host/x"), "http://host/x"
    with pytest.raises(RefusedError, match="which is not followed"):
        FewRedirects().redirect_request(request, None, 302, "", {}, to)


@pytest.mark.parametrize(
    "place",
    ["https://anna:pw@host/x", "https://", "http://host/x?y", "no-such-folder", "ftp://h/x"],
)
def test_a_place_that_is_none_is_refused(place: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        open_shelf(place)
    assert "pw" not in str(caught.value)


def test_what_does_the_same_whatever_it_sees_is_not_published(tmp_path: Path) -> None:
    (tmp_path / "servo.onnx").write_bytes(SERVO)
    refuse_unfit(tmp_path / "servo.onnx")
    for left, words in ((0.5, "whatever it sees"), (float("nan"), "(?i)nan|finite")):
        (tmp_path / "x.onnx").write_bytes(constant_model(left))
        with pytest.raises(MbotError, match=words):
            refuse_unfit(tmp_path / "x.onnx")
    (tmp_path / "x.onnx").write_bytes(constant_model(input_name="camera"))
    with pytest.raises(MbotError, match="camera"):
        refuse_unfit(tmp_path / "x.onnx")


def test_worse_than_the_servo_is_not_published(tmp_path: Path) -> None:
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms

    lesson = next(one for one in TASK.lessons if one.name == "1")
    trial = Trial(lesson, preset("nominal"), evaluation_rooms([], 1)[-1:], 8, 3, 0)
    (tmp_path / "servo.onnx").write_bytes(SERVO)
    tried = try_beside_servo(tmp_path / "servo.onnx", "nominal", trial)
    assert tried.reward == tried.servo
    (tmp_path / "away.onnx").write_bytes(constant_model(-1, -1))
    with pytest.raises(MbotError, match="the colour servo"):
        try_beside_servo(tmp_path / "away.onnx", "nominal", trial)


def test_a_slip_is_told_before_anything_is_tried(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(SERVO)
    for arguments, words in (
        (("a.onnx",), "there is none"),
        (("a.onnx", "--name", "../x"), "give --name"),
        (("a.onnx", "--sign-with", "nobody"), "no key 'nobody'"),
    ):
        assert words in str(called(publish, *arguments).exception)
    KeyFolder().new("anna")
    assert "learned the task fetch" in str(called(publish, "a.onnx", "--task", "line").exception)
    assert not (tmp_path / "policies").exists()
