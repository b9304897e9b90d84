import shutil
from pathlib import Path

import pytest

from mbot_agent.models.sequence_floors import SequenceFloors
from mbot_protocol.errors import RefusedError

ANNA, BERT = bytes(32), bytes(range(32))


def test_a_floor_survives_a_restart_and_never_goes_down(tmp_path: Path) -> None:
    floors = SequenceFloors(tmp_path)
    assert floors.of(ANNA) == 0
    floors.reach(ANNA, 2**63 - 1)
    floors.reach(ANNA, 5)
    assert floors.of(ANNA) == SequenceFloors(tmp_path).of(ANNA) == 2**63 - 1


def test_a_disk_that_refuses_is_said_and_changes_nothing(tmp_path: Path) -> None:
    floors = SequenceFloors(tmp_path / "floors")
    floors.of(ANNA)
    with pytest.raises(RefusedError, match="cannot note the model's sequence"):
        floors.reach(ANNA, 5)
    assert floors.of(ANNA) == 0
    (tmp_path / "floors").mkdir()
    floors.reach(ANNA, 5)
    shutil.rmtree(tmp_path / "floors")
    floors.reach(ANNA, 5)  # noted already: the disk is not asked


def test_each_key_counts_for_itself(tmp_path: Path) -> None:
    floors = SequenceFloors(tmp_path)
    floors.reach(ANNA, 100)
    floors.reach(BERT, 7)
    again = SequenceFloors(tmp_path)
    assert (again.of(ANNA), again.of(BERT)) == (100, 7)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"a": "b"}', b"\xff\xfe"])
def test_a_damaged_file_does_not_lock_everybody_out(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "sequences.json").write_bytes(content)
    floors = SequenceFloors(tmp_path)
    assert floors.of(ANNA) == 0
    floors.reach(ANNA, 3)
    assert SequenceFloors(tmp_path).of(ANNA) == 3
