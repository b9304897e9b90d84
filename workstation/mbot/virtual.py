"""A robot that needs no hardware: the simulator and the real daemon, there for one block."""

import signal
import threading
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.keys import check_robot_id
from mbot_workstation.cli.stop_signals import sigterm_as_ctrl_c
from mbot_workstation.fleet.models.check import check_model
from mbot_workstation.virtual.with_daemon import DaemonSettings, DrivenRobot, driven_robot

SERVO = "servo"
"""The policy that needs no training: it drives at the red cube, or turns to find it."""


@contextmanager
def virtual_robot(
    name: str, task: str, policy: Path | str | None, seed: int, options: Sequence[str]
) -> Generator[tuple[DrivenRobot, Path | None]]:
    """Start both programs on free ports, and end them with the block, whatever ends it but SIGKILL.

    Args:
        name: what the robot is called.
        task: what there is to do, by its name or file.
        policy: the ONNX file that it is to have, or "servo"; None: none.
        seed: of the room and the objects.
        options: further ones of `workstation virtual-robot`.

    Returns:
        Both programs, and the file of the policy, which is yet to be pushed.

    Raises:
        MbotError: a name or file is unusable, or a program did not start.

    """
    settings = DaemonSettings(check_robot_id(name))
    with ExitStack() as stack:
        if _ends_without_a_word_on_sigterm():
            stack.enter_context(sigterm_as_ctrl_c())
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="mbot-")))
        model = _model(policy, folder)
        told = ["--task", str(task), "--seed", str(seed), *options]
        both = stack.enter_context(driven_robot(folder, settings, told))
        both.wait_until_drivable()
        yield both, model


def _ends_without_a_word_on_sigterm() -> bool:
    """Whether it would leave the programs behind; only the main thread may see to that."""
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def _model(policy: Path | str | None, folder: Path) -> Path | None:
    """The file, looked at before anything is started."""
    if policy is None:
        return None
    if policy == SERVO:
        return _servo(folder / "servo.onnx")
    path = Path(policy)
    if not path.is_file():
        raise ConfigurationError(f"no policy {path}: expected an ONNX file, or {SERVO!r}")
    check_model(path)
    return path


def _servo(path: Path) -> Path:
    from mbot_protocol.policy.policy_contract import PolicyMetadata
    from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
    from mbot_workstation.fleet.models.written_policy import write_policy

    write_policy(path, SERVO, servo_model(ServoGains(), PolicyMetadata(SERVO)))
    return path
