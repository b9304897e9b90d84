"""Small faults, made from a module's syntax tree: what a slip of the hand, or a hasty change, does.

A mutant is named by module, function, kind and which of that kind in the function, so that nothing
done elsewhere in the file gives it another name: `mbot_agent.helm:Helm.begin compare 1`.
"""

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

_COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}

LARGE = 1000
"""From here on a number is doubled, not one more."""

Function = ast.FunctionDef | ast.AsyncFunctionDef
Change = Callable[[ast.AST], ast.AST]


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault.

    Attributes:
        module: dotted.
        function: qualified name of the outermost function it is in.
        kind: of fault.
        number: which of this kind in this function, from 1.
        line: where, for people.
        file: the module's source.

    """

    module: str
    function: str
    kind: str
    number: int
    line: int
    file: Path

    @property
    def name(self) -> str:
        """Its name, which stays the same until the function itself changes."""
        return f"{self.module}:{self.function} {self.kind} {self.number}"


def mutants_of(module: str, file: Path) -> list[Mutant]:
    """All mutants of a module."""
    found: list[Mutant] = []
    for qualname, function in _functions(ast.parse(file.read_text())):
        numbers: dict[str, int] = {}
        for _, kind, line, _ in _changes(function):
            numbers[kind] = numbers.get(kind, 0) + 1
            found.append(Mutant(module, qualname, kind, numbers[kind], line, file))
    return found


def mutated(mutant: Mutant) -> ast.Module:
    """The module with the fault in it.

    Raises:
        LookupError: the function has no such place any more.

    """
    tree = ast.parse(mutant.file.read_text())
    for qualname, function in _functions(tree):
        if qualname != mutant.function:
            continue
        number = 0
        for node, kind, _, change in _changes(function):
            number += kind == mutant.kind
            if kind == mutant.kind and number == mutant.number:
                _replace(function, node, change(copy.deepcopy(node)))
                return ast.fix_missing_locations(tree)
    raise LookupError(mutant.name)


def _functions(tree: ast.Module) -> Iterator[tuple[str, Function]]:
    """Outermost functions and methods, by qualified name."""

    def within(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, Function]]:
        for node in body:
            if isinstance(node, Function):
                yield prefix + node.name, node
            elif isinstance(node, ast.ClassDef):
                yield from within(node.body, f"{prefix}{node.name}.")

    yield from within(tree.body, "")


def _changes(function: Function) -> Iterator[tuple[ast.AST, str, int, Change]]:
    """Node, kind, line and what is made of the node, in the order of the source."""
    for node in _nodes_that_act(function):
        line = getattr(node, "lineno", function.lineno)
        for kind, change in _faults_of(node):
            yield node, kind, line, change


def _nodes_that_act(node: ast.AST) -> Iterator[ast.AST]:
    """All below, but what only tells: log lines, errors' words, types, docstrings; and whether a
    thread holds up the end of the process, which a house rule watches.
    """
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.JoinedStr | ast.arguments | ast.Assert) or _only_tells(child):
            continue
        if isinstance(child, ast.keyword) and child.arg == "daemon":
            continue
        if isinstance(child, ast.expr) and child is getattr(node, "annotation", None):
            continue
        if isinstance(node, Function) and child in (*node.decorator_list, node.returns):
            continue
        yield child
        if not isinstance(child, ast.Raise):
            yield from _nodes_that_act(child)


def _only_tells(node: ast.AST) -> bool:
    if not isinstance(node, ast.Expr):
        return False
    if isinstance(node.value, ast.Constant):
        return True
    if not isinstance(node.value, ast.Call):
        return False
    called = node.value.func
    if isinstance(called, ast.Name):
        return called.id == "print"
    return isinstance(called, ast.Attribute) and ast.unparse(called.value) in ("log", "self._log")


def _faults_of(node: ast.AST) -> Iterator[tuple[str, Change]]:
    """What may be wrong at this node, each with a change to a copy of it."""
    yield from _in_what_is_computed(node)
    yield from _in_what_is_done(node)


def _in_what_is_computed(node: ast.AST) -> Iterator[tuple[str, Change]]:
    match node:
        case ast.Compare(ops=ops):
            for index in range(len(ops)):
                yield "compare", _compared(index)
        case ast.BoolOp():
            yield "boolean", _boolean
        case ast.UnaryOp(op=ast.Not()):
            yield "not", _without_not
        case ast.Constant(value=bool() | int() | float()):
            yield "constant", _constant
        case (
            ast.BinOp(op=op, left=left, right=right)
            | ast.AugAssign(op=op, target=left, value=right)
        ) if type(op) in _COMPUTED and not _is_text(left) and not _is_text(right):
            yield "arithmetic", _arithmetic
        case ast.Call(func=ast.Name("max" | "min")):
            return
        case ast.Call(args=[first, second, *_]) if ast.dump(first) != ast.dump(second):
            yield "arguments swapped", _swapped
        case _:
            return


def _in_what_is_done(node: ast.AST) -> Iterator[tuple[str, Change]]:
    match node:
        case ast.If() | ast.IfExp():
            yield "always", _condition(True)
            yield "never", _condition(False)
        case ast.While():
            yield "never", _condition(False)
        case ast.Expr(value=ast.Call()) | ast.Delete():
            yield "call dropped", _nothing
        case ast.Raise():
            yield "error dropped", _nothing
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield "assignment dropped", _nothing
        case _:
            return


def _is_text(node: ast.AST) -> bool:
    """Whether + and / join text or paths there."""
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    )


def _compared(index: int) -> Change:
    def change(copied: ast.AST) -> ast.AST:
        assert isinstance(copied, ast.Compare)
        copied.ops[index] = _COMPARED[type(copied.ops[index])]()
        return copied

    return change


def _boolean(copied: ast.AST) -> ast.AST:
    assert isinstance(copied, ast.BoolOp)
    copied.op = ast.Or() if isinstance(copied.op, ast.And) else ast.And()
    return copied


def _condition(value: bool) -> Change:
    def change(copied: ast.AST) -> ast.AST:
        assert isinstance(copied, ast.If | ast.IfExp | ast.While)
        # What it asks is still asked: a call in it may do something, and a walrus gives a name.
        asked = ast.Tuple(elts=[copied.test], ctx=ast.Load())  # which is true
        copied.test = asked if value else ast.UnaryOp(op=ast.Not(), operand=asked)
        return copied

    return change


def _constant(copied: ast.AST) -> ast.AST:
    assert isinstance(copied, ast.Constant)
    value = copied.value
    assert isinstance(value, bool | int | float)
    if isinstance(value, bool):
        copied.value = not value
    else:  # of a million nobody would notice one more
        copied.value = value + 1 if abs(value) < LARGE else 2 * value
    return copied


def _arithmetic(copied: ast.AST) -> ast.AST:
    assert isinstance(copied, ast.BinOp | ast.AugAssign)
    copied.op = _COMPUTED[type(copied.op)]()
    return copied


def _nothing(_: ast.AST) -> ast.AST:
    return ast.Pass()


def _without_not(copied: ast.AST) -> ast.AST:
    assert isinstance(copied, ast.UnaryOp)
    return copied.operand


def _swapped(copied: ast.AST) -> ast.AST:
    assert isinstance(copied, ast.Call)
    copied.args[:2] = copied.args[1::-1]
    return copied


def _replace(inside: ast.AST, old: ast.AST, new: ast.AST) -> None:
    for parent in ast.walk(inside):
        for name, value in ast.iter_fields(parent):
            if value is old:
                setattr(parent, name, new)
                return
            if isinstance(value, list):
                for index, one in enumerate(value):
                    if one is old:
                        value[index] = new
                        return
