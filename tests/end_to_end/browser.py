"""A headless Chromium that looks at the console, as a person's browser does."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from .processes import Process, until, workstation

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)


@contextmanager
def browser() -> Iterator[Browser]:
    """The machine's own: nothing is downloaded."""
    with sync_playwright() as play:
        # There is no namespace for its sandbox where tests run as root.
        chromium = play.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield chromium
        chromium.close()


@contextmanager
def console(address: str, log: Path) -> Iterator[tuple[Process, str]]:
    """`workstation console`, and the address that it prints."""
    arguments = ("console", address, "--no-open", "--port", "0")
    with workstation(*arguments, log=log) as process:
        assert until(lambda: "http" in process.output), process.output
        found = re.search(r"http\S+", process.output)
        assert found is not None
        yield process, found[0]
