from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    STATE_UNSPECIFIED: _ClassVar[State]
    STATE_IDLE: _ClassVar[State]
    STATE_RUNNING: _ClassVar[State]
    STATE_STOPPED: _ClassVar[State]
    STATE_FAULT: _ClassVar[State]
    STATE_MANUAL: _ClassVar[State]
STATE_UNSPECIFIED: State
STATE_IDLE: State
STATE_RUNNING: State
STATE_STOPPED: State
STATE_FAULT: State
STATE_MANUAL: State

class Fault(_message.Message):
    __slots__ = ("kind", "detail")
    KIND_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    kind: str
    detail: str
    def __init__(self, kind: _Optional[str] = ..., detail: _Optional[str] = ...) -> None: ...

class Notice(_message.Message):
    __slots__ = ("kind", "detail")
    KIND_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    kind: str
    detail: str
    def __init__(self, kind: _Optional[str] = ..., detail: _Optional[str] = ...) -> None: ...

class Wheels(_message.Message):
    __slots__ = ("left", "right")
    LEFT_FIELD_NUMBER: _ClassVar[int]
    RIGHT_FIELD_NUMBER: _ClassVar[int]
    left: float
    right: float
    def __init__(self, left: _Optional[float] = ..., right: _Optional[float] = ...) -> None: ...

class Steps(_message.Message):
    __slots__ = ("left", "right")
    LEFT_FIELD_NUMBER: _ClassVar[int]
    RIGHT_FIELD_NUMBER: _ClassVar[int]
    left: int
    right: int
    def __init__(self, left: _Optional[int] = ..., right: _Optional[int] = ...) -> None: ...

class Decision(_message.Message):
    __slots__ = ("schema_version", "robot_id", "session_id", "sequence", "state", "faults", "unix_time_ns", "captured_monotonic_ns", "due_monotonic_ns", "started_monotonic_ns", "observed_monotonic_ns", "decided_monotonic_ns", "written_monotonic_ns", "acknowledged_monotonic_ns", "action", "steps", "board_m1", "board_m2", "model_sha256", "missed_ticks", "cpu_temperature_c", "load_1min", "resident_memory_bytes", "dropped_records", "notices", "stop_count", "hand_let_go", "duty", "senses", "under_voltage", "driven_by", "held_ms", "would_have_done", "wrong_ms", "wrong_says")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    SESSION_ID_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    FAULTS_FIELD_NUMBER: _ClassVar[int]
    UNIX_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    CAPTURED_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    DUE_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    STARTED_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    OBSERVED_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    DECIDED_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    WRITTEN_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    ACKNOWLEDGED_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    BOARD_M1_FIELD_NUMBER: _ClassVar[int]
    BOARD_M2_FIELD_NUMBER: _ClassVar[int]
    MODEL_SHA256_FIELD_NUMBER: _ClassVar[int]
    MISSED_TICKS_FIELD_NUMBER: _ClassVar[int]
    CPU_TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    LOAD_1MIN_FIELD_NUMBER: _ClassVar[int]
    RESIDENT_MEMORY_BYTES_FIELD_NUMBER: _ClassVar[int]
    DROPPED_RECORDS_FIELD_NUMBER: _ClassVar[int]
    NOTICES_FIELD_NUMBER: _ClassVar[int]
    STOP_COUNT_FIELD_NUMBER: _ClassVar[int]
    HAND_LET_GO_FIELD_NUMBER: _ClassVar[int]
    DUTY_FIELD_NUMBER: _ClassVar[int]
    SENSES_FIELD_NUMBER: _ClassVar[int]
    UNDER_VOLTAGE_FIELD_NUMBER: _ClassVar[int]
    DRIVEN_BY_FIELD_NUMBER: _ClassVar[int]
    HELD_MS_FIELD_NUMBER: _ClassVar[int]
    WOULD_HAVE_DONE_FIELD_NUMBER: _ClassVar[int]
    WRONG_MS_FIELD_NUMBER: _ClassVar[int]
    WRONG_SAYS_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    session_id: int
    sequence: int
    state: State
    faults: _containers.RepeatedCompositeFieldContainer[Fault]
    unix_time_ns: int
    captured_monotonic_ns: int
    due_monotonic_ns: int
    started_monotonic_ns: int
    observed_monotonic_ns: int
    decided_monotonic_ns: int
    written_monotonic_ns: int
    acknowledged_monotonic_ns: int
    action: Wheels
    steps: Steps
    board_m1: int
    board_m2: int
    model_sha256: str
    missed_ticks: int
    cpu_temperature_c: float
    load_1min: float
    resident_memory_bytes: int
    dropped_records: int
    notices: _containers.RepeatedCompositeFieldContainer[Notice]
    stop_count: int
    hand_let_go: bool
    duty: Wheels
    senses: Senses
    under_voltage: bool
    driven_by: str
    held_ms: int
    would_have_done: Wheels
    wrong_ms: int
    wrong_says: str
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., session_id: _Optional[int] = ..., sequence: _Optional[int] = ..., state: _Optional[_Union[State, str]] = ..., faults: _Optional[_Iterable[_Union[Fault, _Mapping[str, object]]]] = ..., unix_time_ns: _Optional[int] = ..., captured_monotonic_ns: _Optional[int] = ..., due_monotonic_ns: _Optional[int] = ..., started_monotonic_ns: _Optional[int] = ..., observed_monotonic_ns: _Optional[int] = ..., decided_monotonic_ns: _Optional[int] = ..., written_monotonic_ns: _Optional[int] = ..., acknowledged_monotonic_ns: _Optional[int] = ..., action: _Optional[_Union[Wheels, _Mapping[str, object]]] = ..., steps: _Optional[_Union[Steps, _Mapping[str, object]]] = ..., board_m1: _Optional[int] = ..., board_m2: _Optional[int] = ..., model_sha256: _Optional[str] = ..., missed_ticks: _Optional[int] = ..., cpu_temperature_c: _Optional[float] = ..., load_1min: _Optional[float] = ..., resident_memory_bytes: _Optional[int] = ..., dropped_records: _Optional[int] = ..., notices: _Optional[_Iterable[_Union[Notice, _Mapping[str, object]]]] = ..., stop_count: _Optional[int] = ..., hand_let_go: bool = ..., duty: _Optional[_Union[Wheels, _Mapping[str, object]]] = ..., senses: _Optional[_Union[Senses, _Mapping[str, object]]] = ..., under_voltage: bool = ..., driven_by: _Optional[str] = ..., held_ms: _Optional[int] = ..., would_have_done: _Optional[_Union[Wheels, _Mapping[str, object]]] = ..., wrong_ms: _Optional[int] = ..., wrong_says: _Optional[str] = ...) -> None: ...

class Status(_message.Message):
    __slots__ = ("schema_version", "robot_id", "session_id", "now_monotonic_ns", "state", "faults", "software_version", "board_version", "board_has_deadman", "decision_rate_hz", "active_model", "missed_ticks", "decisions", "camera", "notices", "trusted_keys", "accepts_unsigned_models", "left_motor", "right_motor", "last_stop", "release", "let_go_monotonic_ns", "senses")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    SESSION_ID_FIELD_NUMBER: _ClassVar[int]
    NOW_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    FAULTS_FIELD_NUMBER: _ClassVar[int]
    SOFTWARE_VERSION_FIELD_NUMBER: _ClassVar[int]
    BOARD_VERSION_FIELD_NUMBER: _ClassVar[int]
    BOARD_HAS_DEADMAN_FIELD_NUMBER: _ClassVar[int]
    DECISION_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_MODEL_FIELD_NUMBER: _ClassVar[int]
    MISSED_TICKS_FIELD_NUMBER: _ClassVar[int]
    DECISIONS_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    NOTICES_FIELD_NUMBER: _ClassVar[int]
    TRUSTED_KEYS_FIELD_NUMBER: _ClassVar[int]
    ACCEPTS_UNSIGNED_MODELS_FIELD_NUMBER: _ClassVar[int]
    LEFT_MOTOR_FIELD_NUMBER: _ClassVar[int]
    RIGHT_MOTOR_FIELD_NUMBER: _ClassVar[int]
    LAST_STOP_FIELD_NUMBER: _ClassVar[int]
    RELEASE_FIELD_NUMBER: _ClassVar[int]
    LET_GO_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    SENSES_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    session_id: int
    now_monotonic_ns: int
    state: State
    faults: _containers.RepeatedCompositeFieldContainer[Fault]
    software_version: str
    board_version: str
    board_has_deadman: bool
    decision_rate_hz: float
    active_model: Model
    missed_ticks: int
    decisions: int
    camera: str
    notices: _containers.RepeatedCompositeFieldContainer[Notice]
    trusted_keys: _containers.RepeatedScalarFieldContainer[str]
    accepts_unsigned_models: bool
    left_motor: MotorMap
    right_motor: MotorMap
    last_stop: LastStop
    release: str
    let_go_monotonic_ns: int
    senses: Senses
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., session_id: _Optional[int] = ..., now_monotonic_ns: _Optional[int] = ..., state: _Optional[_Union[State, str]] = ..., faults: _Optional[_Iterable[_Union[Fault, _Mapping[str, object]]]] = ..., software_version: _Optional[str] = ..., board_version: _Optional[str] = ..., board_has_deadman: bool = ..., decision_rate_hz: _Optional[float] = ..., active_model: _Optional[_Union[Model, _Mapping[str, object]]] = ..., missed_ticks: _Optional[int] = ..., decisions: _Optional[int] = ..., camera: _Optional[str] = ..., notices: _Optional[_Iterable[_Union[Notice, _Mapping[str, object]]]] = ..., trusted_keys: _Optional[_Iterable[str]] = ..., accepts_unsigned_models: bool = ..., left_motor: _Optional[_Union[MotorMap, _Mapping[str, object]]] = ..., right_motor: _Optional[_Union[MotorMap, _Mapping[str, object]]] = ..., last_stop: _Optional[_Union[LastStop, _Mapping[str, object]]] = ..., release: _Optional[str] = ..., let_go_monotonic_ns: _Optional[int] = ..., senses: _Optional[_Union[Senses, _Mapping[str, object]]] = ...) -> None: ...

class Senses(_message.Message):
    __slots__ = ("distance_m", "floor_1", "floor_2", "edge", "obstacle", "supply_v")
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    FLOOR_1_FIELD_NUMBER: _ClassVar[int]
    FLOOR_2_FIELD_NUMBER: _ClassVar[int]
    EDGE_FIELD_NUMBER: _ClassVar[int]
    OBSTACLE_FIELD_NUMBER: _ClassVar[int]
    SUPPLY_V_FIELD_NUMBER: _ClassVar[int]
    distance_m: float
    floor_1: bool
    floor_2: bool
    edge: bool
    obstacle: bool
    supply_v: float
    def __init__(self, distance_m: _Optional[float] = ..., floor_1: bool = ..., floor_2: bool = ..., edge: bool = ..., obstacle: bool = ..., supply_v: _Optional[float] = ...) -> None: ...

class LastStop(_message.Message):
    __slots__ = ("count", "by", "why", "monotonic_ns")
    COUNT_FIELD_NUMBER: _ClassVar[int]
    BY_FIELD_NUMBER: _ClassVar[int]
    WHY_FIELD_NUMBER: _ClassVar[int]
    MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    count: int
    by: str
    why: str
    monotonic_ns: int
    def __init__(self, count: _Optional[int] = ..., by: _Optional[str] = ..., why: _Optional[str] = ..., monotonic_ns: _Optional[int] = ...) -> None: ...

class MotorMap(_message.Message):
    __slots__ = ("reversed", "trim", "dead_band")
    REVERSED_FIELD_NUMBER: _ClassVar[int]
    TRIM_FIELD_NUMBER: _ClassVar[int]
    DEAD_BAND_FIELD_NUMBER: _ClassVar[int]
    reversed: bool
    trim: float
    dead_band: int
    def __init__(self, reversed: bool = ..., trim: _Optional[float] = ..., dead_band: _Optional[int] = ...) -> None: ...

class Command(_message.Message):
    __slots__ = ("schema_version", "robot_id", "session_id", "expires_monotonic_ns", "stop_count", "sender", "sender_id", "number", "run", "stop", "drive", "mark")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    SESSION_ID_FIELD_NUMBER: _ClassVar[int]
    EXPIRES_MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    STOP_COUNT_FIELD_NUMBER: _ClassVar[int]
    SENDER_FIELD_NUMBER: _ClassVar[int]
    SENDER_ID_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    MARK_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    session_id: int
    expires_monotonic_ns: int
    stop_count: int
    sender: str
    sender_id: int
    number: int
    run: Run
    stop: Stop
    drive: Drive
    mark: Mark
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., session_id: _Optional[int] = ..., expires_monotonic_ns: _Optional[int] = ..., stop_count: _Optional[int] = ..., sender: _Optional[str] = ..., sender_id: _Optional[int] = ..., number: _Optional[int] = ..., run: _Optional[_Union[Run, _Mapping[str, object]]] = ..., stop: _Optional[_Union[Stop, _Mapping[str, object]]] = ..., drive: _Optional[_Union[Drive, _Mapping[str, object]]] = ..., mark: _Optional[_Union[Mark, _Mapping[str, object]]] = ...) -> None: ...

class Mark(_message.Message):
    __slots__ = ("back_ms",)
    BACK_MS_FIELD_NUMBER: _ClassVar[int]
    back_ms: int
    def __init__(self, back_ms: _Optional[int] = ...) -> None: ...

class Run(_message.Message):
    __slots__ = ("when_ready",)
    WHEN_READY_FIELD_NUMBER: _ClassVar[int]
    when_ready: bool
    def __init__(self, when_ready: bool = ...) -> None: ...

class Stop(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Drive(_message.Message):
    __slots__ = ("wheels", "hold_ms", "press", "let_go")
    WHEELS_FIELD_NUMBER: _ClassVar[int]
    HOLD_MS_FIELD_NUMBER: _ClassVar[int]
    PRESS_FIELD_NUMBER: _ClassVar[int]
    LET_GO_FIELD_NUMBER: _ClassVar[int]
    wheels: Wheels
    hold_ms: int
    press: int
    let_go: bool
    def __init__(self, wheels: _Optional[_Union[Wheels, _Mapping[str, object]]] = ..., hold_ms: _Optional[int] = ..., press: _Optional[int] = ..., let_go: bool = ...) -> None: ...

class CommandReply(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "state", "stop_count", "standing")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    STOP_COUNT_FIELD_NUMBER: _ClassVar[int]
    STANDING_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    state: State
    stop_count: int
    standing: bool
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., state: _Optional[_Union[State, str]] = ..., stop_count: _Optional[int] = ..., standing: bool = ...) -> None: ...

class Model(_message.Message):
    __slots__ = ("sha256", "name", "size_bytes", "stored_unix_time_ns", "active", "previous", "decision_rate_hz", "signed_by", "proven", "rejected")
    SHA256_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    STORED_UNIX_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_FIELD_NUMBER: _ClassVar[int]
    PREVIOUS_FIELD_NUMBER: _ClassVar[int]
    DECISION_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    SIGNED_BY_FIELD_NUMBER: _ClassVar[int]
    PROVEN_FIELD_NUMBER: _ClassVar[int]
    REJECTED_FIELD_NUMBER: _ClassVar[int]
    sha256: str
    name: str
    size_bytes: int
    stored_unix_time_ns: int
    active: bool
    previous: bool
    decision_rate_hz: float
    signed_by: str
    proven: bool
    rejected: bool
    def __init__(self, sha256: _Optional[str] = ..., name: _Optional[str] = ..., size_bytes: _Optional[int] = ..., stored_unix_time_ns: _Optional[int] = ..., active: bool = ..., previous: bool = ..., decision_rate_hz: _Optional[float] = ..., signed_by: _Optional[str] = ..., proven: bool = ..., rejected: bool = ...) -> None: ...

class PushNonce(_message.Message):
    __slots__ = ("schema_version", "robot_id")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ...) -> None: ...

class PushNonceReply(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "nonce")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    NONCE_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    nonce: str
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., nonce: _Optional[str] = ...) -> None: ...

class PushBegin(_message.Message):
    __slots__ = ("schema_version", "robot_id", "sha256", "size_bytes", "expected_active_sha256", "manifest", "signature", "public_key")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    EXPECTED_ACTIVE_SHA256_FIELD_NUMBER: _ClassVar[int]
    MANIFEST_FIELD_NUMBER: _ClassVar[int]
    SIGNATURE_FIELD_NUMBER: _ClassVar[int]
    PUBLIC_KEY_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    sha256: str
    size_bytes: int
    expected_active_sha256: str
    manifest: bytes
    signature: bytes
    public_key: bytes
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., sha256: _Optional[str] = ..., size_bytes: _Optional[int] = ..., expected_active_sha256: _Optional[str] = ..., manifest: _Optional[bytes] = ..., signature: _Optional[bytes] = ..., public_key: _Optional[bytes] = ...) -> None: ...

class PushChunk(_message.Message):
    __slots__ = ("schema_version", "push_id", "offset_bytes", "data")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    PUSH_ID_FIELD_NUMBER: _ClassVar[int]
    OFFSET_BYTES_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    push_id: str
    offset_bytes: int
    data: bytes
    def __init__(self, schema_version: _Optional[int] = ..., push_id: _Optional[str] = ..., offset_bytes: _Optional[int] = ..., data: _Optional[bytes] = ...) -> None: ...

class PushCommit(_message.Message):
    __slots__ = ("schema_version", "push_id")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    PUSH_ID_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    push_id: str
    def __init__(self, schema_version: _Optional[int] = ..., push_id: _Optional[str] = ...) -> None: ...

class PushReply(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "push_id", "received_bytes", "active_model")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    PUSH_ID_FIELD_NUMBER: _ClassVar[int]
    RECEIVED_BYTES_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_MODEL_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    push_id: str
    received_bytes: int
    active_model: Model
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., push_id: _Optional[str] = ..., received_bytes: _Optional[int] = ..., active_model: _Optional[_Union[Model, _Mapping[str, object]]] = ...) -> None: ...

class Activate(_message.Message):
    __slots__ = ("schema_version", "robot_id", "sha256", "manifest", "signature", "public_key")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    MANIFEST_FIELD_NUMBER: _ClassVar[int]
    SIGNATURE_FIELD_NUMBER: _ClassVar[int]
    PUBLIC_KEY_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    sha256: str
    manifest: bytes
    signature: bytes
    public_key: bytes
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., sha256: _Optional[str] = ..., manifest: _Optional[bytes] = ..., signature: _Optional[bytes] = ..., public_key: _Optional[bytes] = ...) -> None: ...

class ModelList(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "models")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MODELS_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    models: _containers.RepeatedCompositeFieldContainer[Model]
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., models: _Optional[_Iterable[_Union[Model, _Mapping[str, object]]]] = ...) -> None: ...

class ReleaseBegin(_message.Message):
    __slots__ = ("schema_version", "robot_id", "manifest", "signatures")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    MANIFEST_FIELD_NUMBER: _ClassVar[int]
    SIGNATURES_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    robot_id: str
    manifest: bytes
    signatures: bytes
    def __init__(self, schema_version: _Optional[int] = ..., robot_id: _Optional[str] = ..., manifest: _Optional[bytes] = ..., signatures: _Optional[bytes] = ...) -> None: ...

class Release(_message.Message):
    __slots__ = ("version", "previous", "golden")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    PREVIOUS_FIELD_NUMBER: _ClassVar[int]
    GOLDEN_FIELD_NUMBER: _ClassVar[int]
    version: str
    previous: bool
    golden: bool
    def __init__(self, version: _Optional[str] = ..., previous: bool = ..., golden: bool = ...) -> None: ...

class ReleaseList(_message.Message):
    __slots__ = ("schema_version", "accepted", "reason", "running", "releases", "update")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    RUNNING_FIELD_NUMBER: _ClassVar[int]
    RELEASES_FIELD_NUMBER: _ClassVar[int]
    UPDATE_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    accepted: bool
    reason: str
    running: str
    releases: _containers.RepeatedCompositeFieldContainer[Release]
    update: ReleaseUpdate
    def __init__(self, schema_version: _Optional[int] = ..., accepted: bool = ..., reason: _Optional[str] = ..., running: _Optional[str] = ..., releases: _Optional[_Iterable[_Union[Release, _Mapping[str, object]]]] = ..., update: _Optional[_Union[ReleaseUpdate, _Mapping[str, object]]] = ...) -> None: ...

class ReleaseUpdate(_message.Message):
    __slots__ = ("request", "version", "phase", "detail", "goes_on")
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    GOES_ON_FIELD_NUMBER: _ClassVar[int]
    request: str
    version: str
    phase: str
    detail: str
    goes_on: bool
    def __init__(self, request: _Optional[str] = ..., version: _Optional[str] = ..., phase: _Optional[str] = ..., detail: _Optional[str] = ..., goes_on: bool = ...) -> None: ...
