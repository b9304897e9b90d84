from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.git_lfs import POINTER, refuse_pointer

NOTE = (
    POINTER + b"v1\noid sha256:" + b"0123456789abcdef" * 4 + b"\nsize 1234567\n"
)  # as `git lfs pointer` writes it


def test_a_pointer_is_told_from_what_it_stands_for() -> None:
    with pytest.raises(ConfigurationError, match=r"a\.onnx is a Git LFS pointer.*git lfs pull"):
        refuse_pointer(Path("a.onnx"), NOTE)
    for start in (b"", b"version 1\n", NOTE[:20], b"\x08" + NOTE):
        refuse_pointer(Path("a.onnx"), start)
