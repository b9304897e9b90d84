"""Which files of packages a robot keeps."""

import pytest

from mbot_protocol.signing.release_contents import is_needed, size_on_disk


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("numpy/__init__.py", True),
        ("numpy/__init__.pyi", False),
        ("numpy/tests/test_all.py", False),
        ("numpy/testing/__init__.py", True),
        ("mbot_agent/main.py", True),
        ("mbot_workstation/main.py", False),
        ("onnxruntime/capi/libonnxruntime.so.1.31.1", False),
        ("onnxruntime/capi/onnxruntime_pybind11_state.so", True),
        ("mbot_agent-0.1.0.dist-info/METADATA", True),
        ("lz4-4.4.5.dist-info/METADATA", False),
        ("cv2/data/haarcascade_eye.xml", False),
        ("cv2/data/__init__.py", True),
    ],
)
def test_what_no_daemon_imports_is_left_out(name: str, kept: bool) -> None:
    assert is_needed(name) is kept
    assert (size_on_disk(name, 1000) > 0) is kept


def test_python_counts_with_its_bytecode() -> None:
    assert size_on_disk("a.py", 10_000) > 2 * 10_000
    assert size_on_disk("a.so", 10_000) < 2 * 10_000
