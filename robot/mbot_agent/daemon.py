"""The running daemon: its parts, put together in the order in which they must start and end."""

import gc
import logging
import secrets
import threading
from contextlib import ExitStack

from mbot_agent import service_manager, termination
from mbot_agent.camera import CaptureThread
from mbot_agent.command_service import CommandService
from mbot_agent.configuration import Configuration
from mbot_agent.helm import Helm, Mode
from mbot_agent.motors import Motors
from mbot_protocol import keys

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
        camera = parts.enter_context(CaptureThread(configuration.camera))

        # Heavy imports wait until board and camera are on their way.
        from mbot_agent.control_loop import ControlLoop, Situation
        from mbot_agent.link import Link
        from mbot_agent.model_keeper import ModelKeeper
        from mbot_agent.model_service import ModelService
        from mbot_agent.model_store import ModelStore
        from mbot_agent.presence import Presence
        from mbot_agent.sequence_floors import SequenceFloors
        from mbot_agent.telemetry import Telemetry
        from mbot_agent.trust import Trust

        store = ModelStore(configuration.models.path, configuration.models.keep)
        link = parts.enter_context(Link(configuration))
        telemetry = parts.enter_context(Telemetry(link))
        presence = parts.enter_context(Presence(configuration.control, link.sees_workstations))
        mode = Mode.RUNNING if configuration.control.start == "running" else Mode.IDLE
        helm = Helm(motors, mode)
        session_id = secrets.randbits(63) | 1
        loop = ControlLoop(
            configuration,
            session_id,
            camera,
            motors,
            helm,
            telemetry,
            lambda: presence.fault,
        )
        floors = SequenceFloors(configuration.models.path)
        trust = Trust(configuration.trust, configuration.robot_id, floors)
        keeper = parts.enter_context(
            ModelKeeper(store, trust, configuration.models.clean_decisions, loop.use, loop.tell)
        )
        keeper.load_active()
        models = ModelService(configuration, store, keeper, trust)
        commands = CommandService(
            configuration,
            session_id,
            helm,
            motors,
            loop,
            camera.check.forgive,
            lambda: models.active_model,
            presence.heard,
        )
        link.serve(keys.STOP.name, {keys.STOP.name: commands.stop})
        link.serve(keys.STATUS.name, {keys.STATUS.name: commands.status})
        link.serve(keys.COMMAND.name, {keys.COMMAND.name: commands.command})
        link.serve(
            "models/**",
            {
                keys.PUSH_NONCE.name: models.nonce,
                keys.PUSH_BEGIN.name: models.begin,
                keys.PUSH_CHUNK.name: models.chunk,
                keys.PUSH_COMMIT.name: models.commit,
                keys.MODELS.name: models.models,
                keys.ACTIVATE.name: models.activate,
            },
        )
        link.announce()

        def on_tick(situation: Situation) -> None:
            # Only a finished tick feeds the watchdog: a loop that hangs gets the daemon restarted.
            if situation.ticks == 1:
                service_manager.notify("READY=1")
            service_manager.notify(f"WATCHDOG=1\nSTATUS={situation.state.value}")
            models.expire_staging()

        # What exists now stays: the collector need not look at it between two decisions again.
        gc.collect()
        gc.freeze()
        log.info("robot %s is up, %s", configuration.robot_id, mode.value)
        loop.run(closing, on_tick)
        service_manager.notify("STOPPING=1")
    log.info("ended")


def _stop_for_good(motors: Motors) -> None:
    motors.halt()
    if not motors.wait_stopped(STOP_WAIT_S):
        log.error("the board did not confirm the stop in %.1f s", STOP_WAIT_S)
