"""Makes every page and picture about the policy that ships again: run it after a new one.

    python benchmarks/policy_pages.py [--pictures ../shared/pictures]

Goes on where it was stopped: what a command has answered for this policy is kept in
out/policy-pages, and pages that are of this policy already are left alone. About an hour on two
cores (estimated); use a quiet machine for the demos only, the rest are figures of simulation.
"""

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from PIL import Image

from mbot_workstation.learn.evaluation.provenance import digest, provenance

ROOT = Path(__file__).parents[1]
POLICY = "models/red-cube.onnx"
RESULTS = ROOT / "docs" / "results"
LESSON_PAGES = {
    RESULTS / "lesson-10.md": "lesson-10.md.jinja",
    ROOT / "docs" / "notebook" / "lesson-10.md": "lesson-10-notes.md.jinja",
}
"""Pages of figures of several commands, and their templates beside this file."""
KEPT = ROOT / "out" / "policy-pages" / digest(ROOT / POLICY)
ADAPTATION = KEPT / "adaptation.png"

JPEG_QUALITY = 88

WORKSTATION = str(Path(sys.executable).with_name("workstation"))
EVALUATE = (WORKSTATION, "evaluate", POLICY, "servo")
STUDIES = {
    "handicap": ("servo", "--episodes", "100"),
    "blur": ("servo",),
    "latency": ("servo",),
    "tolerance": ("--episodes", "16"),  # a cell
}
ANSWERS: dict[str, Sequence[str]] = {
    "many": (*EVALUATE, "--preset=randomised", "--episodes=300", "--seed=1", "--json"),
    "nominal": (*EVALUATE, "oracle", "random", "--episodes", "100", "--json"),
    "varied": (
        *(*EVALUATE, "--preset=ideal", "--preset=randomised", "--preset=any-room"),
        *("--preset=light-held", "--episodes=400", "--json"),  # it fails in 1 of 100
    ),
    "presets": (*EVALUATE, "--preset", "all", "--episodes", "48", "--json"),
    "memory": (sys.executable, "benchmarks/memory.py", POLICY, "--json"),
    "adaptation": (
        *(sys.executable, "benchmarks/adaptation.py", POLICY),
        *("--plot", str(ADAPTATION)),
    ),
    "automatics": (sys.executable, "benchmarks/automatics.py", POLICY, "servo", "--episodes=200"),
    "nothing": (sys.executable, "benchmarks/nothing_there.py", POLICY, "servo"),
}


def answer(name: str, command: Sequence[str]) -> str:
    """What a command prints, from the time before if the same was asked then."""
    kept, asked = KEPT / f"{name}.json", list(command[1:])
    before = json.loads(kept.read_text()) if kept.exists() else {}
    if before.get("asked") == asked:
        return before["printed"]
    print(f"{name}: {' '.join(asked)}", flush=True)
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps({"asked": asked, "printed": done.stdout}))
    return done.stdout


def is_of_this_policy(page: Path) -> bool:
    return page.exists() and f"`{KEPT.name}`" in page.read_text()


def studies() -> None:
    """The pages that `workstation study` writes, and their pictures."""
    for name, more in STUDIES.items():
        page = RESULTS / f"{name}.md"
        if is_of_this_policy(page):
            continue
        folder = KEPT / name
        answer(f"study-{name}", (WORKSTATION, "study", name, POLICY, *more, "-o", str(folder)))
        for picture in folder.glob("*.png"):
            shutil.copy(picture, ROOT / "docs" / "images" / picture.name)
        if name == "tolerance":
            shutil.copy(folder / "tolerance.json", ROOT / "models" / "tolerance.json")
        page.write_text((folder / page.name).read_text().replace("](", "](../images/"))


def demos() -> None:
    """Contact sheets of the real daemon on virtual robots, in real time."""
    for name, picture, more in (
        ("demo", "docs/demo.jpg", ()),
        ("weak-motor", "docs/images/weak-motor.jpg", ("--left-gain", "0.5")),
    ):
        folder = KEPT / name
        command = (WORKSTATION, "demo", "--model", POLICY, *more, "--output", str(folder))
        print(answer(f"drive-{name}", command))
        sheet = Image.open(folder / "contact-sheet.png").convert("RGB")
        sheet.save(ROOT / picture, quality=JPEG_QUALITY, optimize=True)


def interval(estimate: dict[str, float]) -> str:
    return "{mean:.2f} ({low:.2f} to {high:.2f})".format_map(estimate)


def pairs(lines: Sequence[dict[str, Any]]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Of each preset the policy's line and the servo's."""
    return [
        (one, other)
        for one in lines
        for other in lines
        if one["preset"] == other["preset"]
        and (one["contestant"], other["contestant"]) == ("red-cube", "servo")
    ]


def share(found: dict[str, Any]) -> str:
    low, high = found["interval"]
    return f"{len(found['pictures'])} of {found['of']} ({low:.0%} to {high:.0%})"


def figures(pictures: Path) -> dict[str, Any]:
    """What the templates of `LESSON_PAGES` are filled with.

    Args:
        pictures: The folder of labelled pictures.
    """
    told = {name: answer(name, command) for name, command in ANSWERS.items()}
    texts = [(name, told.pop(name)) for name in ("adaptation", "automatics", "nothing")]
    tables = {name: text.split("\n\n", 1)[1].strip() for name, text in texts}
    found = {name: json.loads(text) for name, text in told.items()}
    judged = json.loads(answer("pictures", (*EVALUATE, "--pictures", str(pictures), "--json")))
    rewards = [(a["preset"], a["reward"], b["reward"]) for a, b in pairs(found["presets"])]
    return {
        **found,
        **tables,
        "provenance": provenance([POLICY]),
        "ahead": [name for name, ours, servo in rewards if ours["mean"] > servo["mean"]],
        "beyond": [name for name, ours, servo in rewards if ours["low"] > servo["high"]],
        "behind": [
            f"{name} (by {servo['mean'] - ours['mean']:.2f})"
            for name, ours, servo in rewards
            if ours["mean"] < servo["mean"]
        ],
        "pictures": [
            {
                "contestant": one["policy"],
                "shown": len(list(pictures.glob("*.jpg"))),
                **{name: share(one[name]) for name in ("wrong_way", "not_ahead", "fooled")},
            }
            for one in judged
        ],
    }


def lesson_pages(pictures: Path) -> None:
    """Both pages about lesson 10, and the picture of `benchmarks/adaptation.py`."""
    known = figures(pictures)
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        undefined=StrictUndefined,
        trim_blocks=False,
        keep_trailing_newline=True,
        autoescape=False,
    )
    for page, template in LESSON_PAGES.items():
        page.write_text(
            templates.get_template(template).render(known, interval=interval, pairs=pairs)
        )
    shutil.copy(ADAPTATION, ROOT / "docs" / "images" / ADAPTATION.name)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pictures", type=Path, default=ROOT.parent / "shared" / "pictures")
    options = parser.parse_args()
    if not all(map(is_of_this_policy, LESSON_PAGES)):
        lesson_pages(options.pictures)
    studies()
    demos()
    print(f"all pages are of {KEPT.name}; README.md, models/README.md, docs/notebook/models.md,")
    print("docs/objects.md and docs/results/identification.md have figures of their own")


if __name__ == "__main__":
    main()
