"""What was trained takes the place of what drives if it is nearer to the hand and no worse else."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FieldOfView, PolicyMetadata
from mbot_workstation.cli.promote import REFUSED
from mbot_workstation.cli.subcommands import app
from mbot_workstation.fleet.models.model_findings import PROVENANCE
from mbot_workstation.learn.evaluation.promotion import Compared, compare, objections
from mbot_workstation.look.collect.reviews import Place, Review, write_review

from ..robot.tiny_models import constant_model
from .hand_driven import hand_driven

HAND = (0.4, -0.2)
"""What anna's hand does in `hand_driven`."""


def by_hand(before: list[float], after: list[float]) -> Compared:
    return compare("hand", "from the hand", before, after)


def rewards(before: list[float], after: list[float]) -> Compared:
    return compare("simulation", "reward", before, after, more_is_better=True)


NEARER, AS_GOOD = by_hand([0.5, 0.6, 0.7], [0.2, 0.3, 0.3]), rewards([20, 19, 21], [21, 20, 19])


def test_nearer_to_the_hand_and_as_good_in_simulation_passes() -> None:
    assert list(objections([NEARER, AS_GOOD])) == []


@pytest.mark.parametrize(
    ("compared", "why_not"),
    [
        ([], "nobody's hand"),
        ([AS_GOOD], "nobody's hand"),
        ([NEARER], "nothing was tried in simulation"),
        ([by_hand([0.5], [0.1]), AS_GOOD], "1 drive held out"),
        ([by_hand([0.5, 0.5], [0.5, 0.5]), AS_GOOD], "not better"),
        ([by_hand([0.5, 0.5, 0.5], [0.1, 0.1, 0.9]), AS_GOOD], "not better beyond"),
        ([NEARER, AS_GOOD, rewards([20, 20], [19, 18])], "reward: worse"),
        ([NEARER, AS_GOOD, compare("pictures", "fooled", [0, 0], [1, 1])], "fooled: worse"),
    ],
)
def test_what_speaks_against_it_is_said(compared: list[Compared], why_not: str) -> None:
    (said,) = [words for words in objections(compared) if why_not in words]
    assert said


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=2, max_size=9))
def test_nobody_is_both_better_and_worse_and_to_swap_them_swaps_that(
    pairs: list[tuple[float, float]],
) -> None:
    before, after = [one for one, _ in pairs], [one for _, one in pairs]
    found, other = by_hand(before, after), by_hand(after, before)
    assert not (found.is_better and found.is_worse)
    assert (found.is_better, found.is_worse) == (other.is_worse, other.is_better)


def test_a_drive_counts_by_its_beats() -> None:
    found = compare("hand", "", [10.0, 1.0], [0.0, 1.0], weights=[10, 90])
    assert (found.before.mean, found.after.mean, found.gain.mean) == (0.11, 0.01, 0.1)


def model(
    folder: Path,
    name: str,
    wheels: tuple[float, float],
    view: float = 55.3,
    learned: tuple[str, ...] = (),
) -> Path:
    path = folder / f"{name}.onnx"
    properties = PolicyMetadata(name, FieldOfView(view, 42.9)).to_properties()
    properties[PROVENANCE] = json.dumps({"drives": learned})
    path.write_bytes(constant_model(*wheels, metadata=properties))
    return path


def judged(folder: Path, drives: int = 2) -> Path:
    for number in range(drives):
        drive = hand_driven(folder / "drives" / "mbot-1" / f"drive-{number}", seed=number + 1)
        labels: dict[str, Place | None] = {str(100 * (number + 1) + 4): Place(0.1, 0.5)}
        write_review(drive, Review("keep", "judging", labels))
    return folder / "drives"


def promoted(*arguments: object) -> tuple[int, str]:
    quick = ("--episodes", "2", "--workers", "0")
    result = CliRunner().invoke(app, ["promote", *map(str, arguments), *quick])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.output


@pytest.mark.slow
def test_only_what_passes_is_offered_to_a_robot(tmp_path: Path) -> None:
    drives, old = judged(tmp_path), model(tmp_path, "old", (0.9, 0.9))
    new = model(tmp_path, "new", HAND)
    code, said = promoted(new, "--against", old, "--drives", drives)
    assert code == 0, said
    assert f"next: workstation push-model {new}" in said
    assert "better" in said
    code, said = promoted(old, "--against", new, "--drives", drives, "--json")
    assert "push-model" not in said
    found = json.loads(said)
    assert (code, found["passed"]) == (REFUSED, False)
    assert [row["by"] for row in found["compared"]] == ["hand", "pictures", *["simulation"] * 2]
    hand = found["compared"][0]
    assert (hand["count"], hand["after"]["mean"]) == (2, 0.8)
    assert hand["before"]["mean"] == pytest.approx(0, abs=1e-3)


def test_what_cannot_be_judged_is_one_line(tmp_path: Path) -> None:
    drives, old = judged(tmp_path, 1), model(tmp_path, "old", (0.9, 0.9))
    narrow = model(tmp_path, "narrow", HAND, view=30)
    with pytest.raises(ConfigurationError, match=r"it wants to see 30 x 42\.9"):
        promoted(narrow, "--against", old, "--drives", drives)
    parrot = model(tmp_path, "parrot", HAND, learned=("drive-0",))
    with pytest.raises(ConfigurationError, match="has learned from drive-0"):
        promoted(parrot, "--against", old, "--drives", drives)
    with pytest.raises(ConfigurationError, match="is not a training run"):
        promoted(tmp_path, "--against", old, "--drives", drives)
    write_review(drives / "mbot-1" / "drive-0", Review("keep", "training"))
    with pytest.raises(ConfigurationError, match="no hand has driven in the 0 drives"):
        promoted(old, "--against", old, "--drives", drives)
