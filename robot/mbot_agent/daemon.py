"""The running daemon: its parts, put together in the order in which they must start and end."""

import contextlib
import gc
import logging
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_agent.arming import Mode, Orders, State
from mbot_agent.board.board_kinds import opener
from mbot_agent.board.motors import Motors
from mbot_agent.configuration import Access, Configuration, state_directory
from mbot_agent.faults import Notice
from mbot_agent.process import service_manager, termination
from mbot_agent.process.last_end import LastEnd
from mbot_agent.process.state_file import StateFile
from mbot_agent.process.watchdog import Watchdog
from mbot_agent.releases.own_release import own_release, update_goes_on
from mbot_agent.tick import Tick
from mbot_protocol.signing.release_ledger import UNDER_FIRE

if TYPE_CHECKING:
    from mbot_agent.camera.capture import CaptureThread
    from mbot_agent.commands.command_service import CommandService
    from mbot_agent.commands.stop_service import StopService
    from mbot_agent.control_loop import ControlLoop
    from mbot_agent.helm import Helm
    from mbot_agent.models.model_keeper import ModelKeeper
    from mbot_agent.models.pilot import Pilot
    from mbot_agent.network.zenoh_link import Link
    from mbot_agent.recording.recorder import Recorder
    from mbot_agent.releases.release_service import ReleaseService

log = logging.getLogger(__name__)

STOP_WAIT_S = 0.5
"""How long the end waits for the board to confirm that the motors stand."""


def run(configuration: Configuration, last_words: Callable[[], None]) -> None:
    """Run until a signal ends it. `termination.block_signals` must have been called.

    Args:
        configuration: of this robot.
        last_words: writes what the log still holds, if the process has to end at once.

    Raises:
        UnreachableError: the network endpoint cannot be used.
        RefusedError: the directory of models cannot be used.

    """
    closing = threading.Event()
    with ExitStack() as parts:
        # The board comes first: whatever a crashed predecessor left it doing is stopped now.
        motors = parts.enter_context(
            Motors(configuration.board, configuration.motors, configuration.senses)
        )
        termination.watch(lambda: _stop_for_good(motors), closing)
        termination.end_with_any_thread(lambda: _stop_for_good(motors), last_words)
        try:
            _drive(configuration, motors, closing, parts)
        except BaseException:
            _stop_for_good(motors)  # before whatever else has to be closed
            raise
        service_manager.notify("STOPPING=1")
    log.info("ended")


def rehearse(configuration: Configuration) -> str:
    """Everything but hardware and network: imports, and the active model on its golden frames.

    The updater asks this of a release before it takes the place of the one that runs.

    Returns:
        What was done, in one line.

    Raises:
        MbotError: what would not work.

    """
    from mbot_agent import control_loop
    from mbot_agent.commands import command_service, stop_service
    from mbot_agent.models import model_service
    from mbot_agent.models.model_directory import ModelDirectory
    from mbot_agent.network import zenoh_link
    from mbot_protocol.policy.golden_frames import check_deviation
    from mbot_protocol.policy.policy import Policy

    opener(configuration.board)  # a kind of board that this release does not know
    parts = (command_service, stop_service, control_loop, model_service, zenoh_link)
    words = f"{len(parts)} parts are there"
    models = configuration.models
    # Nothing is made or written here: the updater lets a release on trial read only.
    store = ModelDirectory(models.path, models.keep) if models.path.is_dir() else None
    active = store.activation.active if store else ""
    if not (store and active):
        return f"{words}, and no model"
    policy = Policy(store.read(active))
    for frame in policy.golden_frames()[:1]:
        answer = policy.decide(frame.picture, policy.blank)
        left, right = frame.action
        check_deviation(max(abs(answer.left - left), abs(answer.right - right)))
    return f"{words}; {policy.metadata.name} decides"


def _drive(
    configuration: Configuration, motors: Motors, closing: threading.Event, parts: ExitStack
) -> None:
    """Start everything else, and let the loop run until `closing` is set."""
    # Heavy imports wait until the board is on its way, and all but OpenCV until the camera is too.
    from mbot_agent.camera.capture import CaptureThread

    camera = parts.enter_context(CaptureThread(configuration.camera))

    from mbot_agent.commands.command_service import CommandService
    from mbot_agent.commands.stop_service import StopService
    from mbot_agent.control_loop import ControlLoop
    from mbot_agent.helm import Helm
    from mbot_agent.models.pilot import Pilot
    from mbot_agent.network.presence import Presence
    from mbot_agent.network.zenoh_link import Link

    models = _Models(configuration)
    last_end = parts.enter_context(LastEnd(configuration.models.path))
    link = parts.enter_context(Link(configuration))
    presence = parts.enter_context(Presence(configuration.control, link.sees_workstations))
    inbox = state_directory() / "releases"
    starts = "idle" if update_goes_on(inbox) else configuration.control.start
    helm = Helm(motors, _orders_at_start(starts, last_end))
    pilot = Pilot()
    loop = ControlLoop(configuration, camera, motors, helm, pilot, lambda: presence.fault)
    keeper = models.supply(pilot, _disarm_unless_driving(loop, helm), parts)
    session_id = secrets.randbits(63) | 1
    recorder = _recorder(configuration, session_id, link, parts)

    def notices() -> tuple[Notice, ...]:
        kept = recorder.notices if recorder is not None else ()
        return keeper.notices + motors.notices + kept

    commands = CommandService(
        configuration,
        session_id,
        helm,
        motors,
        loop,
        lambda: models.service.active_model,
        notices,
        presence.heard,
        lambda: update_goes_on(inbox),
    )
    stops = StopService(helm, motors)
    releases = _releases(configuration, inbox, helm)
    link.serve(releases.answers)
    watchdog = _serve(link, configuration.access, stops, commands, models, motors, parts)
    loop.subscribe(_telemetry(configuration, session_id, link, notices, camera, parts))
    if recorder is not None:
        loop.subscribe(recorder.offer)
    loop.subscribe(_feeder(watchdog, parts.enter_context(StateFile())))
    loop.subscribe(lambda _: models.service.expire_staging())
    # What exists now stays: the collector need not look at it between two decisions again.
    gc.collect()
    gc.freeze()
    log.info("robot %s is up, %s", configuration.robot_id, helm.orders.mode.value)
    loop.run(closing)


def _orders_at_start(start: str, last_end: LastEnd) -> Orders:
    """`control.start = "running"` is a person's word for a clean start; a crash takes it back."""
    orders = Orders(Mode.IDLE)
    if start != "running":
        return orders
    why = ""
    if last_end.was_crash:
        why = "the daemon did not end in order the last time"
    elif last_end.unmarked:
        why = f"a crash could not be told from a clean end, no mark of it: {last_end.unmarked}"
    if why:
        log.warning("not driving: %s; `workstation run` sets it in motion", why)
        return orders.stopped(time.monotonic_ns(), why=why)
    return replace(orders, mode=Mode.WAITING, given_ns=time.monotonic_ns())


def _disarm_unless_driving(loop: "ControlLoop", helm: "Helm") -> Callable[[str], None]:
    """What another model does to a robot that waits for one: nothing may begin to move by it."""

    def disarm(why: str) -> None:
        latest = loop.latest
        if latest is None or latest.state not in (State.RUNNING, State.MANUAL):
            helm.latch(why)

    return disarm


class _Models:
    """What takes models in and chooses one."""

    def __init__(self, configuration: Configuration) -> None:
        from mbot_agent.models.model_directory import ModelDirectory

        self._configuration = configuration
        self._directory = ModelDirectory(configuration.models.path, configuration.models.keep)

    def supply(
        self, pilot: "Pilot", changes: Callable[[str], None], parts: ExitStack
    ) -> "ModelKeeper":
        """Give the pilot the active model; from now on pushes and verdicts change it."""
        from mbot_agent.models.model_keeper import ModelKeeper
        from mbot_agent.models.model_service import ModelService
        from mbot_agent.models.sequence_floors import SequenceFloors
        from mbot_agent.models.trust import Trust

        settings = self._configuration
        floors = SequenceFloors(settings.models.path)
        trust = Trust(settings.trust, settings.robot_id, floors)
        proof = settings.models.clean_decisions
        keeper = parts.enter_context(ModelKeeper(self._directory, trust, proof, pilot.use, changes))
        keeper.load_active()
        self.service = ModelService(settings, self._directory, keeper, trust)
        return keeper


def _serve(
    link: "Link",
    access: Access,
    stops: "StopService",
    commands: "CommandService",
    models: _Models,
    motors: Motors,
    parts: ExitStack,
) -> Watchdog:
    """Answer from now on; what watches that this goes on."""
    from mbot_agent.commands.stop_service import PULSE
    from mbot_agent.network.pulse import Pulse
    from mbot_agent.network.session_guard import SessionGuard

    stops.serve(link)
    served = commands.serve(link)
    link.serve(models.service.answers)
    link.announce()
    guard = parts.enter_context(
        SessionGuard(access, link.visitors, lambda: link.queries, _tell_of_floods)
    )
    link.watch_visitors(guard.look_now)
    pulse = parts.enter_context(Pulse(lambda timeout_s: link.answers(PULSE, timeout_s)))
    return Watchdog(
        {
            "motors": lambda: motors.progress_ns,
            "stop": lambda: stops.progress_ns,
            "commands": lambda: min(one.progress_ns for one in served),
            "network": lambda: pulse.answered_ns,
        }
    )


def _tell_of_floods() -> None:
    """Root's updater reads it: a death by the watchdog meanwhile is no fault of the release."""
    log.warning("somebody floods the robot with messages")
    with contextlib.suppress(OSError):
        (state_directory() / UNDER_FIRE).touch()


def _releases(configuration: Configuration, inbox: Path, helm: "Helm") -> "ReleaseService":
    """What takes releases of the daemon in; root's updater installs them."""
    from mbot_agent.releases.release_service import ReleaseService

    keys, robot_id = configuration.trust.public_release_keys, configuration.robot_id
    service = ReleaseService(robot_id, keys, inbox, lambda: helm.orders.is_armed, own_release())
    service.sweep()
    return service


def _telemetry(
    configuration: Configuration,
    session_id: int,
    link: "Link",
    notices: Callable[[], tuple[Notice, ...]],
    camera: "CaptureThread",
    parts: ExitStack,
) -> Callable[[Tick], None]:
    from mbot_agent.network.telemetry_publisher import Telemetry
    from mbot_agent.network.wire_messages import beat_of

    robot_id, wheels = configuration.robot_id, configuration.motors
    telemetry = parts.enter_context(
        Telemetry(
            link,
            lambda tick: beat_of(tick, robot_id, session_id, notices(), wheels),
            configuration.telemetry,
            camera.glance,
        )
    )
    return telemetry.offer


def _recorder(
    configuration: Configuration, session_id: int, link: "Link", parts: ExitStack
) -> "Recorder | None":
    """Record drives, if wanted; and hand out in any case what there is."""
    from mbot_agent.network.wire_messages import beat_of
    from mbot_agent.recording.recorder import Recorder
    from mbot_agent.recording.recording_directory import RecordingDirectory
    from mbot_agent.recording.recording_service import RecordingService
    from mbot_agent.recording.robot_facts import robot_facts

    robot_id, settings = configuration.robot_id, configuration.recording
    wheels = configuration.motors
    directory = RecordingDirectory(configuration.recordings_path, settings)
    service = RecordingService(robot_id, directory, enabled=settings.enabled)
    link.serve(service.answers)
    if not settings.enabled:
        return None
    return parts.enter_context(
        Recorder(
            directory,
            robot_facts(configuration, session_id),
            lambda tick: beat_of(tick, robot_id, session_id, (), wheels),
        )
    )


def _feeder(watchdog: Watchdog, state_file: StateFile) -> Callable[[Tick], None]:
    """Only a finished tick feeds the watchdog: a loop that hangs gets the daemon restarted."""

    def feed(tick: Tick) -> None:
        if tick.sequence == 0:
            service_manager.notify("READY=1")
        kinds = tuple(fault.kind for fault in tick.faults)
        state_file.tell(armed=tick.orders.is_armed, faults=kinds)
        # For people; updaters up to 0.1 read it, too: what is wrong, behind a semicolon.
        faults = " ".join(kinds)
        watchdog.feed(f"{tick.state.value}; {faults}" if faults else tick.state.value)

    return feed


def _stop_for_good(motors: Motors) -> bool:
    """Stop the motors; returns whether a board has confirmed it."""
    motors.halt()
    if not motors.wait_stopped(STOP_WAIT_S):
        log.error("the board did not confirm the stop in %.1f s", STOP_WAIT_S)
        return False
    return bool(motors.version)  # without a board there is nothing that could have been waited for
