"""What the documents promise in numbers is what the tests beside it read, and hold."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache

import pytest

from .promised import CHECKOUT, NUMBER, PAGES, PROMISE, places, promised, promises_in
from .reliability.effort import second_worst, within

NO_PROMISE = re.compile(r"`[^`]*`|\[[^]]*\]\([^)]*\)")
"""Names of settings and tests, and links."""

LINK = re.compile(r"\[([^]]*)\]\([^)]*\)")
"""Its file is where a test stands, and not what a row names."""

UNIT = re.compile(r"^promised\('[\w-]+'\) \* 10+(\.0)?$")
"""Seconds as milliseconds or nanoseconds, and no more."""

READ = re.compile(r'\bpromised\("([^"]*)"\)')


def rows(page: str) -> Iterator[tuple[str, str]]:
    """Of each row of a page's tables that name tests: what is promised, and the tests."""
    for line in (CHECKOUT / "docs" / page).read_text().splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split(" | ")]
        if not line.startswith("|") or not re.search(r"test_|make ", cells[-1]):
            continue
        # The page of results: fault, bar, measured, met, tests.
        said = cells[1] if page.startswith("results") else " | ".join(cells[:-1])
        yield NO_PROMISE.sub("", said), cells[-1]


def without_id(said: str) -> list[str]:
    """The numbers of a row that nothing can read."""
    return re.findall(NUMBER, PROMISE.sub("", said))


@cache
def readers() -> dict[str, set[str]]:
    """Of each id that is read: the names of the tests that do, and of their files."""
    found = defaultdict[str, set[str]](set)
    for file in sorted((CHECKOUT / "tests").rglob("test_*.py")):
        text = file.read_text()
        if READ.search(text) is None:
            continue
        lines = text.splitlines()
        for node in ast.parse(text).body:
            for name in READ.findall("\n".join(lines[node.lineno - 1 : node.end_lineno])):
                found[name] |= {file.name, getattr(node, "name", file.name)}
    return dict(found)


def unread(said: str, tests: str) -> list[str]:
    """The ids of a row that none of its tests reads."""
    named = set(re.findall(r"\btest_\w+(?:\.py)?", LINK.sub(r"\1", tests)))
    return [name for name, _ in promises_in(said) if not readers().get(name, set()) & named]


@pytest.mark.parametrize("page", PAGES)
def test_every_number_of_a_promise_has_an_id_which_a_test_of_its_row_reads(page: str) -> None:
    there = list(rows(page))
    assert len(there) > 10
    assert not [(said, found) for said, _ in there if (found := without_id(said))]
    assert not [(said, found) for said, tests in there if (found := unread(said, tests))]


def test_an_id_is_of_one_promise_which_says_the_same_everywhere() -> None:
    numbers = defaultdict[str, set[float]](set)
    for place in places():
        numbers[place.name].add(place.number)
    assert not {name: found for name, found in numbers.items() if len(found) > 1}


def test_an_id_stands_behind_a_number_in_a_table() -> None:
    for page in PAGES:
        text = (CHECKOUT / "docs" / page).read_text()
        in_rows = [name for said, _ in rows(page) for name, _ in promises_in(said)]
        assert re.findall(r"<!--(.*?)-->", text) == in_rows, f"an id beside its number, in {page}"


def test_what_a_test_reads_is_promised_and_what_is_promised_is_read() -> None:
    assert set(readers()) == {place.name for place in places()}
    with pytest.raises(KeyError):
        promised("-".join(("nobody", "says", "this")))


def test_a_number_is_read_with_its_unit_and_an_id_that_is_missing_is_noticed() -> None:
    said = "at most 1,000 ms<!--one-->, of 0<!--two--> frames 95 %<!--three-->; 1.5 s later"
    assert promises_in(said) == [("one", 1000), ("two", 0), ("three", 95)]
    assert without_id(said) == ["1.5"]
    assert unread("2 s<!--longest-expiry-->", "`test_nobody_else`") == ["longest-expiry"]
    assert unread("2 s<!--longest-expiry-->", "[test_command_service.py](a/test_b.py)") == []


def test_each_parser_gets_as_many_inputs_as_promised() -> None:
    cases = promised("fuzz-inputs")
    assert f"MBOT_FUZZ_CASES={cases:.0f} " in (CHECKOUT / "Makefile").read_text()


def test_one_of_many_that_is_quick_is_not_enough() -> None:
    held_up = [900.0] * 19 + [20.0]
    assert second_worst(held_up) == 900
    assert second_worst([20.0] * 19 + [900.0]) == 20, "one may be the machine's"
    assert second_worst([20.0, 900.0]) == 900, "of two nobody knows which"
    with pytest.raises(AssertionError, match="with a bar of 100"):
        within(100, iter(held_up).__next__)
    assert within(100, iter([900.0, 20.0, 20.0]).__next__) == [900, 20, 20]


def loose_reads(source: str) -> list[str]:
    """Calls of `promised` that hold nothing, or are stretched by more than a change of unit."""
    tree = ast.parse(source)
    above = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    held = {
        name.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assert) or "within(" in ast.unparse(node).partition("\n")[0]
        for name in ast.walk(node)
        if isinstance(name, ast.Name)
    }
    found: list[str] = []
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call) or ast.unparse(call.func) != "promised":
            continue
        node: ast.AST = call
        while not isinstance(node, ast.stmt):
            node = above[node]
            if isinstance(node, ast.BinOp) and not UNIT.search(ast.unparse(node)):
                found.append(ast.unparse(node))
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        bound = (
            {name.id for name in ast.walk(target) if isinstance(name, ast.Name)}
            if target
            else set()
        )
        if not (isinstance(node, ast.Assert) or "within(" in ast.unparse(node) or bound & held):
            found.append(ast.unparse(node))
    return found


def test_what_is_read_is_asserted_as_it_stands() -> None:
    for file in sorted((CHECKOUT / "tests").rglob("test_*.py")):
        text = file.read_text()
        if "promised(" in text and file.name != "test_promises.py":
            assert not loose_reads(text), file
    assert loose_reads("promised('a')") == ["promised('a')"]
    assert loose_reads("assert x < 2 * promised('a')") == ["2 * promised('a')"]
    assert loose_reads("bar = promised('a')\nassert x < bar") == []
