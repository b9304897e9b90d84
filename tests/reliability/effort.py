"""How hard the tests of reliability try: a little in every run, much by `make reliability`.

The bars of docs/results/reliability.md are judged there, on a quiet machine. What the tests
themselves hold the daemon to leaves room for a machine that is busy with something else.
"""

import os

REPEATS = int(os.environ.get("MBOT_REPEATS", "1"))
"""Of a fault, each time with a fresh daemon or board."""

FUZZ_CASES = int(os.environ.get("MBOT_FUZZ_CASES", "2000"))
"""Inputs for each parser."""

SOAK_DECISIONS = int(os.environ.get("MBOT_SOAK_DECISIONS", "600"))
