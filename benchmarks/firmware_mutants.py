"""Small faults put into the firmware, one at a time: a test in the simulator must fail for each.

    python benchmarks/firmware_mutants.py [--only TEXT ...] [--list]

A second pass beside `mutants.py`, over C: comparisons, and/or, constants, signs, statements that
are left out. Each mutant is compiled with avr-gcc, and the firmware's tests run with it in simavr.
One that does not compile is none. `equivalent_mutants.toml` names those that nobody could tell.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "deploy/firmware/mbot-deadman.c"
EQUIVALENT = ROOT / "benchmarks/equivalent_mutants.toml"
TESTS = tuple(
    f"tests/firmware/test_{name}.py"
    for name in ("deadman_firmware", "torn_frames", "senses_firmware")
)
WORKERS = 2
TESTS_FAILED = 1
"""pytest's exit code; any other one is a mistake of ours, and kills nothing."""

_FUNCTION = re.compile(r"^(?:static |ISR\(|int |__attribute__).*?\b(\w+)\)? ?[({].*\{$")
_SKIPPED = re.compile(r"//.*|/\*.*?\*/|\"(?:[^\"\\\\]|\\\\.)*\"|'(?:[^'\\\\]|\\\\.)'|#.*")
_FAULTS = (
    ("compare", re.compile(r"(?<![<>=!])(?:<=|>=|==|!=|<(?!<)|>(?!>))(?![<>=])")),
    ("boolean", re.compile(r"&&|\|\|")),
    ("not", re.compile(r"!(?=[\w(])")),
    ("constant", re.compile(r"\b(?:0x[0-9a-f]+|\d+|true|false)\b")),
    ("arithmetic", re.compile(r"(?<=[\w)\]] )[+-](?= )")),
    ("statement dropped", re.compile(r"(?<=[;{}] )?\b[\w.\[\]]+(?: [|&+-]?= [^;]+|\([^;]*\));")),
)
_INSTEAD = {
    **{"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="},
    **{"&&": "||", "||": "&&", "!": "", "+": "-", "-": "+", "true": "false", "false": "true"},
}


@dataclass(frozen=True, slots=True)
class FirmwareMutant:
    """One fault: a piece of the source, and what stands there instead."""

    name: str
    start: int
    end: int
    instead: str

    @property
    def source(self) -> str:
        """The whole firmware with it."""
        whole = SOURCE.read_text()
        return whole[: self.start] + self.instead + whole[self.end :]


def mutants() -> list[FirmwareMutant]:
    """All, named by function, kind and which of that kind in the function."""
    numbers: dict[tuple[str, str], int] = {}
    found: list[FirmwareMutant] = []
    for function, at, line in _code_lines(SOURCE.read_text()):
        for kind, pattern in _FAULTS:
            for place in pattern.finditer(line):
                word = place[0]
                if kind == "statement dropped" and re.match(
                    r"(if|for|while|return|uint|int)", word
                ):
                    continue
                instead = _INSTEAD.get(
                    word, ";" if kind == "statement dropped" else f"({word} + 1)"
                )
                numbers[function, kind] = number = numbers.get((function, kind), 0) + 1
                name = f"firmware:{function} {kind} {number}"
                found.append(FirmwareMutant(name, at + place.start(), at + place.end(), instead))
    return found


def _code_lines(source: str) -> Iterator[tuple[str, int, str]]:
    """Function, where the line begins, and the line, with what does nothing blanked out."""
    function, at = "", 0
    for line in source.splitlines(keepends=True):
        if begin := _FUNCTION.match(line.rstrip()):
            function = begin[1]
        elif line.startswith("}"):
            function = ""
        elif function:
            yield function, at, _SKIPPED.sub(lambda found: " " * len(found[0]), line)
        at += len(line)


def kills(mutant: FirmwareMutant) -> str:
    """What came of it: "killed", "survives", or why it is no mutant."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        elf, source = folder / "mbot-deadman.elf", folder / "mbot-deadman.c"
        source.write_text(mutant.source)
        compiler = ("avr-gcc", "-mmcu=atmega328p", "-std=c11", "-Os", "-o", str(elf), str(source))
        built = subprocess.run(compiler, capture_output=True, check=False)
        if built.returncode:
            return "does not compile"
        subprocess.run(
            ["avr-objcopy", "-O", "ihex", "-R", ".eeprom", elf, elf.with_suffix(".hex")], check=True
        )
        tests = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *TESTS],
            cwd=ROOT,
            env=os.environ | {"MBOT_FIRMWARE": str(folder)},
            capture_output=True,
            text=True,
            check=False,
            timeout=600,
        )
    if tests.returncode == 0:
        return "survives"
    return "killed" if tests.returncode == TESTS_FAILED else tests.stdout[-300:]


def main() -> int:
    parser = argparse.ArgumentParser(description="Put small faults into the firmware.")
    parser.add_argument("--only", nargs="*", default=[], metavar="TEXT", help="names with this")
    parser.add_argument("--list", action="store_true", help="name them, and end")
    arguments = parser.parse_args()
    named = {name for name in tomllib.loads(EQUIVALENT.read_text()) if name.startswith("firmware:")}
    generated = mutants()
    if gone := named - {one.name for one in generated}:
        print(f"{EQUIVALENT.name} names what is not generated: {', '.join(sorted(gone))}")
        return 1
    tried = [one for one in generated if one.name not in named]
    if arguments.only:
        tried = [one for one in tried if any(text in one.name for text in arguments.only)]
    if arguments.list:
        print("\n".join(f"{one.name}: {one.instead!r}" for one in tried))
        return 0
    began_s = time.monotonic()
    judged: list[tuple[FirmwareMutant, str]] = []
    with ThreadPoolExecutor(WORKERS) as workers:
        for one, what in zip(tried, workers.map(kills, tried), strict=True):
            judged.append((one, what))
            if what not in ("killed", "does not compile"):
                print(f"SURVIVES {one.name}: {what}", flush=True)
    alive = [one for one, what in judged if what not in ("killed", "does not compile")]
    killed = sum(what == "killed" for _, what in judged)
    print(f"{len(generated)} generated; {killed} killed in {time.monotonic() - began_s:.0f} s")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
