"""Mistakes of the first hour, as commands, with the line that each ends in.

`tests/test_first_hour.py` makes every mistake and holds the line; `python benchmarks/first_hour.py`
writes docs/results/first-hour.md from this table.
"""

from dataclasses import dataclass
from pathlib import Path

PRESETS = (
    "ideal, nominal, randomised, uneven, handicap, sluggish, slippery, blurry, noisy, distorted, "
    "dim, bright, late, automatic, any-room, home, light-held, lived-in, sharp"
)
FILES = {
    "typo.toml": 'robot_id = "mbot-1"\n\n[camera]\nframe_rat_hz = 15\n',
    "section.toml": 'robot_id = "mbot-1"\n\n[camra]\nframe_rate_hz = 15\n',
    "wide.toml": 'robot_id = "mbot-1"\n\n[camera]\nwidth_px = "wide"\n',
    "nameless.toml": "[camera]\nframe_rate_hz = 15\n",
    "start.toml": 'robot_id = "mbot-1"\n[control]\nstart = "runing"\n',
    "ball.toml": '[[object]]\nname = "ball"\nshape = "ball"\ncolour = "#1e9632"\n',
    "robot.toml": 'robot_id = "mbot-1"\n',
    "notes.txt": "not a model",
}
"""What somebody has written, by name."""


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes:
        what: somebody did.
        command: as typed, in a folder with FILES.
        line: all that is answered.
        code: exit code.

    """

    what: str
    command: str
    line: str
    code: int = 2


MISTAKES = (
    Mistake(
        "a subcommand misspelt",
        "workstation evaluat servo",
        "workstation: no such command 'evaluat'; did you mean evaluate? see `workstation --help`",
    ),
    Mistake(
        "an option misspelt",
        "workstation evaluate servo --episode 1",
        "workstation: no such option: --episode; did you mean --episodes? see `workstation "
        "evaluate --help`",
    ),
    Mistake(
        "a preset misspelt",
        "workstation evaluate servo --preset handicapp",
        f"workstation: --preset: no preset 'handicapp', expected one of {PRESETS}; did you mean "
        "handicap?",
    ),
    Mistake(
        "a study misspelt",
        "workstation study latncy servo",
        "workstation: no study 'latncy', expected one of handicap, blur, latency, robots, "
        "tolerance; did you mean latency?",
    ),
    Mistake(
        "a policy to study that is not there",
        "workstation study latency servo polcy.onnx",
        "workstation: no policy 'polcy.onnx': expected an ONNX file, or one of servo, random, "
        "oracle",
    ),
    Mistake(
        "the folder above a robot's calibration",
        "workstation evaluate servo --calibration .",
        "workstation: --calibration . has no body.toml, camera.toml, light.toml, motion.toml or "
        "rooms: expected one robot's folder, such as calibration/mbot-1",
    ),
    Mistake(
        "a demo into a folder with other things",
        "workstation demo --output .",
        "workstation: . holds other things, such as ball.toml; choose another --output",
    ),
    Mistake(
        "an object without its size",
        "workstation evaluate servo --object ball.toml",
        "workstation: ball.toml: object[0]: width_mm is missing for a ball, which takes width_mm "
        "(line 1)",
    ),
    Mistake(
        "an action of the daemon misspelt",
        "mbot-agent chek",
        "mbot-agent: argument action: invalid choice: 'chek' (choose from run, check, "
        "stop-motors, try, releases, rollback); did you mean check? see "
        "`mbot-agent --help`",
    ),
    Mistake(
        "an option of the daemon misspelt",
        "mbot-agent run --confg=robot.toml",
        "mbot-agent: unrecognized arguments: --confg=robot.toml; did you mean --config? see "
        "`mbot-agent --help`",
    ),
    Mistake(
        "a key misspelt",
        "mbot-agent check --config typo.toml",
        "mbot-agent: typo.toml: camera.frame_rat_hz is unknown (line 4); did you mean "
        "frame_rate_hz?",
    ),
    Mistake(
        "a section misspelt",
        "mbot-agent check --config section.toml",
        "mbot-agent: section.toml: camra is unknown (line 3); did you mean camera?",
    ),
    Mistake(
        "a text for a number",
        "mbot-agent check --config wide.toml",
        "mbot-agent: wide.toml: camera.width_px is 'wide' (line 4), expected a whole number",
    ),
    Mistake(
        "a word that is not a choice",
        "mbot-agent check --config start.toml",
        "mbot-agent: start.toml: control.start is 'runing' (line 3), expected one of idle, "
        "running; did you mean running?",
    ),
    Mistake(
        "a key left out",
        "mbot-agent check --config nameless.toml",
        "mbot-agent: nameless.toml: robot_id is missing; add it",
    ),
    Mistake(
        "a result into a folder that is not there",
        "workstation virtual-robot --result none.d/run.json",
        "workstation: --result is none.d/run.json, but there is no folder {folder}/none.d: make "
        "it first",
    ),
    Mistake(
        "a recording into a folder that is not there",
        "workstation telemetry --record none.d/drive.mcap",
        "workstation: --record is none.d/drive.mcap, but there is no folder {folder}/none.d: make "
        "it first",
    ),
    Mistake(
        "a picture of a kind nobody writes",
        "workstation evaluate servo --plot curve.gif",
        "workstation: --plot is curve.gif, expected a name that ends in .png or .svg or .pdf",
    ),
    Mistake(
        "a full disk",
        "workstation make-servo-policy /dev/full",
        "workstation: can't write /dev/full: No space left on device",
    ),
    Mistake(
        "a run's name that leads out of its folder",
        "workstation train --name ../evil",
        "workstation: --name is '../evil', expected a folder's name without a path; --runs says "
        "where",
    ),
    Mistake(
        "signing with a key that does not exist",
        "workstation rollback --sign-with nobody",
        "workstation: no key 'nobody' in config/mbot-agent/keys: `workstation keys list` shows "
        "those there are",
    ),
    Mistake(
        "trusting a key where there are two",
        "workstation keys trust robot.toml",
        "workstation: which key? There are 2: anna, bert; say which by --key NAME",
    ),
    Mistake(
        "a local enrolment without a configuration",
        "workstation enroll --here none.toml",
        "workstation: can't read none.toml: No such file or directory",
    ),
    Mistake(
        "a board that another virtual robot uses",
        "workstation virtual-robot --board board --camera-port 0",
        "workstation: board is the board of another virtual robot, which still runs: end that "
        "one, or give this one its own by --board and --camera-port",
    ),
    Mistake(
        "explaining a driver that is no file",
        "workstation explain servo",
        "workstation: can't read servo: No such file or directory; expected an ONNX model",
    ),
    Mistake(
        "something that is not a model",
        "workstation push-model notes.txt",
        "workstation: notes.txt: this is not an ONNX model; export the policy to ONNX first",
        3,
    ),
    Mistake(
        "a robot that is not there",
        "workstation stop --robot 127.0.0.1:9",
        "workstation: no connection to tcp/127.0.0.1:9: nothing listens there; is mbot-agent "
        "running there, and the SSH tunnel up?",
        4,
    ),
)


def prepare(folder: Path) -> None:
    """Put FILES into a folder."""
    for name, text in FILES.items():
        (folder / name).write_text(text)


def page(provenance: str) -> str:
    """docs/results/first-hour.md, with the line that says of which commit it is."""
    rows = "\n".join(
        f"| {one.what} | `{one.command}` | {_cell(one.line)} | {one.code} |" for one in MISTAKES
    )
    return (
        f"# Mistakes of the first hour\n\n{provenance}\n\n"
        "Each is made by [tests/test_first_hour.py](../../tests/test_first_hour.py), which holds "
        "the whole answer\nto this line; written by `python benchmarks/first_hour.py`. {folder} is "
        "where it was typed.\n\n"
        "| somebody did | by | and was told | exit code |\n|---|---|---|---|\n"
        f"{rows}\n"
    )


def _cell(line: str) -> str:
    return line.replace("|", "\\|").replace("`", "'")
