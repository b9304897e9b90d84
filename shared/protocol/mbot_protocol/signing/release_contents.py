"""What of the Python packages in a release a robot keeps on its disk.

Left out is what no daemon imports; that it does without is shown on booted machines, which install
such a release, try models and drive (tests/pi).
"""

_FOLDERS = (
    # The installer's own, which has done its work.
    *("pip", "setuptools", "pkg_resources", "_distutils_hack"),
    # Of our own wheel: the other side.
    *("mbot_workstation", "mbot_update"),
    # Compressors, which mcap imports only if they are there. Robots record uncompressed; releases
    # leave their wheels out.
    *("zstandard", "lz4"),
    # For building extensions, and converting and judging models.
    *("numpy/distutils", "numpy/f2py", "numpy/core/include", "numpy/_core/include"),
    *("onnxruntime/backend", "onnxruntime/datasets", "onnxruntime/quantization"),
    *("onnxruntime/tools", "onnxruntime/transformers"),
)
_STARTS = (
    *("pip-", "setuptools-", "zstandard-", "lz4-", "distutils-precedence"),
    # For programs in C; the module for Python holds all of it once more.
    "onnxruntime/capi/libonnxruntime.so",
    # Trained detectors of faces.
    "cv2/data/haarcascade",
)
_ENDS = (".pyi", ".pxd", ".a", ".h", ".c")

COMPILED_SHARE = 1.3
"""Bytecode is about as long as the Python it is made of, 30 % longer at the most."""


def is_needed(name: str) -> bool:
    """Whether a robot keeps this file.

    Args:
        name: relative to the folder of packages, with slashes.

    """
    return not (
        any(name == folder or name.startswith(f"{folder}/") for folder in _FOLDERS)
        or name.startswith(_STARTS)
        or name.endswith(_ENDS)
        or "tests" in name.split("/")[:-1]
    )


def size_on_disk(name: str, size_bytes: int) -> int:
    """Of a file in a wheel, in bytes, bytecode and the disk's blocks included."""
    if not is_needed(name):
        return 0
    blocks = size_bytes + 4096
    return blocks + int(COMPILED_SHARE * size_bytes) + 4096 if name.endswith(".py") else blocks
