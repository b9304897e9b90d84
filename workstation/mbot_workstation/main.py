"""The command `workstation`: one subcommand a module of `commands`."""

import sys

import typer

from mbot_protocol.errors import MbotError

app = typer.Typer(
    name="workstation",
    help="Simulation, model push and live telemetry for mbot-agent robots.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line; an error meant for a person is one line and an exit code."""
    try:
        app()
    except MbotError as error:
        print(f"workstation: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
