"""Puts a mutant in the place of what is running: in this process, and in those that it starts."""

import importlib
import os
import types
from pathlib import Path

from .operators import Mutant, mutated

VARIABLE = "MBOT_MUTANT"
SITE = Path(__file__).with_name("site")
"""On the path of child processes: its `sitecustomize` applies the mutant of $MBOT_MUTANT."""


class NotApplicableError(Exception):
    """The function is not there as its source has it, such as one that a decorator has replaced."""


def apply(mutant: Mutant) -> None:
    """Break the function, from now on and wherever it is already referred to.

    Raises:
        NotApplicableError: it can't be put in the place of the whole one.

    """
    code = compile(mutated(mutant), str(mutant.file), "exec")
    function = _live(mutant)
    broken = _code_of(code, mutant.function)
    if broken is None or broken.co_freevars != function.__code__.co_freevars:
        raise NotApplicableError(mutant.name)
    function.__code__ = broken
    parts = [mutant.module, mutant.function, mutant.kind, str(mutant.number), str(mutant.file)]
    os.environ[VARIABLE] = "|".join(parts)
    paths = [str(SITE), str(SITE.parents[1]), os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)


def _live(mutant: Mutant) -> types.FunctionType:
    found: object = importlib.import_module(mutant.module)
    *owners, name = mutant.function.split(".")
    for owner in owners:
        found = getattr(found, owner)
    raw = found.__dict__.get(name) if owners else getattr(found, name, None)
    if isinstance(raw, property):
        raw = raw.fget
    if isinstance(raw, staticmethod | classmethod):
        raw = raw.__func__
    raw = getattr(raw, "__wrapped__", raw)
    if not isinstance(raw, types.FunctionType):
        raise NotApplicableError(mutant.name)
    return raw


def _code_of(code: types.CodeType, qualname: str) -> types.CodeType | None:
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            if constant.co_qualname == qualname:
                return constant
            if qualname.startswith(constant.co_qualname + "."):
                found = _code_of(constant, qualname)
                if found is not None:
                    return found
    return None
