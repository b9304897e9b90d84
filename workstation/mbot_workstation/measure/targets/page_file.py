"""A page in a file, as PDF, SVG or PNG by its ending."""

from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.measure.targets.pdf import to_pdf
from mbot_workstation.measure.targets.png import to_png
from mbot_workstation.measure.targets.sheet import Page
from mbot_workstation.measure.targets.svg_page import to_svg

_ENCODINGS = {".pdf": to_pdf, ".svg": to_svg, ".png": to_png}


def save_page(path: Path, page: Page) -> None:
    """Write it; raises ConfigurationError for another ending, or if it can't be written."""
    encode = _ENCODINGS.get(path.suffix.lower())
    if encode is None:
        raise ConfigurationError(
            f"can't write {path}: expected a file ending in .pdf, .svg or .png"
        )
    atomic_file.save(path, encode(page))
