from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import read_text, text_if_any


def test_a_text_is_read_without_an_editors_mark(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(b"\xef\xbb\xbfname = 'Mia'")
    assert read_text(path) == text_if_any(path) == "name = 'Mia'"


def test_what_is_missing_is_none_or_a_mistake(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "none", tmp_path / "file" / "below"):
        assert text_if_any(path) is None
        with pytest.raises(ConfigurationError, match=r"^can't read .*: No such file or directory$"):
            read_text(path)


def test_what_is_no_text_or_no_file_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "picture").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ConfigurationError, match=r"^can't read .*picture: it is not text$"):
        text_if_any(tmp_path / "picture")
    with pytest.raises(ConfigurationError, match=r"^can't read .*: Is a directory$"):
        text_if_any(tmp_path)
