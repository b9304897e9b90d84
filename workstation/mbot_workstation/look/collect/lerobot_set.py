"""Kept drives as a LeRobot dataset of version 3.0: Parquet files, and JSON on what they hold.

Pictures are PNG inside the Parquet files, as that format has them beside video: at 64 x 64 nothing
is gained by a codec, and what the policy saw stays exact.
"""

import importlib
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.look.collect.exports import Kept, policy_answer, save_in_folder, taught
from mbot_workstation.look.collect.moments import SHAPE, is_marked, marks
from mbot_workstation.pictures.picture_file import encode_picture

PICTURE, STATE, ACTION = "observation.image", "observation.state", "action"
WHEELS = ["left", "right"]
TASK = "as the robot was driven"
FILE = "chunk-000/file-000.parquet"
SHORTEST = 2
"""Beats of an episode; of a single one nothing follows."""

_NUMBERS = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64"} | {
    "index": "int64",
    "task_index": "int64",
}


@dataclass(frozen=True, slots=True)
class TaughtFrame:
    """One beat: the picture as PNG, its mean colours, the wheels before and now, and by whom."""

    png: bytes
    colours: tuple[float, ...]
    before: tuple[float, float]
    told: tuple[float, float]
    policy: tuple[float, float] | None
    by_hand: bool
    wrong: bool


def write_lerobot(folder: Path, kept: Kept) -> dict[str, int]:
    """A dataset a part; how many episodes each has.

    Raises:
        ConfigurationError: pyarrow is missing, the drives are of different rates, or a file can't
            be written.

    """
    try:
        arrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise ConfigurationError(
            "--lerobot needs pyarrow: pip install -c constraints.txt -e '.[lerobot]' in the "
            "checkout"
        ) from None
    counts: dict[str, int] = {}
    for part, drives in kept.items():
        read = [read_drive(path) for path in drives]
        rates = {drive.facts.decision_rate_hz for drive in read if drive.facts is not None}
        if len(rates) > 1:
            raise ConfigurationError(f"drives of different rates, {sorted(rates)}: one at a time")
        rate_hz = min(rates, default=2.5)
        found = [one for drive in read for one in episodes(drive) if len(one) >= SHORTEST]
        counts[part] = len(found)
        if found:
            for name, table in _tables(arrow, found, rate_hz).items():
                written = io.BytesIO()
                parquet.write_table(table, written)
                save_in_folder(folder / part / name, written.getvalue())
            for name, facts in _facts(found, rate_hz).items():
                save_in_folder(folder / part / name, json.dumps(facts, indent=2).encode())
    return counts


def episodes(drive: RecordedDrive) -> Iterator[list[TaughtFrame]]:
    """What was driven without a break: the format wants beats at equal distances."""
    wrong = marks(drive)
    gathered: list[TaughtFrame] = []
    last: tuple[int, int] | None = None
    for beat, seen, told, by_hand in taught(drive):
        session, number = beat.key
        if last != (session, number - 1):
            if gathered:
                yield gathered
            gathered = []
        last = session, number
        gathered.append(
            TaughtFrame(
                encode_picture(seen, ".png"),
                tuple(seen.reshape(-1, 3).mean(axis=0) / 255),
                gathered[-1].told if gathered else (0.0, 0.0),
                told,
                policy_answer(beat),
                by_hand,
                is_marked(drive, wrong, beat),
            )
        )
    if gathered:
        yield gathered


def _tables(
    arrow: Any, found: Sequence[Sequence[TaughtFrame]], rate_hz: float
) -> Mapping[str, Any]:
    pair = arrow.list_(arrow.float32(), 2)
    frames = [frame for one in found for frame in one]
    place = [(episode, number) for episode, one in enumerate(found) for number in range(len(one))]
    data = {
        PICTURE: arrow.array(
            [{"bytes": frame.png, "path": None} for frame in frames],
            arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())]),
        ),
        STATE: arrow.array([frame.before for frame in frames], pair),
        ACTION: arrow.array([frame.told for frame in frames], pair),
        "policy_action": arrow.array([frame.policy or (0.0, 0.0) for frame in frames], pair),
        "policy_asked": arrow.array([frame.policy is not None for frame in frames]),
        "by_hand": arrow.array([frame.by_hand for frame in frames]),
        "marked_wrong": arrow.array([frame.wrong for frame in frames]),
        "timestamp": arrow.array([number / rate_hz for _, number in place], arrow.float32()),
        "frame_index": arrow.array([number for _, number in place], arrow.int64()),
        "episode_index": arrow.array([episode for episode, _ in place], arrow.int64()),
        "index": arrow.array(range(len(frames)), arrow.int64()),
        "task_index": arrow.array([0] * len(frames), arrow.int64()),
    }
    ends = np.cumsum([len(one) for one in found]).tolist()
    zeros = [0] * len(found)
    told = {
        "episode_index": list(range(len(found))),
        "tasks": [[TASK]] * len(found),
        "length": [len(one) for one in found],
        "data/chunk_index": zeros,
        "data/file_index": zeros,
        "dataset_from_index": [0, *ends[:-1]],
        "dataset_to_index": ends,
        "meta/episodes/chunk_index": zeros,
        "meta/episodes/file_index": zeros,
    }
    tasks = arrow.table({"task_index": [0], "task": [TASK]})
    # Readers want the task's words as the index of a data frame, which pandas is told this way.
    columns = [
        {"name": name, "field_name": name, "pandas_type": of, "numpy_type": kind, "metadata": None}
        for name, of, kind in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]
    index = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
    words = {"pandas": json.dumps(index | {"pandas_version": "2.0.0"})}
    return {
        f"data/{FILE}": arrow.table(data),
        f"meta/episodes/{FILE}": arrow.table(told),
        "meta/tasks.parquet": tasks.replace_schema_metadata(words),
    }


def _facts(found: Sequence[Sequence[TaughtFrame]], rate_hz: float) -> Mapping[str, Any]:
    frames = [frame for one in found for frame in one]
    wheels = {"dtype": "float32", "shape": [2], "names": WHEELS}
    vectors = {name: wheels for name in (STATE, ACTION, "policy_action")}
    kinds = dict.fromkeys(("policy_asked", "by_hand", "marked_wrong"), "bool") | _NUMBERS
    single = {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in kinds.items()}
    sides = ["height", "width", "channels"]
    picture = {PICTURE: {"dtype": "image", "shape": list(SHAPE), "names": sides}}
    colours = _stats(np.array([frame.colours for frame in frames]))
    stats = {
        STATE: _stats(np.array([frame.before for frame in frames])),
        ACTION: _stats(np.array([frame.told for frame in frames])),
        PICTURE: {
            name: [[[value]] for value in values] if name != "count" else values
            for name, values in colours.items()
        },
    }
    return {
        "meta/stats.json": stats,
        "meta/info.json": {
            "codebase_version": "v3.0",
            "robot_type": "mbot",
            "total_episodes": len(found),
            "total_frames": len(frames),
            "total_tasks": 1,
            "chunks_size": 1000,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": int(rate_hz) if rate_hz.is_integer() else rate_hz,
            "splits": {"train": f"0:{len(found)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "features": picture | vectors | single,
        },
    }


def _stats(values: "np.ndarray[Any, Any]") -> dict[str, list[Any]]:
    """Of each column; a picture's are those of its pictures' means."""
    return {
        "min": values.min(axis=0).tolist(),
        "max": values.max(axis=0).tolist(),
        "mean": values.mean(axis=0).tolist(),
        "std": values.std(axis=0).tolist(),
        "count": [len(values)],
    }
