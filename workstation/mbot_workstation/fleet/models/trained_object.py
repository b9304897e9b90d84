"""What a policy was trained to fetch, in its file: which it is, and how to build it again."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.onnx_file import read_onnx
from mbot_workstation.fleet.models.check import read_bytes
from mbot_workstation.fleet.models.model_findings import PROVENANCE
from mbot_workstation.wording import one_line, typed

if TYPE_CHECKING:
    from mbot_workstation.sim.scene.target_object import TargetObject

_FILES = ("mesh", "texture")


class TrainedObject(msgspec.Struct, frozen=True):
    """Of an `--object` file what it means.

    Attributes:
        file: its name, without a path.
        sha256: of its meaning: two files that differ in comments alone have the same.
        kinds: its sections; files that these name are told by name and SHA-256.

    """

    file: str
    sha256: str
    kinds: tuple[dict[str, Any], ...]

    @property
    def words(self) -> str:
        """For people: "green ball and blue bottle"."""
        return named([str(kind.get("name")) for kind in self.kinds])

    @property
    def option(self) -> str:
        """What `workstation evaluate` has to be told; nothing where this builds the object."""
        return f" --object {typed(self._file_name)}" if self._needs_files else ""

    @property
    def _file_name(self) -> str:
        """Whatever a stranger's policy calls it."""
        return one_line(Path(self.file).name)

    @property
    def _needs_files(self) -> bool:
        return any(name in kind for kind in self.kinds for name in _FILES)

    def objects(self) -> "tuple[TargetObject, ...]":
        """The kinds of object themselves.

        Raises:
            ConfigurationError: they need a mesh or a texture, or are unusable.

        """
        from mbot_workstation.sim.scene.object_file import ObjectFile, made_object

        if self._needs_files:
            raise ConfigurationError(
                f"the policy fetches the {self.words}, whose surface is not in its file: name "
                f"{typed(self._file_name)} by --object FILE.toml"
            )
        try:
            told = msgspec.convert({"object": self.kinds}, ObjectFile)
        except msgspec.ValidationError as error:
            raise ConfigurationError(
                f"the policy says of what it fetches what can't be: {error}; give --object "
                "FILE.toml"
            ) from None
        return tuple(made_object(section, Path()) for section in told.object)


def told_object(path: Path | str) -> TrainedObject | None:
    """Of an `--object` file; None if it means the red cube, which policies don't name.

    Raises:
        ConfigurationError: it, or a file that it names, can't be read or is unusable.

    """
    from mbot_protocol.files.toml_file import read_toml
    from mbot_workstation.sim.scene.object_file import ObjectFile, read_objects
    from mbot_workstation.sim.scene.target_object import RED_CUBE

    path = Path(path)
    thing = read_objects(path)
    kinds: list[dict[str, Any]] = []
    for section in read_toml(path, ObjectFile).object:
        kind = {k: v for k, v in msgspec.to_builtins(section).items() if v is not None}
        for name in kind.keys() & set(_FILES):
            kind[f"{name}_sha256"] = hashlib.sha256(
                read_bytes(path.parent / kind[name])
            ).hexdigest()
            kind[name] = Path(kind[name]).name
        if "colour" in kind:
            kind["colour"] = kind["colour"].lower()
        kinds.append(dict(sorted(kind.items())))
    if thing == (RED_CUBE,) and thing[0].is_plain:
        return None
    meaning = json.dumps(kinds, separators=(",", ":"))
    return TrainedObject(path.name, hashlib.sha256(meaning.encode()).hexdigest(), tuple(kinds))


def trained_object(path: Path) -> TrainedObject | None:
    """What a policy's file says; None if it names nothing: the red cube.

    Raises:
        ConfigurationError: it can't be read, or names an object in a way that is not ours.
        ContractError: it is no ONNX file.

    """

    class Provenance(msgspec.Struct):
        object: TrainedObject | None = None

    try:
        told = read_onnx(read_bytes(path)).properties.get(PROVENANCE, "{}")
        return msgspec.json.decode(told, type=Provenance).object
    except msgspec.ValidationError as error:
        raise ConfigurationError(
            f"{path} does not say what it fetches as this version knows it ({one_line(str(error))})"
            ": export it again"
        ) from None
    except msgspec.DecodeError:
        return None  # another's provenance


def objects_of(file: Path | None) -> "tuple[TargetObject, ...]":
    """The kinds of object of an `--object` file, or those that a policy (.onnx) was trained for.

    Args:
        file: None is the red cube, as is a policy that names nothing.

    Raises:
        ConfigurationError: it can't be read or is unusable, or the policy does not hold all of it.
        ContractError: what is called .onnx is none.

    """
    from mbot_workstation.sim.scene.object_file import read_objects

    if file is None or file.suffix != ".onnx":
        return read_objects(file)
    thing = trained_object(file)
    return read_objects(None) if thing is None else thing.objects()


def named(names: Sequence[str]) -> str:
    """Several names in one line."""
    return one_line(" and ".join(names))
