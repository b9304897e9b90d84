"""`workstation keys`: the keys that sign models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_workstation.commands.link_options import JsonOption

if TYPE_CHECKING:
    from mbot_workstation.models.key_folder import KeyFolder

app = typer.Typer(
    help="Make and show the keys that sign models. A robot takes no others.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Of the key.")]


@app.command()
def new(
    *,
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Of the key; your user name if not given.")
    ] = "",
    passphrase: Annotated[
        bool, typer.Option("--passphrase", help="Ask for one, and again at every push.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a key, and print the line to put into a robot's configuration.

    The private half stays in a file that only you can read. Whoever has it can send models to
    every robot that trusts it.

    Examples:

    - `workstation keys new`
    - `workstation keys new lab --passphrase`
    """
    from mbot_workstation.models.key_folder import KeyFolder

    folder = KeyFolder()
    words = _ask_new_passphrase() if passphrase else ""
    key = folder.new(name or _user_name(), words)
    _print_key(key.name, key.line, folder.path / f"{key.name}.pem", as_json)


@app.command("list")
def list_keys(*, as_json: JsonOption = False) -> None:
    """List the keys on this workstation.

    Example: `workstation keys list`
    """
    import json

    from mbot_workstation.models.key_folder import KeyFolder

    folder = KeyFolder()
    keys = folder.public_keys()
    if as_json:
        rows = [
            {"name": key.name, "line": key.line, "protected": folder.is_protected(key.name)}
            for key in keys
        ]
        print(json.dumps(rows, indent=2))
        return
    if not keys:
        print(f"no keys in {folder.path}; make one with `workstation keys new`")
    for key in keys:
        protected = "  (passphrase)" if folder.is_protected(key.name) else ""
        print(f"{key.line}{protected}")


@app.command()
def show(*, name: NameArgument = "", as_json: JsonOption = False) -> None:
    """Print a key's public line, for `[trust] keys` in a robot's configuration.

    Without a name: of the only key.

    Example: `workstation keys show lab`
    """
    from mbot_workstation.models.key_folder import KeyFolder

    folder = KeyFolder()
    key = folder.public_key(name or _only_name(folder))
    if as_json:
        _print_key(key.name, key.line, folder.path / f"{key.name}.pem", as_json)
    else:
        print(key.line)


@app.command()
def trust(
    *,
    configuration: Annotated[
        Path, typer.Argument(metavar="ROBOT.toml", help="A robot's configuration on this machine.")
    ],
    name: Annotated[
        str, typer.Option("--key", metavar="NAME", help="Of the key; the only one if not given.")
    ] = "",
) -> None:
    """Add a key to `[trust] keys` in a robot's configuration file.

    The robot's daemon reads it at its next start.

    Example: `workstation keys trust robot.toml`
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.models.key_folder import KeyFolder
    from mbot_workstation.models.trusting_configuration import with_trusted_key

    folder = KeyFolder()
    key = folder.public_key(name or _only_name(folder))
    try:
        text = configuration.read_text()
        changed = with_trusted_key(text, key, str(configuration))
        if changed == text:
            print(f"{configuration} trusts {key.name} already")
            return
        configuration.write_text(changed)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"cannot change {configuration}: {error}") from None
    print(f"{configuration} now trusts {key.name}; restart mbot-agent to make it so")


def _print_key(name: str, line: str, path: Path, as_json: bool) -> None:
    import json

    if as_json:
        print(json.dumps({"name": name, "line": line, "private_key": str(path)}))
        return
    print(f"private key: {path}")
    print(f"put this line into [trust] keys of a robot's configuration, in quotes:\n\n{line}\n")


def _only_name(folder: "KeyFolder") -> str:
    from mbot_protocol.errors import ConfigurationError

    names = [key.name for key in folder.public_keys()]
    if len(names) != 1:
        found = ", ".join(names) or "none yet: `workstation keys new` makes one"
        raise ConfigurationError(f"which key? There are {len(names)}: {found}")
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
