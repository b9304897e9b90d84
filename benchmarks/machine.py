"""The machine that something was measured on."""

import os
import platform
from pathlib import Path


def machine() -> str:
    """Its cores, processor and Python, in words."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.partition(": ")[2] for line in lines if "model name" in line), "unknown")
    return f"{os.cpu_count()} cores of {model}, Python {platform.python_version()}"
