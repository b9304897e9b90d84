"""The layout for Foxglove and Lichtblick names topics and fields that exist."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mbot_protocol.beat.fields import drive_schema
from mbot_protocol.beat.whole_chunks import WholeChunks
from mbot_workstation.look.drives import foxglove_layout
from mbot_workstation.look.drives.foxglove_layout import layout, layout_file, layout_text

CHECKOUT = Path(__file__).parents[2]
LIVE = {"observation", "camera", "log", "drive"}
"""What the bridge advertises: test_foxglove_bridge.py."""


def names(found: Any) -> Iterator[str]:
    """Every topic, with its field where one is named, of robot mbot-1."""
    if isinstance(found, dict):
        for value in found.values():
            yield from names(value)
    elif isinstance(found, list):
        for value in found:
            yield from names(value)
    elif isinstance(found, str) and found.startswith("/mbot/"):
        assert found.startswith("/mbot/mbot-1/")
        yield found.removeprefix("/mbot/mbot-1/")


def test_every_topic_and_field_exists() -> None:
    recorded = {
        message.topic.rpartition("/")[2]
        for message in WholeChunks(CHECKOUT / "tests/data/recorded-drive/000.mcap").messages()
    }
    fields = json.loads(drive_schema())["properties"]
    found = list(names(layout("mbot-1")))
    topics = {name.partition(".")[0] for name in found}
    assert topics == LIVE
    assert topics - {"camera"} <= recorded
    for name in found:
        topic, _, field = name.partition(".")
        assert not field or (topic == "drive" and field in fields), name


def panels(found: Any) -> Iterator[str]:
    if isinstance(found, str):
        yield found
    else:
        assert found["direction"] in ("row", "column")
        yield from panels(found["first"])
        yield from panels(found["second"])


def test_every_panel_stands_somewhere_once() -> None:
    made = layout("mbot-1")
    assert sorted(panels(made["layout"])) == sorted(made["configById"])
    kinds = {name.partition("!")[0] for name in made["configById"]}
    assert kinds == {"Image", "Plot", "RosOut"}


def test_the_file_that_ships_is_the_one_that_is_made() -> None:
    shipped = (CHECKOUT / "docs" / "foxglove-layout.json").read_text()
    assert shipped == layout_text("mbot-1"), (
        "python -c 'from mbot_workstation.look.drives.foxglove_layout import layout_text; "
        'print(layout_text("mbot-1"), end="")\' > docs/foxglove-layout.json'
    )


def test_a_robots_own_is_written_for_whoever_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = layout_file("mbot-7")
    assert json.loads(path.read_text()) == layout("mbot-7")
    assert path == tmp_path / "cache" / "mbot-agent" / "foxglove-mbot-7.json"
    assert foxglove_layout.layout_file("mbot-7") == path
