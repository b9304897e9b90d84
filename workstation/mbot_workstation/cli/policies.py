"""Policies handed on: publish one with its card, list and get those of others."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_workstation.cli.common_options import find_lesson, json_option, object_option, task_option
from mbot_workstation.cli.models import ask_passphrase, sign_with_option
from mbot_workstation.cli.options import (
    argument,
    check_new_file,
    option,
    output_file,
    output_folder,
    with_options,
)
from mbot_workstation.cli.presenter import Answer, table, working
from mbot_workstation.wording import one_line, size_words, typed

if TYPE_CHECKING:
    from mbot_workstation.fleet.policies.policy_card import Tried

app = typer.Typer(
    help="Policies that others have published: a folder, or a web address.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

PRESETS_TRIED = ("nominal", "randomised")
_PLACE = "A folder, or the address of one, such as https://HOST/policies."


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishOptions:
    """What `publish` takes."""

    model: Path = argument("The policy.", metavar="MODEL.onnx")
    output: Path = output_folder(
        Path("policies"), "Where policies are put, each in a folder.", "--output", "-o"
    )
    name: str = option("", "Of the policy; the file's if not given.", "--name")
    not_good_at: list[str] | None = option(
        None, "What others should not expect of it; repeatable.", "--not-good-at", metavar="WORDS"
    )
    based_on: str = option("", "What it was trained on from: a file, or words.", "--based-on")
    episodes: int = option(50, "Of it and of the colour servo, on each kind of robots.", min=10)
    seed: int = option(0, "Of rooms, robots and objects.")
    workers: int | None = option(None, "Processes; one a core if not given.", min=0)
    task: str = task_option()
    object: Path | None = object_option("What it fetches, if its file does not hold all of it.")
    sign_with: str = sign_with_option()
    as_json: bool = json_option()


@with_options
def publish(options: PublishOptions) -> Answer:
    """Put a policy into a folder with a signed card: what it is for, and how good it is.

    It is tried first, on usual and on any robots, beside the colour servo. One that no robot takes,
    that does the same whatever it sees, or that is worse than the servo in its own task, is
    refused. Put the folder behind any web server or into a git forge; nothing is sent by this.

    Example: `workstation publish policy.onnx -o policies --not-good-at "dark rooms"`
    """
    import getpass
    import re
    import time

    from mbot_workstation.fleet.models.check import check_model
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.trained_object import trained_object
    from mbot_workstation.fleet.policies.policy_card import NAME_PATTERN, PolicyCard, fingerprint
    from mbot_workstation.fleet.policies.shelf import put_on
    from mbot_workstation.tasks.find import find_task

    name = options.name or options.model.stem
    if not re.fullmatch(NAME_PATTERN, name):
        raise ConfigurationError(f"the name is {name!r}, expected a-z, 0-9, - and _: give --name")
    checked, keys = check_model(options.model), KeyFolder()
    names = [key.name for key in keys.public_keys()]
    signer = options.sign_with or (names[0] if len(names) == 1 else "")
    if not signer:
        raise ConfigurationError(
            f"which key signs? {', '.join(names) or 'there is none'}: --sign-with NAME, or make "
            "one with `workstation keys new`"
        )
    key = keys.load(signer, ask_passphrase)
    thing, task = trained_object(options.model), find_task(options.task).name
    card = PolicyCard(
        name=name,
        publisher=f"{signer} ({getpass.getuser()})",
        sha256=checked.sha256,
        size_bytes=len(checked.data),
        task=task,
        object=thing.words if thing else "red cube",
        training=_training(options.model),
        evaluation=_tried(options),
        not_good_at=tuple(options.not_good_at or ()),
        based_on=_based_on(options.based_on),
        published_unix_s=int(time.time()),
    )
    home = put_on(options.output, card, checked.data, key)
    return Answer(card, [*card.lines(), f"{home}: signed by {signer}, {fingerprint(key.public)}"])


def _tried(options: PublishOptions) -> "tuple[Tried, ...]":
    from dataclasses import replace

    from mbot_workstation.fleet.models.trained_task import trained_task
    from mbot_workstation.learn.evaluation.episodes import Trial
    from mbot_workstation.learn.evaluation.objects_tried import objects_tried
    from mbot_workstation.learn.evaluation.publishing import refuse_unfit, try_beside_servo
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms
    from mbot_workstation.sim.effects.presets import preset
    from mbot_workstation.sim.scene.scene_parameters import SceneParameters
    from mbot_workstation.tasks.find import find_task, full_reference

    learned, task = trained_task(options.model), find_task(options.task)
    if learned.task != task.name:
        raise ConfigurationError(
            f"{options.model} learned the task {learned.words}: say where it is by --task"
        )
    refuse_unfit(options.model)
    named = {str(options.model): options.model.stem}
    (thing,), _ = objects_tried(named, [options.object] if options.object else [])
    scene = replace(SceneParameters(), objects=thing.kinds)
    found: list[Tried] = []
    for name in PRESETS_TRIED:
        trial = Trial(
            find_lesson(None, options.task),
            preset(name),
            evaluation_rooms([], None),
            options.episodes,
            options.seed,
            options.workers,
            scene=scene,
            task=full_reference(options.task),
        )
        with working(f"{name} robots", options.episodes) as done:
            found.append(try_beside_servo(options.model, name, trial, done))
    return tuple(found)


def _training(model: Path) -> dict[str, Any]:
    """What the file itself tells, if that is an object of JSON."""
    import json

    from mbot_protocol.policy.onnx_file import read_onnx
    from mbot_workstation.fleet.models.check import read_bytes
    from mbot_workstation.fleet.models.model_findings import PROVENANCE

    try:
        told = json.loads(read_onnx(read_bytes(model)).properties.get(PROVENANCE, "{}"))
    except ValueError:
        return {}
    return told if isinstance(told, dict) else {}


def _based_on(words: str) -> str:
    from mbot_workstation.fleet.models.check import check_model

    if words.endswith(".onnx"):
        before = check_model(Path(words))
        return f"{before.metadata.name} {before.sha256}"
    return words


@dataclass(frozen=True, slots=True, kw_only=True)
class ListPoliciesOptions:
    """What `policies list` takes."""

    place: str = argument(_PLACE, metavar="FOLDER|URL")
    word: str = argument("Only those with it in name, task or object.", default="", metavar="WORD")
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class PolicyThere:
    """A published policy; with an error nothing else is known of it."""

    name: str
    task: str = ""
    object: str = ""
    reward: str = ""
    size_bytes: int = 0
    signed_by: str = ""
    trusted: bool = False
    error: str = ""

    def cells(self) -> tuple[str, ...]:
        """For a table."""
        signed = f"{self.signed_by}{'' if self.trusted else ' (not seen before)'}"
        words = (self.name, one_line(self.task), one_line(self.object), self.reward)
        return (*words, size_words(self.size_bytes), signed)


@app.command("list")
@with_options
def list_policies(options: ListPoliciesOptions) -> Answer:
    """List the policies of a folder or an address, by their cards.

    Example: `workstation policies list policies`
    """
    from mbot_workstation.fleet.policies.policy_card import fingerprint
    from mbot_workstation.fleet.policies.publishers import Publishers
    from mbot_workstation.fleet.policies.shelf import card_on, names_on, open_shelf

    shelf, known, found = open_shelf(options.place), Publishers(), list[PolicyThere]()
    for name in names_on(shelf):
        try:
            signed = card_on(shelf, name)
        except MbotError as error:
            found.append(PolicyThere(name, error=str(error)))
            continue
        card = signed.card
        reward = f"{card.evaluation[0].reward.mean:.2f}" if card.evaluation else "-"
        marks, trusted = fingerprint(signed.key), known.knows(signed.key)
        words = (card.name, card.task, card.object, reward)
        found.append(PolicyThere(*words, card.size_bytes, marks, trusted))
    wanted = options.word.lower()
    found = [one for one in found if wanted in f"{one.name} {one.task} {one.object}".lower()]
    rows = [one.cells() for one in found if not one.error]
    headings = ("name", "task", "object", "reward", "size", "signed by")
    shown = [table(headings, rows)] if rows else ["there are no policies"]
    return Answer(found, shown, notes=[one.error for one in found if one.error])


@dataclass(frozen=True, slots=True, kw_only=True)
class GetPolicyOptions:
    """What `policies get` takes."""

    place: str = argument(_PLACE, metavar="FOLDER|URL")
    name: str = argument("Of the policy.", metavar="NAME")
    output: Path | None = output_file(
        None, "A new file; NAME.onnx if not given.", "--output", "-o", metavar="FILE.onnx"
    )
    trust: str = option(
        "", "Its publisher's fingerprint, as you were told it.", "--trust", metavar="FINGERPRINT"
    )
    as_json: bool = json_option()


@app.command("get")
@with_options
def get_policy(options: GetPolicyOptions) -> Answer:
    """Bring a published policy here, if its signature, its digest and its contract are good.

    Whose key it is, is asked once: compare its fingerprint with what the publisher says elsewhere.

    Example: `workstation policies get policies red-cube`
    """
    from mbot_protocol.files import atomic_file
    from mbot_workstation.fleet.policies.publishers import Publishers
    from mbot_workstation.fleet.policies.shelf import card_on, model_on, open_shelf

    output = options.output or Path(f"{Path(options.name).name}.onnx")
    check_new_file(output)
    shelf = open_shelf(options.place)
    signed = card_on(shelf, options.name)
    Publishers().admit(signed, options.trust.lower(), _ask)
    model = model_on(shelf, signed.card)
    atomic_file.save(output, model.data)
    told = [*signed.card.lines(), f"{output}: next: workstation push-model {typed(output)}"]
    return Answer(signed.card, told)


def _ask(question: str) -> bool:
    import sys

    return sys.stdin.isatty() and typer.confirm(question, err=True)
