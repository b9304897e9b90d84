"""What the source promises of its own shape: rooms, sizes, a test for every module."""

import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from .ran import ran

CHECKOUT = Path(__file__).parents[1]
SOURCE = (
    "robot/mbot_agent",
    "workstation/mbot_workstation",
    "workstation/mbot",
    "shared/protocol/mbot_protocol",
    "robot/mbot_update",
)
LONGEST_FUNCTION = 60
ROOMS = sorted(path.parent for path in (CHECKOUT / SOURCE[0]).glob("*/__init__.py"))


@cache
def modules() -> tuple[Path, ...]:
    """Every source file of ours, generated ones left out."""
    found = (path for folder in SOURCE for path in sorted((CHECKOUT / folder).rglob("*.py")))
    return tuple(path for path in found if "_pb2" not in path.name)


def dotted(path: Path) -> str:
    """A module's name for `import`."""
    for folder in SOURCE:
        root = CHECKOUT / folder
        if root in path.parents:
            return ".".join((root.name, *path.relative_to(root).with_suffix("").parts))
    raise AssertionError(path)


def imports(path: Path) -> Iterator[str]:
    """What a file imports, names included: a.b.c for `from a.b import c`."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize(("folder", "most"), [(SOURCE[0], 14), (SOURCE[1], 6)])
def test_few_files_lie_loose(folder: str, most: int) -> None:
    loose = [p.name for p in (CHECKOUT / folder).glob("*.py")]
    assert len(loose) <= most, loose


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_a_room_of_the_daemon_says_what_others_may_use(room: Path) -> None:
    words = ast.get_docstring(ast.parse((room / "__init__.py").read_text())) or ""
    assert "For others: " in words


def test_no_thread_holds_up_the_end_of_its_process() -> None:
    for path in modules():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "threading.Thread":
                named = {word.arg: ast.unparse(word.value) for word in node.keywords}
                assert named.get("daemon") == "True", f"{path}:{node.lineno}"


def test_every_room_says_what_it_is_for() -> None:
    rooms = [p for p in modules() if p.name == "__init__.py"]
    silent = [str(p) for p in rooms if not ast.get_docstring(ast.parse(p.read_text()))]
    assert not silent


def test_no_function_is_too_long_to_read_at_once() -> None:
    long = [
        f"{path.relative_to(CHECKOUT)}:{node.name} {node.end_lineno - node.lineno + 1}"
        for path in modules()
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno is not None
        and node.end_lineno - node.lineno + 1 > LONGEST_FUNCTION
    ]
    assert not long


def test_every_module_is_imported_by_a_test() -> None:
    imported = {name for test in (CHECKOUT / "tests").rglob("*.py") for name in imports(test)}
    named = [dotted(p) for p in modules() if p.name not in ("__init__.py", "__main__.py")]
    assert not [name for name in named if name not in imported]


def test_one_kind_of_board_is_known_where_it_is_spoken_to() -> None:
    """By its names; words for people may say which board they mean."""
    known = ("mbot_agent.board.mcore", "mbot_agent.board.board_kinds", "mbot_protocol.drive.mcore")
    known += ("mbot_workstation.virtual", "mbot_workstation.fleet.firmware")
    tells = re.compile(r"(?i:mcore|joystick)|\bm[12]\b")
    found = [
        f"{path.relative_to(CHECKOUT)}:{token.start[0]} {token.string}"
        for path in modules()
        if not dotted(path).startswith(known)
        for token in tokenize.generate_tokens(io.StringIO(path.read_text()).readline)
        if token.type == tokenize.NAME and tells.search(token.string)
    ]
    assert not found


def test_nothing_names_this_machine() -> None:
    place = str(CHECKOUT.parent) + "/"
    found = ran("git", "grep", "-lF", place, cwd=CHECKOUT)
    # A checkout may lie right below a folder that every machine has.
    everywhere = ("/", "/home/", "/opt/", "/root/", "/srv/", "/tmp/", "/var/tmp/")
    assert found.stdout == "" or place in everywhere


@pytest.mark.parametrize("side", SOURCE)
def test_a_class_has_its_name_to_itself(side: str) -> None:
    """Within a side, so that a search finds what is meant. Private ones may be called alike."""
    named = Counter(
        node.name
        for path in modules()
        if CHECKOUT / side in path.parents
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert not {name for name, times in named.items() if times > 1}


@pytest.mark.parametrize("name", ["inertia_scale", "turning_knee_rad_s"])
def test_a_parameter_of_the_robot_is_three_files(name: str) -> None:
    """Its field, its row, its law: motion.toml, the fit, reports and training ask the table."""
    named = {path.name for path in modules() if name in path.read_text()}
    assert named == {"robot_parameters.py", "parameter_table.py", "robot_mjcf.py"}


def test_a_field_of_telemetry_is_three_files() -> None:
    """The schema, where it is known, its words: JSON, recordings and viewers ask the schema."""
    named = {path.name for path in modules() if "under_voltage" in path.read_text()}
    assert named == {"health.py", "wording.py"}
    steps = (
        (CHECKOUT / "ARCHITECTURE.md").read_text().partition("### Adding a field of telemetry")[2]
    )
    files = re.findall(
        r"`((?:robot|shared|workstation)/[\w/]+\.\w+)`", steps.partition("\n### ")[0]
    )
    assert {Path(file).name for file in files} >= named | {"messages.proto", "fields.py"}
    assert all((CHECKOUT / file).is_file() for file in files)


def test_every_file_that_the_architecture_names_is_there() -> None:
    """Its ways and its steps of adding something can be walked."""
    text = (CHECKOUT / "ARCHITECTURE.md").read_text()
    assert len(text.splitlines()) < 250
    for what in ("task", "board", "camera effect", "field of telemetry", "command"):
        assert f"### Adding a {what}\n\n1. " in text
    sides = "robot|shared|workstation|tests|benchmarks|deploy|docs"
    named = re.findall(rf"[`(]((?:{sides})/[\w/.-]+\.\w+)[`)]", text)
    assert len(named) > 50
    assert not [name for name in named if not (CHECKOUT / name).is_file()]
