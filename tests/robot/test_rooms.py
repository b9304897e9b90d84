"""The daemon's house: few files at the root, rooms that say what they are for, no name twice."""

import ast
from collections import Counter
from pathlib import Path

import pytest

TREE = Path(__file__).parents[2]
DAEMON = TREE / "robot" / "mbot_agent"
PROTOCOL = TREE / "shared" / "protocol" / "mbot_protocol"
ROOMS = sorted(path.parent for path in DAEMON.glob("*/__init__.py"))


def test_the_root_holds_only_the_loop_and_what_starts_it() -> None:
    assert len(list(DAEMON.glob("*.py"))) <= 14


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_a_room_says_what_it_is_for_and_what_others_may_use(room: Path) -> None:
    words = ast.get_docstring(ast.parse((room / "__init__.py").read_text())) or ""
    assert "For others: " in words


def test_no_module_name_comes_twice() -> None:
    modules = [*DAEMON.rglob("*.py"), *PROTOCOL.rglob("*.py")]
    names = Counter(path.stem for path in modules if path.stem != "__init__")
    assert [name for name, times in names.items() if times > 1] == []


@pytest.mark.parametrize("tree", [DAEMON, PROTOCOL], ids=lambda tree: tree.name)
def test_no_function_is_longer_than_60_lines(tree: Path) -> None:
    found = [
        f"{path.name}: {node.name}"
        for path in tree.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and (node.end_lineno or 0) - node.lineno + 1 > 60
    ]
    assert found == []
