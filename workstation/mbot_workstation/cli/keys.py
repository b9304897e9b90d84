"""`workstation keys`: the keys that sign models."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.cli.common_options import json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.presenter import Answer

if TYPE_CHECKING:
    from mbot_protocol.signing.public_key import PublicKey
    from mbot_workstation.fleet.models.key_folder import KeyFolder

app = typer.Typer(
    help="Make and show the keys that sign models. A robot takes no others.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class NewKeyOptions:
    """What `new` takes."""

    name: str = argument("Of the key; your user name if not given.", default="", metavar="NAME")
    passphrase: bool = option(False, "Ask for one, and again at every push.", "--passphrase")
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A key's public line, and where its private half is."""

    name: str
    line: str
    private_key: Path


@dataclass(frozen=True, slots=True)
class KeyHere:
    """A key of this workstation; protected by a passphrase or not."""

    name: str
    line: str
    protected: bool


@app.command()
@with_options
def new(options: NewKeyOptions) -> Answer:
    """Make a key, and say how a robot learns to trust it.

    The private half stays in a file that only you can read. Whoever has it can send models to
    every robot that trusts it.

    Examples:

    - `workstation keys new`
    - `workstation keys new lab --passphrase`
    """
    from mbot_workstation.fleet.models.key_folder import KeyFolder

    folder = KeyFolder()
    words = _ask_new_passphrase() if options.passphrase else ""
    pair = _pair(folder, folder.new(options.name or _user_name(), words))
    return Answer(pair, _how_to_trust(pair))


@dataclass(frozen=True, slots=True, kw_only=True)
class ListKeysOptions:
    """What `list_keys` takes."""

    as_json: bool = json_option()


@app.command("list")
@with_options
def list_keys(options: ListKeysOptions) -> Answer:
    """List the keys on this workstation.

    Example: `workstation keys list`
    """
    from mbot_workstation.fleet.models.key_folder import KeyFolder

    folder = KeyFolder()
    keys = [
        KeyHere(key.name, key.line, folder.is_protected(key.name)) for key in folder.public_keys()
    ]
    none = f"no keys in {folder.path}; make one with `workstation keys new`"
    said = [f"{key.line}{'  (passphrase)' if key.protected else ''}" for key in keys]
    return Answer(keys, said or [none])


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowKeyOptions:
    """What `show` takes."""

    name: str = argument("Of the key.", default="", metavar="NAME")
    as_json: bool = json_option()


@app.command()
@with_options
def show(options: ShowKeyOptions) -> Answer:
    """Print a key's public line, for `[trust] keys` in a robot's configuration.

    Without a name: of the only key.

    Example: `workstation keys show lab`
    """
    from mbot_workstation.fleet.models.key_folder import KeyFolder

    folder = KeyFolder()
    key = folder.public_key(options.name or _only_name(folder, "its NAME behind `keys show`"))
    return Answer(_pair(folder, key), [key.line])


@dataclass(frozen=True, slots=True, kw_only=True)
class TrustKeyOptions:
    """What `trust` takes."""

    configuration: Path = argument("A robot's configuration on this machine.", metavar="ROBOT.toml")
    name: str = option("", "Of the key; the only one if not given.", "--key", metavar="NAME")


@app.command()
@with_options
def trust(options: TrustKeyOptions) -> None:
    """Add a key to `[trust] keys` in a robot's configuration file.

    The robot's daemon reads it at its next start.

    Example: `workstation keys trust robot.toml`
    """
    from mbot_protocol.files.text_file import read_text
    from mbot_workstation.fleet.models.key_folder import KeyFolder
    from mbot_workstation.fleet.models.trusting_configuration import with_trusted_key

    folder = KeyFolder()
    key = folder.public_key(options.name or _only_name(folder, "--key NAME"))
    text = read_text(options.configuration)
    try:
        changed = with_trusted_key(text, key, str(options.configuration))
        if changed == text:
            print(f"{options.configuration} trusts {key.name} already")
            return
        atomic_file.save(options.configuration, changed.encode())
    except OSError as error:
        raise ConfigurationError(
            f"can't change {options.configuration}: {error.strerror}"
        ) from None
    print(f"{options.configuration} now trusts {key.name}; restart mbot-agent to make it so")


def _pair(folder: "KeyFolder", key: "PublicKey") -> KeyPair:
    return KeyPair(key.name, key.line, folder.path / f"{key.name}.pem")


def _how_to_trust(pair: KeyPair) -> Iterator[str]:
    from mbot_workstation.fleet.models.trusting_configuration import by_hand

    where, to_paste = by_hand([pair.line])
    yield f"private key: {pair.private_key}"
    yield "`workstation enroll ROBOT` sends the public half along. Or by hand, on the robot,"
    yield f"{where}\n\n{to_paste}\n"


def _only_name(folder: "KeyFolder", by: str) -> str:

    names = [key.name for key in folder.public_keys()]
    if len(names) != 1:
        if not names:
            raise ConfigurationError("there is no key yet: `workstation keys new` makes one")
        raise ConfigurationError(
            f"which key? There are {len(names)}: {', '.join(names)}; say which by {by}"
        )
    return names[0]


def _user_name() -> str:
    """The user's name as a key's name."""
    import getpass
    import re

    try:
        return re.sub(r"[^A-Za-z0-9_.@-]", "", getpass.getuser()) or "key"
    except (OSError, KeyError):
        return "key"


def _ask_new_passphrase() -> str:
    return typer.prompt("Passphrase", hide_input=True, confirmation_prompt=True, err=True)
