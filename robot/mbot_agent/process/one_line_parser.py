"""A command line whose mistakes are one line, with the word that may have been meant."""

import argparse
import re
import sys
from typing import NoReturn

from mbot_protocol.did_you_mean import did_you_mean

USAGE = 2


class OneLineParser(argparse.ArgumentParser):
    """An argparse parser that prints no usage with an error, and takes no shortened options."""

    def __init__(self, *, prog: str, description: str, epilog: str) -> None:
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and end."""
        # Newer Pythons leave the quotes out.
        message = re.sub(r"\(choose from .*\)", lambda found: found[0].replace("'", ""), message)
        known = [word for action in self._actions for word in action.option_strings]
        for action in self._actions:
            known += action.choices or ()
        found = re.search(r"invalid choice: '(.*?)'|unrecognized arguments: (\S+)", message)
        word = (found[1] or found[2]).partition("=")[0] if found else ""
        meant = did_you_mean(word, known) if word else ""
        print(f"{self.prog}: {message}{meant or ';'} see `{self.prog} --help`", file=sys.stderr)
        sys.exit(USAGE)
