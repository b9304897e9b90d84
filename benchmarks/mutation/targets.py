"""Which modules are broken: all that stands between a decision, or a stranger, and the wheels."""

from pathlib import Path

ROOT = Path(__file__).parents[2]

_ROBOT, _PROTOCOL, _WORKSTATION = "robot", "shared/protocol", "workstation"
_FILES = (
    (_ROBOT, "mbot_agent", "arming faults helm control_loop intake metronome"),
    (_ROBOT, "mbot_agent/board", "motors motor_stop serial_line told_senses"),
    (_ROBOT, "mbot_agent/board/gpio", "gpio_session"),
    (_ROBOT, "mbot_agent/board/lines", "line_protocol line_session"),
    (_ROBOT, "mbot_agent/board/mcore", "mcore_session"),
    (_ROBOT, "mbot_agent/camera", "capture picture_check stuck"),
    (_ROBOT, "mbot_agent/commands", "command_service stop_service"),
    (_ROBOT, "mbot_agent/models", "activation model_keeper pilot"),
    (_ROBOT, "mbot_agent/models", "sequence_floors trial trust turn"),
    (_ROBOT, "mbot_agent/network", "doorkeeper presence pulse requests sender_numbers"),
    (_ROBOT, "mbot_agent/network", "session_guard zenoh_link"),
    (_ROBOT, "mbot_agent/process", "last_end state_file termination watchdog"),
    (_ROBOT, "mbot_agent/releases", "release_service"),
    (_ROBOT, "mbot_update", "foreign_files health_gate release_folders short_lives taking_in"),
    (_ROBOT, "mbot_update", "update_steps"),
    (_PROTOCOL, "mbot_protocol/policy", "confinement"),
    (_PROTOCOL, "mbot_protocol/wire", "access_rules connected_sockets"),
    (_WORKSTATION, "mbot_workstation/fleet/by_hand", "hand hand_drive"),
    (_WORKSTATION, "mbot_workstation/fleet/link", "remote_control"),
)
"""Side, folder, modules."""


def targets() -> dict[str, Path]:
    """Source by dotted name."""
    return {
        f"{folder.replace('/', '.')}.{name}": ROOT / side / folder / f"{name}.py"
        for side, folder, names in _FILES
        for name in names.split()
    }
