"""Does to the configuration that comes with the daemon what a command has told a person to do."""

import re
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "deploy" / "config.toml"

_TOLD = re.compile(
    r"in (\[\w+\]) of /etc/mbot-agent/config\.toml change the line `(.+)` to:\n+ *(.+)\n"
)


def pasted(output: str, target: Path) -> Path:
    """Write the configuration, with the one line changed that the output names."""
    [(section, old, new)] = _TOLD.findall(output)
    before, header, rest = EXAMPLE.read_text().partition(f"\n{section}\n")
    assert header
    assert rest.splitlines().count(old) == 1
    target.write_text(before + header + rest.replace(f"\n{old}\n", f"\n{new}\n"))
    return target
