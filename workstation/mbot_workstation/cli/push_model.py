"""`workstation push-model`: a model onto a robot."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mbot_workstation.cli.link_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, option, with_options

if TYPE_CHECKING:
    from mbot_workstation.fleet.link.robot_link import RobotLink
    from mbot_workstation.fleet.models.check import CheckedModel
    from mbot_workstation.fleet.models.push import Pushed


def sign_with_option() -> str:
    """Whose signature."""
    return option(
        "",
        "Key to sign with; the one that the robot trusts if not given.",
        metavar="NAME",
        envvar="MBOT_SIGNING_KEY",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PushModelOptions(LinkOptions):
    """What `push_model` takes."""

    model: Path = argument("The policy to send.", metavar="MODEL.onnx")
    sign_with: str = sign_with_option()
    allow_downgrade: bool = option(
        False,
        "Sign that the robot shall take it though this key has signed later pushes: after "
        "a workstation's clock was ahead.",
        "--allow-downgrade",
    )
    as_json: bool = json_option()


@with_options
def push_model(options: PushModelOptions) -> None:
    """Check a policy, sign it, send it to a robot and make it active there.

    The robot takes models signed by a key that it trusts: see `workstation keys`. It tries the
    model before it drives with it, and keeps the one it has if anything is wrong. A new model is on
    trial for its first decisions; if it fails, the robot goes back by itself. `workstation
    rollback` does so at once. For a key with a passphrase, $MBOT_SIGNING_PASSPHRASE answers.

    Example: `workstation push-model policy.onnx --robot mbot-1`
    """
    import json
    import sys

    from mbot_protocol.errors import InterruptedByUserError
    from mbot_workstation.fleet.models.check import check_model
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.stored_models import model_fields
    from mbot_workstation.wording import one_line, short_digest, size_words

    checked = check_model(
        options.model
    )  # before the robot is looked for: most mistakes are in the file
    if options.sign_with:  # also where nothing will need to be signed
        KeyFolder().public_key(options.sign_with)
    try:
        with options.link() as link:
            pushed = _push_with_bar(link, checked, options.sign_with, options.allow_downgrade)
            name = link.robot_id
    except KeyboardInterrupt:
        raise InterruptedByUserError(
            "interrupted; the robot keeps the model it had, unless the push was complete (see "
            "`workstation models`)"
        ) from None
    active = pushed.model
    if pushed.was_sent and not active.signed_by:
        print(
            f"workstation: note: sent without a signature, which {name} takes from anybody "
            "(trust.allow_unsigned)",
            file=sys.stderr,
        )
    if pushed.advice:
        print(f"workstation: note: {pushed.advice}", file=sys.stderr)
    if options.as_json:
        print(json.dumps({"robot_id": name, **model_fields(active)}))
    else:
        print(
            f"{name} now has {one_line(active.name)} {short_digest(active.sha256)} active "
            f"({size_words(active.size_bytes)}, {active.decision_rate_hz:g} decisions/s)"
        )


def ask_passphrase(name: str) -> str:
    """From the environment or the terminal; raises ConfigurationError where nobody is there."""
    import os
    import sys

    from mbot_protocol.errors import ConfigurationError

    if (answer := os.environ.get("MBOT_SIGNING_PASSPHRASE")) is not None:
        return answer
    if not sys.stdin.isatty():
        raise ConfigurationError(
            f"the key {name} has a passphrase and nobody is there to type it: set "
            "MBOT_SIGNING_PASSPHRASE"
        )
    return typer.prompt(f"Passphrase of the key {name}", hide_input=True, err=True)


def _push_with_bar(
    link: "RobotLink", model: "CheckedModel", sign_with: str, allow_downgrade: bool
) -> "Pushed":
    from mbot_workstation.cli.transfer_bar import transfer_bar
    from mbot_workstation.fleet.models.key_choice import chooser
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.push import push_checked

    with transfer_bar() as progress:
        task = progress.add_task(f"sending to {link.robot_id}", total=len(model.data))

        def ask(name: str) -> str:
            progress.stop()  # or it would draw over the question
            try:
                return ask_passphrase(name)
            finally:
                progress.start()

        def show(sent_bytes: int, all_bytes: int) -> None:
            progress.update(task, completed=sent_bytes)
            if sent_bytes == all_bytes:
                progress.update(task, description=f"{link.robot_id} tries the model")

        choose_key = chooser(KeyFolder(), sign_with, ask)
        return push_checked(link, model, choose_key, show, allow_downgrade=allow_downgrade)
