"""`workstation view`: drives in the Rerun viewer, live or recorded."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_workstation.commands.link_options import LinkOptions
from mbot_workstation.commands.options import argument, option, with_options

if TYPE_CHECKING:
    from mbot_workstation.drives.rerun_view import RerunView
    from mbot_workstation.link.robot_link import RobotLink

_POLL_S = 0.1
_PANEL = "Viewer"


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions(LinkOptions):
    """What `view` takes."""

    recordings: list[Path] = argument(
        "Recordings to look at; the robot itself, live, if not given.",
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
        None, "Write a file for the viewer instead.", "--save", panel=_PANEL, metavar="FILE.rrd"
    )
    seconds: float | None = option(
        None, "End by itself after N seconds.", "--seconds", metavar="N", min=0.1
    )


@with_options
def view(options: ViewOptions) -> None:
    """Look at a robot live, or at recorded drives, in the Rerun viewer.

    What the policy saw, wheels, actions, latencies, stops, and what changed, in words. Needs the
    extra: `pip install -e '.[view]'`. Ctrl-C ends.

    Examples: `workstation view --robot mbot-1.local`,
    `workstation view drives/mbot-1/drive-0012-20261122-171501 --web`
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.drives.rerun_view import RerunView
    from mbot_workstation.recordings.recorded_drive import read_drives

    if options.foxglove:
        if options.recordings:
            raise ConfigurationError(
                "--foxglove is for a live robot; Foxglove and Lichtblick open a recording's .mcap"
            )
        _bridge(options)
        return
    if options.recordings:
        drives = read_drives(options.recordings)
        with RerunView(list(dict.fromkeys(drive.robot_id for drive in drives))) as viewer:
            _open(viewer, options)
            for drive in drives:
                viewer.log_drive(drive)
            _stay(options)
        return
    with options.link() as link, RerunView([link.robot_id]) as viewer:
        _open(viewer, options)
        _follow(viewer, link, options.seconds)


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

    from mbot_workstation.drives.foxglove_bridge import FoxgloveBridge
    from mbot_workstation.telemetry.stream import TelemetryStream

    until_s = None if options.seconds is None else time.monotonic() + options.seconds
    with options.link() as link, FoxgloveBridge(link.robot_id, options.foxglove_port) as bridge:
        print(f"open connection in Foxglove or Lichtblick: {bridge.address}", flush=True)
        rate_hz = link.status().decision_rate_hz
        with TelemetryStream(link, rate_hz, camera=True) as stream:
            while until_s is None or time.monotonic() < until_s:
                for sample in stream.poll(_POLL_S):
                    bridge.take(sample)


def _stay(options: ViewOptions) -> None:
    """A page is served by this process: it stays until somebody ends it."""
    import time

    if options.web and options.save is None:
        until_s = None if options.seconds is None else time.monotonic() + options.seconds
        while until_s is None or time.monotonic() < until_s:
            time.sleep(_POLL_S)


def _follow(viewer: "RerunView", link: "RobotLink", seconds: float | None) -> None:
    """Log what the robot publishes."""
    import time

    from mbot_protocol.v1.messages_pb2 import Decision
    from mbot_workstation.telemetry.stream import TelemetryStream

    until_s = None if seconds is None else time.monotonic() + seconds
    with TelemetryStream(link, link.status().decision_rate_hz, camera=True) as stream:
        while until_s is None or time.monotonic() < until_s:
            for sample in stream.poll(_POLL_S):
                message = sample.message
                if isinstance(message, Decision):
                    viewer.log_decision(message)
                else:
                    time_ns = message.timestamp.ToNanoseconds()
                    viewer.log_picture(
                        link.robot_id,
                        message.data,
                        time_ns,
                        exact=False,
                        of_camera=sample.of_camera,
                    )
