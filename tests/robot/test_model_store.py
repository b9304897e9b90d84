import errno
import hashlib
import os
from pathlib import Path

import pytest

from mbot_agent.models.activation import Activation
from mbot_agent.models.model_directory import Label, ModelDirectory
from mbot_protocol.errors import ContractError, RefusedError
from mbot_protocol.files import atomic_file


def put(store: ModelDirectory, data: bytes) -> str:
    sha256 = hashlib.sha256(data).hexdigest()
    store.add(sha256, data, Label(data.decode(), 2.5))
    return sha256


def activate(store: ModelDirectory, sha256: str) -> None:
    store.activate(sha256, store.activation.active)


@pytest.fixture
def store(tmp_path: Path) -> ModelDirectory:
    return ModelDirectory(tmp_path / "models", keep=3)


def test_an_empty_store_has_no_active_model(store: ModelDirectory) -> None:
    assert store.activation == Activation()
    assert store.models() == []


def test_activation_remembers_what_was_before(store: ModelDirectory) -> None:
    first, second = put(store, b"first"), put(store, b"second")
    activate(store, first)
    activate(store, second)
    assert store.activation == Activation(second, first)
    activate(store, second)  # again: nothing changes
    assert store.activation == Activation(second, first)
    assert store.read(first) == b"first"


def test_a_damaged_model_is_never_handed_out(store: ModelDirectory, tmp_path: Path) -> None:
    sha256 = put(store, b"whole")
    (tmp_path / "models" / f"{sha256}.onnx").write_bytes(b"whale")
    with pytest.raises(ContractError, match="damaged"):
        store.read(sha256)


@pytest.mark.parametrize("content", [b"", b"\x00\xff{", b"[]", b'{"starts": {"a": "b"}}'])
def test_a_damaged_activation_means_no_model_not_a_crash(
    store: ModelDirectory, tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "models" / "active.json"
    path.write_bytes(content)
    assert store.activation == Activation()
    activate(store, put(store, b"one"))
    assert store.activation.active


def test_an_activation_of_an_older_version_is_read(store: ModelDirectory, tmp_path: Path) -> None:
    first, second = put(store, b"first"), put(store, b"second")
    text = f'{{"active":"{second}","previous":"{first}"}}'
    (tmp_path / "models" / "active.json").write_text(text)
    assert store.activation == Activation(second, first)


def test_an_activation_that_cannot_be_read_now_is_not_overwritten(
    store: ModelDirectory, tmp_path: Path
) -> None:
    sha256 = put(store, b"one")
    (tmp_path / "models" / "active.json").mkdir()
    assert store.activation == Activation()
    with pytest.raises(RefusedError, match="Is a directory"):
        activate(store, sha256)


def test_old_models_go_but_never_the_active_or_previous_one(
    store: ModelDirectory, tmp_path: Path
) -> None:
    digests: list[str] = []
    for age in range(6):
        digests.append(put(store, f"model {age}".encode()))
        os.utime(tmp_path / "models" / f"{digests[-1]}.onnx", (age, age))
        activate(store, digests[-1])
    activate(store, digests[3])
    kept = {model.sha256: model.label.name for model in store.models()}
    assert kept == {digests[5]: "model 5", digests[4]: "model 4", digests[3]: "model 3"}
    assert len(list((tmp_path / "models").iterdir())) == 2 * 3 + 1


def test_a_model_that_is_not_stored_cannot_become_active(store: ModelDirectory) -> None:
    with pytest.raises(RefusedError, match="no stored model"):
        activate(store, "0" * 64)


def test_prefixes_must_be_long_and_fit_one(store: ModelDirectory) -> None:
    sha256 = put(store, b"one")
    assert store.find(sha256[:8]) == sha256
    for prefix in (sha256[:7], "0" * 8, ""):
        with pytest.raises(RefusedError, match="stored models begin with"):
            store.find(prefix)


@pytest.mark.parametrize("step", ["fsync", "rename"])
def test_a_full_disk_leaves_the_old_model_and_no_litter(
    store: ModelDirectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    old, new = put(store, b"old"), put(store, b"new")
    activate(store, old)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(atomic_file.os, step, full)
    with pytest.raises(RefusedError, match="No space left"):
        activate(store, new)
    with pytest.raises(RefusedError, match="No space left"):
        put(store, b"third")
    monkeypatch.undo()
    assert store.activation.active == old
    assert store.read(old) == b"old"
    assert list((tmp_path / "models").glob("*.tmp")) == []


def test_leftovers_of_a_power_cut_are_swept_at_start(tmp_path: Path) -> None:
    store = ModelDirectory(tmp_path, keep=2)
    sha256 = put(store, b"whole")
    (tmp_path / f"{'a' * 64}.onnx.1.2.tmp").write_bytes(b"half")
    (tmp_path / f"{'b' * 64}.json").write_text("the label of a model that never came")
    (tmp_path / "sequences.json").write_text("{}")
    store.sweep()
    expected = {f"{sha256}.onnx", f"{sha256}.json", "sequences.json"}
    assert {path.name for path in tmp_path.iterdir()} == expected


def test_a_model_stored_again_keeps_its_bytes_and_gets_the_new_label(
    store: ModelDirectory, tmp_path: Path
) -> None:
    sha256 = put(store, b"one")
    path = tmp_path / "models" / f"{sha256}.onnx"
    os.utime(path, (1, 1))
    store.add(sha256, b"one", Label("again"))
    assert store.label(sha256) == Label("again")
    assert store.stored_unix_time_ns(sha256) == 10**9
    path.write_bytes(b"two")
    store.add(sha256, b"one", Label("mended"))
    assert store.read(sha256) == b"one"


def test_a_directory_that_cannot_be_made_is_explained(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RefusedError, match=r"set models\.directory"):
        ModelDirectory(tmp_path / "file" / "models", keep=2)
