"""Which task a policy learned, and by which drives, in its file."""

from pathlib import Path

import msgspec

from mbot_protocol.policy.onnx_file import read_onnx
from mbot_workstation.fleet.models.check import read_bytes
from mbot_workstation.fleet.models.model_findings import PROVENANCE
from mbot_workstation.wording import one_line

FETCH = "fetch"
"""What policies of before there were tasks learned, and those of others: they say nothing."""


class TrainedTask(msgspec.Struct, frozen=True):
    """A task, by its name and the SHA-256 of its sources; empty where a file does not say.

    `drives` are the names of recordings from whose hands it learned.
    """

    task: str = FETCH
    task_sha256: str = ""
    drives: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """For people."""
        return one_line(self.task)


def trained_task(path: Path) -> TrainedTask:
    """What a policy's file says.

    Raises:
        ConfigurationError: it can't be read.
        ContractError: it is no ONNX file.

    """
    told = read_onnx(read_bytes(path)).properties.get(PROVENANCE, "{}")
    try:
        return msgspec.json.decode(told, type=TrainedTask)
    except msgspec.DecodeError:
        return TrainedTask()  # another's provenance
