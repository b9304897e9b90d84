"""The daemon's own version."""

from importlib.metadata import PackageNotFoundError, version


def _read() -> str:
    try:
        return version("mbot-agent")
    except PackageNotFoundError:  # run from a checkout without installing
        return "0+unknown"


VERSION = _read()
