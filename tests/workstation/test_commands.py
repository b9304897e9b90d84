"""What all commands share, and the one-line answer of each to something that can't be."""

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_protocol.files.git_lfs import POINTER
from mbot_workstation.cli.calibrate import app as calibrate_app
from mbot_workstation.cli.calibrate import body, calibrate_demo, panorama
from mbot_workstation.cli.calibrate_camera import camera
from mbot_workstation.cli.common_options import (
    LinkOptions,
    calibration_option,
    json_option,
    photographs,
)
from mbot_workstation.cli.demo import demo
from mbot_workstation.cli.drives import replay
from mbot_workstation.cli.driving import drive, robots, run, stop, telemetry
from mbot_workstation.cli.enroll import enroll
from mbot_workstation.cli.evaluate import evaluate
from mbot_workstation.cli.identify import identify
from mbot_workstation.cli.maneuvers import app as maneuvers_app
from mbot_workstation.cli.models import check_model_file, models, push_model, rollback
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.stop_signals import stop_signals
from mbot_workstation.cli.subcommands import app as workstation
from mbot_workstation.cli.track import track

NOBODY = ("--robot", "127.0.0.1:1")


@dataclass(frozen=True, slots=True, kw_only=True)
class PaintOptions:
    """What `paint` takes."""

    wall: Path = argument("What to paint.")
    coats: int = option(2, "How many.", min=1)
    colour: str | None = option(None, "Which.", "--colour", "-c", metavar="NAME")
    calibration: Path | None = calibration_option()
    as_json: bool = json_option()


def call(command: Callable[..., None], *arguments: str) -> tuple[int, str]:
    """Exit code and output; an error meant for a person by its words."""
    app = typer.Typer()
    app.command(context_settings={"ignore_unknown_options": False})(command)
    result = CliRunner().invoke(app, list(arguments))
    if isinstance(result.exception, MbotError):
        return result.exception.exit_code, str(result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def test_a_policy_of_a_task_that_ships_is_tried_in_it() -> None:
    model = Path(__file__).parents[2] / "models" / "tasks" / "obstacles.onnx"
    code, said = call(check_model_file, str(model))
    assert code == 0
    assert " ".join(said.split()).endswith(f"workstation evaluate {model} --task obstacles")


def test_a_dataclass_is_a_commands_options() -> None:
    taken: list[PaintOptions] = []

    @with_options
    def paint(options: PaintOptions) -> None:
        """Paint."""
        taken.append(options)

    assert call(paint, "door", "-c", "red", "--coats", "3", "--json")[0] == 0
    assert taken == [PaintOptions(wall=Path("door"), coats=3, colour="red", as_json=True)]
    assert call(paint, "door")[0] == 0
    assert taken[1] == PaintOptions(wall=Path("door"))
    assert call(paint)[0] == 2, "an argument without a default is required"
    assert call(paint, "door", "--coats", "0")[0] == 2, "limits hold"
    code, words = call(paint, "--help")
    assert code == 0
    assert all(word in words for word in ("Paint.", "--colour", "NAME", "[default: 2]"))


def test_every_command_has_a_place_in_the_help() -> None:
    commands = [*workstation.registered_commands, *workstation.registered_groups]
    assert len(commands) > 20
    assert all(isinstance(command.rich_help_panel, str) for command in commands)


@pytest.mark.parametrize(
    ("command", "arguments", "words"),
    [
        (body, ("missing.toml",), "missing.toml"),
        (calibrate_demo, ("--seconds", "5", "--maneuver", "dance"), "dance"),
        (demo, ("--calibration", "missing"), "missing"),
        (drive, ("2", "0.5", *NOBODY), "than or equal to 1"),
        (enroll, (), "expected one of ROBOT"),
        (enroll, ("--revoke", "max", "--host", "x"), "need ROBOT"),
        (enroll, ("lab", "--router", "--person", "max"), "belong to a robot"),
        (enroll, ("mbot-1", "--right", "view"), "whom do you mean"),
        (push_model, ("missing.onnx",), "missing.onnx"),
        (rollback, ("XYZ", *NOBODY), "expected 8 to 64"),
        (telemetry, ("--record", "missing/folder/x.mcap", *NOBODY), "missing/folder"),
        (track, ("0", "--corners", "1", "1", "--board-mm", "25"), "exclude each other"),
        (track, ("0", "--corners", "0.01", "1"), "expected 0.1 to 20"),
    ],
)
def test_what_can_not_be_is_said_in_one_line(
    command: Callable[..., None],
    arguments: tuple[str, ...],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    code, said = call(command, *arguments)
    assert code != 0
    assert words in said
    assert not list(tmp_path.rglob("*.mcap"))


def test_nothing_that_is_read_may_be_a_git_lfs_pointer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files given of whatever kind, several at once, and what lies in folders given."""
    monkeypatch.chdir(tmp_path)
    for name in ("note.png", "folder/recording.toml", "folder/truth.csv", "folder/a.mcap"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_bytes(POINTER + b"v1\noid sha256:0\nsize 1\n")
    for command, arguments in (
        (check_model_file, ("note.png",)),
        (body, ("note.png",)),
        (panorama, ("note.png",)),
        (push_model, ("note.png", *NOBODY)),
        (camera, ("folder/a.mcap", "note.png")),
        (evaluate, ("servo", "--pictures", "folder")),
        (evaluate, ("servo", "--object", "note.png")),
        (identify, ("folder",)),
        (replay, ("folder",)),
    ):
        code, said = call(command, *arguments)
        assert code == 2, said
        assert "is a Git LFS pointer" in said, arguments
    written: list[object] = []

    @with_options
    def write(options: WriteOptions) -> None:
        """Write over it."""
        written.append(options.output)

    assert call(write, "--output", "note.png")[0] == 0
    assert written == [Path("note.png")]


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteOptions:
    """What `write` takes."""

    output: Path | None = output_file(None, "Where to.", "--output")


@pytest.mark.parametrize("command", [run, stop, models, robots])
def test_nobody_at_an_address_is_exit_code_4_or_1(command: Callable[..., None]) -> None:
    code, said = call(command, *NOBODY)
    assert code in (1, 4)
    assert "127.0.0.1:1" in said


def test_groups_list_their_commands() -> None:
    for app, names in (
        (calibrate_app, ("body", "camera", "light", "demo")),
        (maneuvers_app, ("run", "list")),
    ):
        said = CliRunner().invoke(app, ["--help"]).output
        assert all(name in said for name in names)


def test_photographs_of_a_calibration_come_after_those_given(tmp_path: Path) -> None:
    (tmp_path / "rooms").mkdir()
    room = tmp_path / "rooms" / "lab.jpg"
    room.touch()
    assert photographs([Path("mine.jpg")], tmp_path) == [Path("mine.jpg"), room]
    assert photographs(None, None) == []


def test_a_link_needs_all_of_a_certificate() -> None:
    with pytest.raises(ConfigurationError):
        LinkOptions(robot="tls/robot", certificate=Path("missing.pem")).link()


def test_the_first_signal_asks_and_the_second_interrupts() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with stop_signals() as asked:
        os.kill(os.getpid(), signal.SIGTERM)
        assert asked.wait(5)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_time_ends_it_too() -> None:
    with stop_signals(seconds=0.01) as asked:
        assert asked.wait(5)
