"""Give a robot models: check a policy, push it, list what it keeps, go back."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mbot_protocol.errors import ConfigurationError, ContractError, InterruptedByUserError
from mbot_workstation.cli.common_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.presenter import Answer, plain, table, transfer_bar
from mbot_workstation.wording import one_line, short_digest, size_words, typed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from mbot_workstation.fleet.link.robot_link import RobotLink
    from mbot_workstation.fleet.models.check import CheckedModel
    from mbot_workstation.fleet.models.model_findings import ModelFinding
    from mbot_workstation.fleet.models.push import Pushed
    from mbot_workstation.fleet.models.stored_models import StoredModel


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckModelOptions:
    """What `check_model_file` takes."""

    model: Path = argument("The policy to look at.", metavar="MODEL.onnx")
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class Examined:
    """A policy file, and whether a robot would take it."""

    model: Path
    accepted: bool
    findings: "list[ModelFinding]"

    def said(self) -> Iterator[str]:
        """For a person."""
        for finding in self.findings:
            yield f"{finding.verdict:8} {finding.subject:8} {finding.detail}"
        if self.accepted:
            from mbot_workstation.fleet.models.trained_object import trained_object
            from mbot_workstation.fleet.models.trained_task import FETCH, trained_task
            from mbot_workstation.tasks.find import task_names

            thing, task = trained_object(self.model), trained_task(self.model)
            words, told = (
                (f"; it was trained for the {thing.words}", thing.option) if thing else ("", "")
            )
            if task.task != FETCH:
                words += f"; its task is {task.words}"
                told += f" --task {typed(task.task if task.task in task_names() else 'FILE.py')}"
            yield (
                f"{self.model}: a robot takes it{words}; next: workstation evaluate "
                f"{typed(self.model)}{told}"
            )
        else:
            failed = sum(finding.is_failure for finding in self.findings)
            yield f"{self.model}: {failed} to mend; docs/policy.md has the contract"


@with_options
def check_model_file(options: CheckModelOptions) -> Answer:
    """Say all that is wrong with a policy, and how to mend it; no robot is needed.

    Size, versions, operators, metadata, inputs and outputs, golden frames, and the robot's own dry
    run. Exit code 0 if a robot takes it, 3 if none does.

    Example: `workstation check-model policy.onnx`
    """
    from mbot_workstation.fleet.models.model_findings import examine_model

    findings = examine_model(options.model)
    accepted = not any(finding.is_failure for finding in findings)
    found = Examined(options.model, accepted, findings)
    return Answer(found, found.said(), exit_code=0 if accepted else ContractError.exit_code)


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
def push_model(options: PushModelOptions) -> Answer:
    """Check a policy, sign it, send it to a robot and make it active there.

    The robot takes models signed by a key that it trusts: see `workstation keys`. It tries the
    model before it drives with it, and keeps the one it has if anything is wrong. A new model is on
    trial for its first decisions; if it fails, the robot goes back by itself. `workstation
    rollback` does so at once. For a key with a passphrase, $MBOT_SIGNING_PASSPHRASE answers.

    Example: `workstation push-model policy.onnx --robot mbot-1`
    """
    from mbot_workstation.fleet.models.check import check_model
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.stored_models import StoredModel

    # Before the robot is looked for: most mistakes are in the file.
    checked = check_model(options.model)
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
    active = StoredModel.of(pushed.model)
    notes = [pushed.advice] if pushed.advice else []
    if pushed.was_sent and not active.signed_by:
        notes.insert(
            0,
            f"sent without a signature, which {name} takes from anybody (trust.allow_unsigned)",
        )
    words = (
        f"{name} now has {one_line(active.name or '')} {short_digest(active.sha256)} active "
        f"({size_words(active.size_bytes)}, {active.decision_rate_hz or 0:g} decisions/s)"
    )
    return Answer({"robot_id": name, **plain(active)}, [words], notes)


def ask_passphrase(name: str) -> str:
    """From the environment or the terminal; raises ConfigurationError where nobody is there."""
    import os
    import sys

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelsOptions(LinkOptions):
    """What `models` takes."""

    as_json: bool = json_option()


@with_options
def models(options: ModelsOptions) -> Answer:
    """List the models that a robot keeps.

    Example: `workstation models --robot mbot-1.local`
    """
    from mbot_workstation.fleet.models.stored_models import StoredModel, list_models

    with options.link() as link:
        found = [StoredModel.of(model) for model in list_models(link)]
    return Answer(found, _kept(found))


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
def rollback(options: RollbackOptions) -> Answer:
    """Make a model active that the robot had before: the previous one, or any it keeps.

    Signed like a push, by a key that the robot trusts.

    Example: `workstation rollback 4f1c09ab --robot mbot-1.local`
    """
    import re

    from mbot_workstation.fleet.models.key_choice import chooser
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.stored_models import StoredModel, activate

    if options.digest and not re.fullmatch(r"[0-9a-f]{8,64}", options.digest):
        raise ConfigurationError(
            f"digest is {options.digest!r}, expected 8 to 64 of 0-9, a-f, as `workstation models` "
            "lists"
        )
    if options.sign_with:
        KeyFolder().public_key(options.sign_with)
    with options.link() as link:
        choose_key = chooser(KeyFolder(), options.sign_with, ask_passphrase)
        found = [StoredModel.of(model) for model in activate(link, choose_key, options.digest)]
    return Answer(found, _kept(found))


@dataclass(frozen=True, slots=True, kw_only=True)
class UseOptions(LinkOptions):
    """What `use` takes."""

    name: str = argument("What the model is called; of several the newest.", metavar="NAME")
    sign_with: str = sign_with_option()
    as_json: bool = json_option()


@with_options
def use(options: UseOptions) -> Answer:
    """Make a model active that the robot keeps, by its name; nothing is sent.

    Signed like a push, by a key that the robot trusts. If it fails, the robot goes back by itself
    to the last one that had proven itself. It never sets the robot in motion.

    Example: `workstation use red-cube --robot mbot-1.local`
    """
    from mbot_workstation.fleet.models.key_choice import chooser
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.stored_models import (
        StoredModel,
        activate,
        list_models,
        newest_named,
    )

    if options.sign_with:
        KeyFolder().public_key(options.sign_with)
    with options.link() as link:
        found = [StoredModel.of(model) for model in list_models(link)]
        wanted = newest_named(found, options.name)
        if not wanted.active:
            choose_key = chooser(KeyFolder(), options.sign_with, ask_passphrase)
            found = [StoredModel.of(one) for one in activate(link, choose_key, wanted.sha256)]
    return Answer(found, _kept(found))


def _kept(found: "Sequence[StoredModel]") -> "list[RenderableType]":
    from datetime import datetime

    if not found:
        return ["the robot keeps no models; send one with `workstation push-model`"]
    rows = [
        (
            model.standing,
            short_digest(model.sha256),
            one_line(model.name or "-"),
            size_words(model.size_bytes),
            f"{model.decision_rate_hz:g} Hz" if model.decision_rate_hz else "-",
            f"{datetime.fromtimestamp(model.stored_unix_time_ns / 1e9):%Y-%m-%d %H:%M}",
            one_line(model.signed_by or "-"),
        )
        for model in found
    ]
    return [table(("", "digest", "name", "size", "rate", "stored", "signed by"), rows)]
