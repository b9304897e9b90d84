"""The running daemon: its parts, put together in the order in which they must start and end."""

import gc
import logging
import secrets
import threading
from contextlib import ExitStack
from typing import TYPE_CHECKING

from mbot_agent.arming import Mode
from mbot_agent.board.motors import Motors
from mbot_agent.configuration import Configuration
from mbot_agent.process import service_manager, termination
from mbot_agent.tick import Tick

if TYPE_CHECKING:
    from mbot_agent.models.model_keeper import ModelKeeper
    from mbot_agent.models.model_service import ModelService
    from mbot_agent.models.pilot import Pilot

log = logging.getLogger(__name__)

STOP_WAIT_S = 0.5
"""How long the end waits for the board to confirm that the motors stand."""


def run(configuration: Configuration) -> None:
    """Run until SIGTERM or SIGINT. `termination.block_signals` must have been called.

    Raises:
        UnreachableError: the network endpoint cannot be used.
        RefusedError: the directory of models cannot be used.

    """
    closing = threading.Event()
    with ExitStack() as parts:
        # The board comes first: whatever a crashed predecessor left it doing is stopped now.
        motors = parts.enter_context(Motors(configuration.board))
        termination.watch(lambda: _stop_for_good(motors), closing)
        _drive(configuration, motors, closing, parts)
        service_manager.notify("STOPPING=1")
    log.info("ended")


def _drive(
    configuration: Configuration, motors: Motors, closing: threading.Event, parts: ExitStack
) -> None:
    """Start everything else, and let the loop run until `closing` is set."""
    # Heavy imports wait until the board is on its way, and all but OpenCV until the camera is too.
    from mbot_agent.camera.capture import CaptureThread

    camera = parts.enter_context(CaptureThread(configuration.camera))

    from mbot_agent.command_service import CommandService
    from mbot_agent.control_loop import ControlLoop
    from mbot_agent.helm import Helm
    from mbot_agent.models.pilot import Pilot
    from mbot_agent.network.presence import Presence
    from mbot_agent.network.telemetry_publisher import Telemetry
    from mbot_agent.network.wire_messages import wire_decision
    from mbot_agent.network.zenoh_link import Link

    link = parts.enter_context(Link(configuration))
    presence = parts.enter_context(Presence(configuration.control, link.sees_workstations))
    mode = Mode.RUNNING if configuration.control.start == "running" else Mode.IDLE
    helm = Helm(motors, mode)
    session_id = secrets.randbits(63) | 1
    pilot = Pilot()
    loop = ControlLoop(configuration, camera, motors, helm, pilot, lambda: presence.fault)
    keeper, models = _supply_models(configuration, pilot, parts)
    telemetry = parts.enter_context(
        Telemetry(
            link,
            lambda tick: wire_decision(tick, configuration.robot_id, session_id, keeper.notices),
        )
    )
    commands = CommandService(
        configuration,
        session_id,
        helm,
        motors,
        camera,
        loop,
        lambda: models.active_model,
        lambda: keeper.notices,
        presence.heard,
    )
    commands.serve(link)
    link.serve("models/**", models.answers)
    link.announce()

    loop.subscribe(telemetry.offer)
    loop.subscribe(_tell_service_manager)
    loop.subscribe(lambda _: models.expire_staging())
    # What exists now stays: the collector need not look at it between two decisions again.
    gc.collect()
    gc.freeze()
    log.info("robot %s is up, %s", configuration.robot_id, mode.value)
    loop.run(closing)


def _supply_models(
    configuration: Configuration, pilot: "Pilot", parts: ExitStack
) -> "tuple[ModelKeeper, ModelService]":
    """Give the pilot the active model; from now on pushes and verdicts change it."""
    from mbot_agent.models.model_directory import ModelDirectory
    from mbot_agent.models.model_keeper import ModelKeeper
    from mbot_agent.models.model_service import ModelService
    from mbot_agent.models.sequence_floors import SequenceFloors
    from mbot_agent.models.trust import Trust

    directory = ModelDirectory(configuration.models.path, configuration.models.keep)
    floors = SequenceFloors(configuration.models.path)
    trust = Trust(configuration.trust, configuration.robot_id, floors)
    keeper = parts.enter_context(
        ModelKeeper(directory, trust, configuration.models.clean_decisions, pilot.use)
    )
    keeper.load_active()
    return keeper, ModelService(configuration, directory, keeper, trust)


def _tell_service_manager(tick: Tick) -> None:
    """Only a finished tick feeds the watchdog: a loop that hangs gets the daemon restarted."""
    if tick.sequence == 0:
        service_manager.notify("READY=1")
    service_manager.notify(f"WATCHDOG=1\nSTATUS={tick.state.value}")


def _stop_for_good(motors: Motors) -> None:
    motors.halt()
    if not motors.wait_stopped(STOP_WAIT_S):
        log.error("the board did not confirm the stop in %.1f s", STOP_WAIT_S)
