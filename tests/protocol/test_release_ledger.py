"""What a robot remembers of its releases, and which it refuses."""

from dataclasses import replace
from pathlib import Path

import pytest

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.release_ledger import (
    REMEMBERED,
    RESERVE_BYTES,
    Computer,
    Ledger,
    Outcome,
    check_release,
    read_ledger,
)
from mbot_protocol.signing.release_manifest import ReleaseFile, ReleaseManifest

FILE = ReleaseFile("a", 3, "0" * 64)
GOOD = ReleaseManifest("0.2", 7, 5, "bookworm", "arm64", "3.11", 1000, (FILE,))
PI = Computer("bookworm", "arm64", "3.11", 10**9)


def test_it_is_read_back(tmp_path: Path) -> None:
    ledger = Ledger("1", "2", 3, {"4": "why"}, "5", Outcome("6", "7", "refused", "8"))
    (tmp_path / "ledger.json").write_bytes(ledger.to_bytes())
    assert read_ledger(tmp_path / "ledger.json") == ledger
    assert read_ledger(tmp_path / "none.json") == Ledger()


@pytest.mark.parametrize("data", [b"", b"[]", b'{"golden": 1}', b'{"x": {}}', b"\xff"])
def test_a_damaged_one_decides_nothing(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "ledger.json").write_bytes(data)
    with pytest.raises(RefusedError):
        read_ledger(tmp_path / "ledger.json")


@pytest.mark.parametrize(
    ("manifest", "ledger", "computer", "words"),
    [
        (replace(GOOD, system="trixie"), Ledger(), PI, "for trixie on arm64, this robot is bookw"),
        (replace(GOOD, architecture="amd64"), Ledger(), PI, "bookworm on amd64"),
        (replace(GOOD, python="3.13"), Ledger(), PI, "Python 3.13, this robot has 3.11"),
        (GOOD, Ledger(floor=8), PI, "a downgrade: its sequence 7 is below 8"),
        (GOOD, Ledger(rejected={"0.2": "no READY"}), PI, "was rolled back on this robot before"),
        (GOOD, Ledger(), replace(PI, free_bytes=10), r"full: needs \d+ MB, has 0 MB"),
    ],
)
def test_refusals_name_the_reason(
    manifest: ReleaseManifest, ledger: Ledger, computer: Computer, words: str
) -> None:
    with pytest.raises(RefusedError, match=words):
        check_release(manifest, ledger, computer, 1000)


def test_the_floor_itself_is_allowed_and_so_is_a_disk_with_just_enough() -> None:
    check_release(GOOD, Ledger(floor=7), replace(PI, free_bytes=1000 + RESERVE_BYTES), 1000)


def test_the_floor_never_goes_down_and_rejections_are_bounded() -> None:
    ledger = Ledger(floor=9).accepted("0.3", "0.2", 4)
    assert (ledger.floor, ledger.previous, ledger.golden) == (9, "0.2", "0.3")
    assert ledger.accepted("0.4", "0.3", 10).golden == "0.3"
    for number in range(2 * REMEMBERED):
        ledger = ledger.with_rejected(str(number), "why")
    assert len(ledger.rejected) == REMEMBERED
