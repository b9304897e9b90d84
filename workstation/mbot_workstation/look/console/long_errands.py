"""What a page asks for that takes long: a model sent, a drive fetched, a drive decided again."""

import hashlib
import tempfile
import threading
from pathlib import Path
from typing import Self

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.recordings_pb2 import ListedDrive
from mbot_workstation.fleet.link.recording_fetch import fetch, list_recordings
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.check import check_model_data
from mbot_workstation.fleet.models.push import push_checked
from mbot_workstation.fleet.models.stored_models import list_models
from mbot_workstation.look.console.answer_lines import Line, Tell, progress
from mbot_workstation.look.console.errands import signing_key, stored_models
from mbot_workstation.look.drives import replay_words
from mbot_workstation.look.drives.replayed_drive import models_near, replay
from mbot_workstation.wording import one_line, short_digest

MOST_ROWS = 20


class LongErrands:
    """Carries them out in any thread; ends what it does where `tell` raises. A context manager.

    Models that were sent from the page are kept beside until it ends: the drives that they drove
    are decided again by them.
    """

    def __init__(self, link: RobotLink, here: Path, drives: Path) -> None:
        """Look for models from the folder `here` on; put what is fetched into `drives`."""
        self._link = link
        self._here = here
        self._drives = drives
        self._fetching = threading.Lock()

    def __enter__(self) -> Self:
        self._sent = tempfile.TemporaryDirectory(prefix="console-")
        return self

    def __exit__(self, *_: object) -> None:
        self._sent.cleanup()

    def push(self, name: str, data: bytes, tell: Tell) -> Line:
        """Check, sign and send a model, and have the robot make it active.

        Raises:
            MbotError: as `push_checked` and `check_model_data`; the robot keeps what it had.
            PageGoneError: the page was closed before the robot had all; it keeps what it had.

        """
        checked = check_model_data(data, one_line(name) or "the file")
        self._keep(data)

        def show(sent_bytes: int, all_bytes: int) -> None:
            words = "the robot tries the model" if sent_bytes == all_bytes else "sending"
            tell(progress(words, sent_bytes, all_bytes))

        pushed = push_checked(self._link, checked, signing_key(), show)
        active = pushed.model
        words = f"{one_line(active.name)} {short_digest(active.sha256)}"
        words += " is active" if pushed.was_sent else " was active already"
        if pushed.was_sent and not active.signed_by:
            words += ", unsigned: this robot takes models from anybody"
        words += f"; the robot finds: {pushed.advice}" if pushed.advice else ""
        tell(stored_models(list_models(self._link)))
        return {"kind": "answer", "done": True, "words": words}

    def fetch(self, name: str, tell: Tell) -> Line:
        """Bring a drive here; raises as `recording_fetch.fetch`, and PageGoneError."""
        folder = self._fetched(name, tell)
        return {"kind": "answer", "done": True, "words": f"fetched into {folder.absolute()}"}

    def replay(self, name: str, other: bytes, tell: Tell) -> Line:
        """Bring a drive here and decide it again, by `other` if there is such a model.

        Raises:
            MbotError: as `recording_fetch.fetch`, `read_drive` and `replay`.
            PageGoneError: the page was closed.

        """
        path = None
        if other:
            check_model_data(other, "the file")
            path = self._keep(other)
        drive = read_drive(self._fetched(name, tell))
        models = [*models_near(self._here), *Path(self._sent.name).glob("*.onnx")]
        found = replay(drive, models, path, lambda n, of: tell(progress("deciding again", n, of)))
        return {
            "kind": "replay",
            "done": found.is_as_expected,
            "words": "as expected" if found.is_as_expected else "NOT what was expected",
            "lines": [*drive.words, *replay_words.summary(found)],
            "rows": [replay_words.cells(row) for row in replay_words.rows(found, MOST_ROWS)],
        }

    def _keep(self, data: bytes) -> Path:
        path = Path(self._sent.name) / f"{hashlib.sha256(data).hexdigest()}.onnx"
        path.write_bytes(data)
        return path

    def _fetched(self, name: str, tell: Tell) -> Path:
        def show(here_bytes: int, all_bytes: int) -> None:
            tell(progress("fetching", here_bytes, all_bytes))

        with self._fetching:  # two pages may want the same drive
            return fetch(self._link, self._find(name), self._drives, show)

    def _find(self, name: str) -> ListedDrive:
        for drive in list_recordings(self._link).drives:
            if drive.name == name:
                return drive
        raise ConfigurationError(f"the robot keeps no recording {one_line(name)!r}; list again")
