"""Ctrl-C while both programs are still importing."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mbot_protocol.early_interrupt import ctrl_c_as_usual, end_at_once_on_ctrl_c

PAUSE = """
import os, signal, sys, time
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            print("importing", flush=True)
            time.sleep(30)
sys.meta_path.insert(0, Slow())
sys.argv = {words!r}
from {program} import main
main()
"""
"""The program, held up where it imports a module."""


@pytest.mark.parametrize(
    ("program", "words", "module"),
    [
        ("mbot_workstation.main", ["workstation", "evaluate", "servo"], "typer"),
        ("mbot_workstation.main", ["workstation", "robots"], "mbot_workstation.cli.driving"),
        ("mbot_workstation.main", ["workstation", "evaluate", "servo"], "mujoco"),
        ("mbot_agent.main", ["mbot-agent", "check", "--config", "x"], "argparse"),
        ("mbot_agent.main", ["mbot-agent", "check", "--config", "x"], "mbot_agent.configuration"),
    ],
)
def test_ctrl_c_during_imports_is_one_line_and_exit_code_130(
    program: str, words: list[str], module: str, tmp_path: Path
) -> None:
    script = PAUSE.format(program=program, words=words, module=module)
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=tmp_path) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "importing\n"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (130, f"{words[0]}: interrupted\n")


def test_a_background_job_goes_on_ignoring_it() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        end_at_once_on_ctrl_c("program")
        ctrl_c_as_usual()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
