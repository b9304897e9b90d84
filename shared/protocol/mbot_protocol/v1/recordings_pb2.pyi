from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ListedFile(_message.Message):
    __slots__ = ("name", "size_bytes")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    name: str
    size_bytes: int
    def __init__(self, name: _Optional[str] = ..., size_bytes: _Optional[int] = ...) -> None: ...

class ListedDrive(_message.Message):
    __slots__ = ("name", "files", "started_unix_time_ns", "ended_unix_time_ns", "kept", "open")
    NAME_FIELD_NUMBER: _ClassVar[int]
    FILES_FIELD_NUMBER: _ClassVar[int]
    STARTED_UNIX_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    ENDED_UNIX_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    KEPT_FIELD_NUMBER: _ClassVar[int]
    OPEN_FIELD_NUMBER: _ClassVar[int]
    name: str
    files: _containers.RepeatedCompositeFieldContainer[ListedFile]
    started_unix_time_ns: int
    ended_unix_time_ns: int
    kept: bool
    open: bool
    def __init__(self, name: _Optional[str] = ..., files: _Optional[_Iterable[_Union[ListedFile, _Mapping[str, object]]]] = ..., started_unix_time_ns: _Optional[int] = ..., ended_unix_time_ns: _Optional[int] = ..., kept: bool = ..., open: bool = ...) -> None: ...

class RecordingList(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "drives", "free_bytes", "enabled")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    DRIVES_FIELD_NUMBER: _ClassVar[int]
    FREE_BYTES_FIELD_NUMBER: _ClassVar[int]
    ENABLED_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    drives: _containers.RepeatedCompositeFieldContainer[ListedDrive]
    free_bytes: int
    enabled: bool
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., drives: _Optional[_Iterable[_Union[ListedDrive, _Mapping[str, object]]]] = ..., free_bytes: _Optional[int] = ..., enabled: bool = ...) -> None: ...

class RecordingRead(_message.Message):
    __slots__ = ("schema_version", "robot_id", "drive", "file", "offset_bytes", "count_bytes")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    FILE_FIELD_NUMBER: _ClassVar[int]
    OFFSET_BYTES_FIELD_NUMBER: _ClassVar[int]
    COUNT_BYTES_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    drive: str
    file: str
    offset_bytes: int
    count_bytes: int
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., drive: _Optional[str] = ..., file: _Optional[str] = ..., offset_bytes: _Optional[int] = ..., count_bytes: _Optional[int] = ...) -> None: ...

class RecordingPart(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "data")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    data: bytes
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., data: _Optional[bytes] = ...) -> None: ...

class RecordingDigest(_message.Message):
    __slots__ = ("schema_version", "robot_id", "drive", "file", "size_bytes")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    FILE_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    drive: str
    file: str
    size_bytes: int
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., drive: _Optional[str] = ..., file: _Optional[str] = ..., size_bytes: _Optional[int] = ...) -> None: ...

class RecordingDigestReply(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "sha256")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    sha256: str
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., sha256: _Optional[str] = ...) -> None: ...

class RecordingKeep(_message.Message):
    __slots__ = ("schema_version", "robot_id", "drive", "kept")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    KEPT_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    drive: str
    kept: bool
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., drive: _Optional[str] = ..., kept: bool = ...) -> None: ...

class RecordingRemove(_message.Message):
    __slots__ = ("schema_version", "robot_id", "drive")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    drive: str
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., drive: _Optional[str] = ...) -> None: ...
