"""docs/troubleshooting.md says what the programs say, and knows every fault."""

import ast
import re
from collections.abc import Iterator

from mbot_workstation.cli.subcommands import PANELS

from .test_house import CHECKOUT, modules

PAGE = (CHECKOUT / "docs" / "troubleshooting.md").read_text()
TREES = [ast.parse(path.read_text()) for path in modules()]


def texts() -> Iterator[str]:
    for tree in TREES:
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value


def test_what_is_quoted_is_what_is_said() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| ")]
    quoted = {text for row in rows for text in re.findall(r'"([^"]+)"', row.split("|")[1])}
    assert len(quoted) > 20
    said = "\n".join(texts())
    assert [text for text in quoted if text not in said] == []


def test_every_fault_and_notice_of_a_robot_is_explained() -> None:
    kinds = {
        call.args[0].value
        for tree in TREES
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Name)
        and call.func.id in ("Fault", "Notice")
        and call.args
        and isinstance(call.args[0], ast.Constant)
    }
    assert len(kinds) > 20
    assert [kind for kind in kinds if f"`{kind}`" not in PAGE] == []


def test_every_command_that_it_names_is_one() -> None:
    names = {name for panel in PANELS.values() for name in panel}
    named = set(re.findall(r"`?workstation ([a-z-]+)", PAGE)) - {"says"}
    assert named - names == set()
