"""`workstation console`: a page in the browser for the person beside the robot."""

from dataclasses import dataclass

from mbot_workstation.cli.link_options import LinkOptions
from mbot_workstation.cli.options import argument, option, with_options


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleOptions(LinkOptions):
    """What `console` takes."""

    named: str = argument("As --robot.", default="", metavar="[ROBOT]")
    port: int = option(
        8700,
        "Of the page, on this machine only; 0: any free one.",
        metavar="PORT",
        min=0,
        max=65535,
    )
    browser: bool = option(True, "Open the browser, or only say where.", "--open/--no-open")


@with_options
def console(options: ConsoleOptions) -> None:
    """Serve a page in the browser: live pictures, state in words, STOP, run, driving by hand.

    On this machine only, and only for who has the address that it prints. Needs the extra:
    `pip install -e '.[console]'`. Ctrl-C ends.

    Example: `workstation console mbot-1.local`
    """
    from dataclasses import replace

    from mbot_protocol.errors import ConfigurationError

    if options.named and options.robot not in ("", options.named):
        raise ConfigurationError(
            f"ROBOT is {options.named} and --robot is {options.robot}: give one of them"
        )
    try:
        from mbot_workstation.look.console.console_app import Console
        from mbot_workstation.look.console.console_server import LOOPBACK, listen, serve
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f"console needs {error.name}: pip install -c constraints.txt -e '.[console]' in the "
            "checkout"
        ) from None
    from mbot_workstation.look.console.door import Door, new_token

    token = new_token()
    wanted = replace(options, robot=options.named or options.robot)
    with listen(options.port) as listener, wanted.link() as link:
        page = f"http://{LOOPBACK}:{listener.getsockname()[1]}/{token}/"

        def ready() -> None:
            import webbrowser

            print(f"{link.robot_id}: {page}", flush=True)
            if options.browser:
                webbrowser.open(page)

        with Console(link, Door(token)) as served:
            serve(served.app, listener, ready)
