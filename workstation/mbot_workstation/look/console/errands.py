"""What a page asks for that takes a while: run, models, recordings."""

import os
from typing import Any

from msgspec import structs

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_protocol.v1.messages_pb2 import Model
from mbot_workstation.fleet.by_hand.hand_session import MARKED
from mbot_workstation.fleet.link.recording_fetch import list_recordings
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.key_choice import ChooseKey, chooser
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.models.stored_models import StoredModel, activate, list_models
from mbot_workstation.look.console.page_messages import (
    GoBack,
    ListModels,
    ListRecordings,
    MarkWrong,
    RunRequest,
)
from mbot_workstation.wording import one_line, short_digest, size_words

PASSPHRASE_VARIABLE = "MBOT_SIGNING_PASSPHRASE"

Errand = RunRequest | MarkWrong | ListModels | GoBack | ListRecordings


class Errands:
    """Carries them out, one after another or at once; any thread."""

    def __init__(self, link: RobotLink) -> None:
        self._link = link

    def carry_out(self, errand: Errand) -> dict[str, Any]:
        """The answer for the page: what it asked for, or words that say why not."""
        try:
            if isinstance(errand, RunRequest):
                return {"kind": "answer", "words": self._run(errand.seen_stops), "done": True}
            if isinstance(errand, MarkWrong):
                RemoteControl(self._link).mark()
                return {"kind": "answer", "words": MARKED, "done": True}
            if isinstance(errand, ListModels):
                return stored_models(list_models(self._link))
            if isinstance(errand, GoBack):
                return stored_models(activate(self._link, signing_key(), errand.sha256))
            return self._recordings()
        except MbotError as error:
            return {"kind": "answer", "words": str(error), "done": False}

    def _run(self, seen_stops: int) -> str:
        control = RemoteControl(self._link)
        control.catch_up(seen_stops)
        return f"run: {control.run()}"

    def _recordings(self) -> dict[str, Any]:
        found = list_recordings(self._link)
        drives = [
            {
                "name": one_line(drive.name),
                "started_unix_time_ms": drive.started_unix_time_ns // 1_000_000,
                "lasted_s": max(
                    0, round((drive.ended_unix_time_ns - drive.started_unix_time_ns) / 1e9)
                ),
                "size": size_words(sum(file.size_bytes for file in drive.files)),
                "kept": drive.kept,
                "open": drive.open,
            }
            for drive in found.drives
        ]
        return {"kind": "recordings", "drives": drives, "free": f"{found.free_bytes / 1e9:.1f} GB"}


def signing_key() -> ChooseKey:
    """The person's own key that the robot trusts, or the one that `push-model` would take."""
    return chooser(KeyFolder(), os.environ.get("MBOT_SIGNING_KEY", ""), _passphrase)


def stored_models(found: list[Model]) -> dict[str, Any]:
    """The page's message of the models that a robot keeps."""
    return {
        "kind": "models",
        "models": [
            {
                **structs.asdict(StoredModel.of(model)),
                "name": one_line(model.name) or "-",
                "digest": short_digest(model.sha256),
                "size": size_words(model.size_bytes),
                "stored_unix_time_ms": model.stored_unix_time_ns // 1_000_000,
            }
            for model in found
        ],
    }


def _passphrase(name: str) -> str:
    """From the environment: nobody watches the terminal that a page was started from."""
    if (answer := os.environ.get(PASSPHRASE_VARIABLE)) is None:
        raise ConfigurationError(
            f"the key {name} has a passphrase: set {PASSPHRASE_VARIABLE} before `workstation "
            "console`, or use `workstation rollback`"
        )
    return answer
