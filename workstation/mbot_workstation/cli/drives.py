"""Look at drives: in a viewer, as a page, as a film, decided once more."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import CertificateOptions, json_option, robots_option
from mbot_workstation.cli.options import argument, check_new_file, option, with_options
from mbot_workstation.cli.presenter import Answer, note
from mbot_workstation.cli.stop_signals import sigterm_as_ctrl_c

if TYPE_CHECKING:
    from contextlib import ExitStack

    from mbot_protocol.beat.recorded_drive import RecordedDrive
    from mbot_workstation.fleet.link.robot_link import RobotLink
    from mbot_workstation.look.drives.attention import Looks
    from mbot_workstation.look.drives.rerun_view import RerunView

_POLL_S = 0.1
MOST_LOOKS = 60
"""Each hides 225 places of a picture in turn: 0.2 s."""

_PANEL = "Viewer"

DIFFERS = 1
"""Exit code of a replay that did not decide as it had to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions(CertificateOptions):
    """What `view` takes."""

    robot: list[str] | None = robots_option()
    robot_id: str | None = option(
        None,
        "That robot only, where several are alive behind one address.",
        "--id",
        metavar="ROBOT",
    )

    recordings: list[Path] = argument(
        "Recordings to look at; robots themselves, live, if not given.",
        default=(),
        metavar="[RECORDING...]",
    )
    web: bool = option(False, "As a page in the browser, from loopback.", "--web", panel=_PANEL)
    web_port: int = option(9090, "Of that page.", "--web-port", panel=_PANEL, metavar="PORT")
    grpc_port: int = option(9876, "Of its data.", "--grpc-port", panel=_PANEL, metavar="PORT")
    browser: bool = option(True, "Open the browser, or only say where.", "--browser/--no-browser")
    foxglove: bool = option(
        False, "Live for Foxglove or Lichtblick instead, from loopback.", "--foxglove", panel=_PANEL
    )
    foxglove_port: int = option(
        8765, "Of that; 0: any.", "--foxglove-port", panel=_PANEL, metavar="PORT", min=0, max=65535
    )
    save: Path | None = option(
        None, "Write a new file for the viewer instead.", "--save", panel=_PANEL, metavar="FILE.rrd"
    )
    maps: list[Path] | None = option(
        None,
        "Draw a map of the path that a virtual robot writes by --trajectory; ROBOT=FILE where "
        "several are looked at. Repeatable.",
        "--map",
        panel=_PANEL,
        metavar="[ROBOT=]FILE.jsonl",
    )
    attention: bool = option(
        False,
        "Of recordings: what mattered in 60 pictures of each to the policy that drove, and what "
        "it would have done there without its memory.",
        "--attention",
        panel=_PANEL,
    )
    models: list[Path] | None = option(
        None,
        "For that: policies among which those that drove are found; `*.onnx`, `models/*.onnx` and "
        "`runs/*/*.onnx` here if not given. Repeatable.",
        "--model",
        panel=_PANEL,
        metavar="MODEL.onnx",
    )
    seconds: float | None = option(
        None, "End by itself after N seconds.", "--seconds", metavar="N", min=0.1
    )

    def opened(self, stack: "ExitStack") -> "list[RobotLink]":
        """A link to each robot that answers, with a note for those that do not.

        Raises:
            ConfigurationError: an address, an identifier or a file is unusable.
            UnreachableError: none does.

        """
        from mbot_workstation.fleet.enrolment.enrolled_robots import (
            find_destination,
            find_destinations,
        )
        from mbot_workstation.fleet.link.fleet import open_links

        names, security = self.robot or [], self.security()
        if self.robot_id is not None:
            given = [find_destination(names[0] if names else "", self.robot_id, security)]
        else:
            given = find_destinations(names, security)
        links, problems = open_links(given, stack)
        for problem in problems:
            note(f"left out: {problem}")
        return links


@with_options
def view(options: ViewOptions) -> None:
    """Look at robots live, or at recorded drives, in the Rerun viewer.

    What the policy saw, wheels, actions, latencies, stops, and what changed, in words. Needs the
    extra: `pip install -e '.[view]'`. Ctrl-C ends.

    Examples: `workstation view --robot mbot-1.local`, `view --robot mbot-1 --robot mbot-2`,
    `workstation view drives/mbot-1/drive-0012-20261122-171501 --web`
    """
    from contextlib import ExitStack, closing

    from mbot_protocol.beat.recorded_drive import read_drives
    from mbot_workstation.look.drives.live_view import MapLog, follow
    from mbot_workstation.look.drives.rerun_view import RerunView

    if options.save is not None:
        check_new_file(options.save)
    if (options.attention or options.models) and not options.recordings:
        raise ConfigurationError(
            "--attention is for recordings: what a live robot's policy had in mind is in the "
            "recording on its card (`workstation recordings fetch`)"
        )
    if options.models and not options.attention:
        raise ConfigurationError("--model does nothing without --attention: give both or neither")
    if options.foxglove:
        if options.recordings:
            raise ConfigurationError(
                "--foxglove is for a live robot; Foxglove and Lichtblick open a recording's .mcap"
            )
        _bridge(options)
        return
    if options.recordings:
        drives = read_drives(options.recordings)
        robots = list(dict.fromkeys(drive.robot_id for drive in drives))
        maps = _maps(options.maps or [], robots)
        with sigterm_as_ctrl_c(), RerunView(robots, maps, attention=options.attention) as viewer:
            _open(viewer, options)
            for drive in drives:
                viewer.log_drive(drive, _looks(drive, options) if options.attention else None)
            for robot, path in maps.items():
                with closing(MapLog(viewer, robot, path)) as one:
                    one.log_all()
            _stay(options)
        return
    with sigterm_as_ctrl_c(), ExitStack() as stack:
        links = options.opened(stack)
        robots = [link.robot_id for link in links]
        maps = _maps(options.maps or [], robots)
        viewer = stack.enter_context(RerunView(robots, maps))
        _open(viewer, options)
        follow(viewer, links, maps, options.seconds)


def _looks(drive: "RecordedDrive", options: ViewOptions) -> "Looks":

    from mbot_workstation.look.drives.attention import attention
    from mbot_workstation.look.drives.drive_figures import figures
    from mbot_workstation.look.drives.replayed_drive import models_near

    chosen = figures(drive).chosen(MOST_LOOKS)
    looks, words = attention(chosen, options.models or models_near(Path()))
    for line in words:
        note(line)
    return looks


def _open(viewer: "RerunView", options: ViewOptions) -> None:
    if options.save is not None:
        viewer.save(options.save)
    elif options.web:
        import webbrowser

        page = viewer.serve_web(grpc_port=options.grpc_port, web_port=options.web_port)
        print(f"look at {page}", flush=True)
        if options.browser:
            webbrowser.open(page)
    else:
        viewer.open_window(grpc_port=options.grpc_port)


def _bridge(options: ViewOptions) -> None:
    """Hand a live robot on to Foxglove and Lichtblick."""
    import time
    from contextlib import ExitStack

    from mbot_workstation.fleet.telemetry.stream import TelemetryStream
    from mbot_workstation.look.drives.driven_path import PathFile
    from mbot_workstation.look.drives.foxglove_bridge import FoxgloveBridge
    from mbot_workstation.look.drives.foxglove_layout import layout_file

    until_s = None if options.seconds is None else time.monotonic() + options.seconds
    with ExitStack() as stack:
        links = options.opened(stack)
        if len(links) > 1:
            raise ConfigurationError(
                f"--foxglove is for one robot, and there are {len(links)}: name one by --robot"
            )
        (link,) = links
        bridge = stack.enter_context(FoxgloveBridge(link.robot_id, options.foxglove_port))
        print(f"open connection in Foxglove or Lichtblick: {bridge.address}")
        print(f"layout to import there: {layout_file(link.robot_id)}", flush=True)
        rate_hz = link.status().decision_rate_hz
        stream = stack.enter_context(TelemetryStream(link, rate_hz, camera=True))
        paths = [PathFile(path) for path in _maps(options.maps or [], [link.robot_id]).values()]
        for path in paths:
            stack.callback(path.close)
        while until_s is None or time.monotonic() < until_s:
            for sample in stream.poll(_POLL_S):
                bridge.take(sample)
            for place in (place for path in paths for place in path.read()):
                bridge.take_place(place)


def _maps(given: list[Path], robots: list[str]) -> dict[str, Path]:
    """Whose map is in which file."""

    found: dict[str, Path] = {}
    for text in map(str, given):
        robot, separator, name = text.partition("=")
        if not separator and len(robots) == 1:
            robot, name = robots[0], text
        if robot not in robots or not name:
            raise ConfigurationError(
                f"--map is {text}, expected ROBOT=FILE with one of {', '.join(robots)}"
            )
        found[robot] = Path(name)
    return found


def _stay(options: ViewOptions) -> None:
    """A page is served by this process: it stays until somebody ends it."""
    import time

    if options.web and options.save is None:
        until_s = None if options.seconds is None else time.monotonic() + options.seconds
        while until_s is None or time.monotonic() < until_s:
            time.sleep(_POLL_S)


def _recording(words: str, metavar: str) -> Any:
    return argument(
        f"{words} that `recordings fetch` or `telemetry --record` made.", metavar=metavar
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOptions:
    """What `report` takes."""

    recordings: list[Path] = _recording("Folders or files", "RECORDING...")
    output: Path = option(
        Path("drive.html"), "The page, a new file.", "--output", "-o", metavar="FILE.html"
    )
    maps: list[Path] | None = option(
        None,
        "Also draw the path that `virtual-robot --trajectory` wrote meanwhile. Repeatable.",
        "--map",
        metavar="FILE.jsonl",
    )
    models: list[Path] | None = option(
        None,
        "Policies among which those that drove are found by their digests, to show where they "
        "looked; `*.onnx`, `models/*.onnx` and `runs/*/*.onnx` here if not given. Repeatable.",
        "--model",
        metavar="MODEL.onnx",
    )
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class ReportedDrive:
    """A recorded drive in a sentence and in numbers."""

    recording: str
    sentence: str
    models: Sequence[str]
    decisions: int
    missed_beats: int
    lost_records: int
    faults: Sequence[Sequence[Any]]


@dataclass(frozen=True, slots=True)
class Report:
    """A page about drives, and what it says of each."""

    path: Path
    drives: list[ReportedDrive]


@with_options
def report(options: ReportOptions) -> Answer:
    """Write what happened in recorded drives as one page; several for comparison.

    A sentence, pictures over the whole drive and what mattered in them to the policy, wheels,
    latencies, missed beats, faults, the model's digest. The page needs no other file and no
    network, prints, and reads on a phone.

    Example: `workstation report drives/mbot-1/drive-0012-20261122-171501`
    """
    from mbot_protocol.beat.recorded_drive import read_drives
    from mbot_protocol.files import atomic_file
    from mbot_workstation.look.drives.attention import attention
    from mbot_workstation.look.drives.drive_figures import figures
    from mbot_workstation.look.drives.drive_page import STRIP_TILES, drive_page
    from mbot_workstation.look.drives.driven_path import read_path
    from mbot_workstation.look.drives.replayed_drive import models_near

    check_new_file(options.output)
    drives = [figures(drive) for drive in read_drives(options.recordings)]
    places = [place for path in options.maps or [] for place in read_path(path)]
    models = options.models or models_near(Path())
    looked = [attention(one.chosen(STRIP_TILES), models) for one in drives]
    page = drive_page(drives, places, [looks for looks, _ in looked])
    try:
        atomic_file.replace(options.output, page.encode())
    except OSError as error:
        raise ConfigurationError(f"can't write {options.output}: {error.strerror}") from None
    told = [
        ReportedDrive(
            recording=one.drive.name,
            sentence=one.sentence,
            models=one.models,
            decisions=len(one.drive.decided),
            missed_beats=one.missed_beats,
            lost_records=one.lost_records,
            faults=one.faults,
        )
        for one in drives
    ]
    said = [f"{one.recording}: {one.sentence}" for one in told]
    notes = [] if options.as_json else [line for _, words in looked for line in words]
    return Answer(Report(options.output, told), [*said, f"wrote {options.output}"], notes)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmOptions:
    """What `film` takes."""

    recording: Path = _recording("A folder or file", "RECORDING")
    output: Path = argument(
        "The film, a new file, by its name MP4 or GIF.", metavar="FILE.mp4|FILE.gif"
    )


@with_options
def film(options: FilmOptions) -> None:
    """Make a film of a recorded drive: what the policy saw, with its wheels, in real time.

    Example: `workstation film drives/mbot-1/drive-0012-20261122-171501 drive.mp4`
    """
    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.drives.drive_film import film as make_film

    check_new_file(options.output)
    lasts_s = make_film(read_drive(options.recording), options.output)
    print(f"wrote {options.output}, {lasts_s:.1f} s")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """What `replay` takes."""

    recording: Path = argument(
        "A folder that `recordings fetch` made, or one of its files.", metavar="RECORDING"
    )
    model: Path | None = option(
        None,
        "By which model; if not given, the one that drove, found by its digest among `*.onnx`, "
        "`models/*.onnx` and `runs/*/*.onnx` here.",
        "--model",
        metavar="MODEL.onnx",
    )
    strip: Path | None = option(
        None, "Also draw the decisions that differ most.", "--strip", metavar="FILE.png"
    )
    as_json: bool = json_option()


@with_options
def replay(options: ReplayOptions) -> Answer:
    """Decide a recorded drive once more, by the daemon's own code, and compare.

    The model that drove must decide the same again: to the last bit on the same kind of processor,
    to 1e-5 on another; if it does not, the exit code is 1. With --model OTHER: where would it have
    done otherwise, than the policy that drove and than a hand?

    Examples:
    `workstation replay drives/mbot-1/drive-0012-20261122-171501`,
    `workstation replay RECORDING --model other.onnx --strip other.png`

    """
    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.drives import replay_words
    from mbot_workstation.look.drives.replayed_drive import models_near
    from mbot_workstation.look.drives.replayed_drive import replay as decide_again
    from mbot_workstation.pictures.picture_file import write_picture

    drive = read_drive(options.recording)
    found = decide_again(drive, models_near(Path()), options.model)
    if not options.as_json:
        for words in drive.words:
            print(f"workstation: {words}", file=sys.stderr)
    if options.strip is not None:
        write_picture(options.strip, replay_words.strip(found))
        print(f"drawn into {options.strip}", file=sys.stderr)
    exit_code = 0 if found.is_as_expected else DIFFERS
    return Answer(replay_words.replay_answer(found), replay_words.lines(found), exit_code=exit_code)
