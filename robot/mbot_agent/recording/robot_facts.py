"""Which robot a recording is of."""

import platform
from pathlib import Path

from mbot_agent import installed_version
from mbot_agent.configuration import Configuration
from mbot_protocol.beat.channels import RobotFacts


def robot_facts(configuration: Configuration, session_id: int) -> RobotFacts:
    """What a replay has to know besides the beats."""
    return RobotFacts(
        robot_id=configuration.robot_id,
        session_id=session_id,
        software_version=installed_version(),
        processor=processor_name(),
        decision_rate_hz=configuration.control.decision_rate_hz,
        wheels=configuration.motors,
    )


def processor_name(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The architecture and, where Linux names it, the model: "aarch64 Cortex-A72"."""
    try:
        lines = cpuinfo.read_text().splitlines()
    except OSError:
        lines = []
    named = dict(line.split(":", 1) for line in reversed(lines) if ":" in line)
    words = {key.strip(): value.strip() for key, value in named.items()}
    model = words.get("model name") or words.get("CPU part", "")
    return f"{platform.machine()} {model}".strip()
