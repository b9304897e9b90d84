"""`workstation models` and `workstation rollback`: the models a robot keeps."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mbot_workstation.cli.link_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, with_options
from mbot_workstation.cli.push_model import ask_passphrase, sign_with_option

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mbot_protocol.v1.messages_pb2 import Model


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelsOptions(LinkOptions):
    """What `models` takes."""

    as_json: bool = json_option()


@with_options
def models(options: ModelsOptions) -> None:
    """List the models that a robot keeps.

    Example: `workstation models --robot mbot-1.local`
    """
    from mbot_workstation.fleet.models.stored_models import list_models

    with options.link() as link:
        _print_models(list_models(link), options.as_json)


@dataclass(frozen=True, slots=True, kw_only=True)
class RollbackOptions(LinkOptions):
    """What `rollback` takes."""

    digest: str = argument(
        "First 8 or more digits of the model's digest; the previous model if not given.",
        default="",
        metavar="DIGEST",
    )
    sign_with: str = sign_with_option()
    as_json: bool = json_option()


@with_options
def rollback(options: RollbackOptions) -> None:
    """Make a model active that the robot had before: the previous one, or any it keeps.

    Signed like a push, by a key that the robot trusts.

    Example: `workstation rollback 4f1c09ab --robot mbot-1.local`
    """
    import re

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.fleet.models.key_choice import chooser
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.stored_models import activate

    if options.digest and not re.fullmatch(r"[0-9a-f]{8,64}", options.digest):
        raise ConfigurationError(
            f"digest is {options.digest!r}, expected 8 to 64 of 0-9, a-f, as `workstation models` "
            "lists"
        )
    if options.sign_with:
        KeyFolder().public_key(options.sign_with)
    with options.link() as link:
        choose_key = chooser(KeyFolder(), options.sign_with, ask_passphrase)
        _print_models(activate(link, choose_key, options.digest), options.as_json)


def _standing(model: "Model") -> str:
    if model.active:
        return "active" if model.proven else "active, on trial"
    if model.rejected:
        return "rolled back"
    return "previous" if model.previous else ""


def _print_models(found: "Sequence[Model]", as_json: bool) -> None:
    import json
    from datetime import datetime

    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from mbot_workstation.fleet.models.stored_models import model_fields
    from mbot_workstation.wording import one_line, short_digest, size_words

    if as_json:
        print(json.dumps([model_fields(model) for model in found], indent=2))
        return
    if not found:
        print("the robot keeps no models; send one with `workstation push-model`")
        return
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("", "digest", "name", "size", "rate", "stored", "signed by"):
        table.add_column(heading)
    for model in found:
        stored = datetime.fromtimestamp(model.stored_unix_time_ns / 1e9)
        table.add_row(
            _standing(model),
            short_digest(model.sha256),
            escape(one_line(model.name)) or "-",
            size_words(model.size_bytes),
            f"{model.decision_rate_hz:g} Hz" if model.decision_rate_hz else "-",
            f"{stored:%Y-%m-%d %H:%M}",
            escape(one_line(model.signed_by)) or "-",
        )
    console = Console()
    console.print(table, width=None if console.is_terminal else 200)
