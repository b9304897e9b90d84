"""The table of Zenoh keys: what a robot publishes and what it answers.

Every key starts with the robot's own prefix, so that no robot hears another one's commands.
"""

import re
from dataclasses import dataclass
from enum import Enum

from mbot_protocol.errors import ConfigurationError

ROOT = "mbot"
DEFAULT_PORT = 7447
DEFAULT_ENDPOINT = f"tcp/127.0.0.1:{DEFAULT_PORT}"

FOXGLOVE_PICTURE = "foxglove.CompressedImage"


SMALL_BYTES = 4 * 1024
"""Room for every request but a chunk of a model."""


class Right(Enum):
    """What a person may do with a robot. `push` and `drive` each come with `view`."""

    VIEW = "view"
    """See that it is alive, its status, telemetry and recordings; and stop it: a stop can do no
    harm."""

    PUSH = "push"
    """Send models and make them active; send releases of the daemon; remove recordings, or keep
    them from going."""

    DRIVE = "drive"
    """Let it run, drive it by hand, mark what was wrong: what is learned from drives it."""


class Flow(Enum):
    """How a key is used."""

    PUBLISH = "publish"
    """Best effort, dropped when the link is slow: a late record is worth nothing."""

    QUERY = "query"
    """Reliable, one reply each; no reply means the request was not carried out."""

    LIVELINESS = "liveliness"
    """A token that exists while the robot's session does."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One row of the table.

    Attributes:
        name: the key below the robot's prefix.
        flow: how it is used.
        message: full name of the protobuf message published or sent as the query's payload.
        reply: full name of the reply's message, for queries.
        rate: how often, in words.
        right: who may use it.
        largest_bytes: a larger request never reaches the daemon, for queries.

    """

    name: str
    flow: Flow
    message: str = ""
    reply: str = ""
    rate: str = "on demand"
    right: Right = Right.VIEW
    largest_bytes: int = SMALL_BYTES

    def key(self, robot_id: str) -> str:
        """The whole Zenoh key for one robot, or for all with `*`."""
        return f"{ROOT}/{robot_id}/{self.name}"


CHUNK_BYTES = 64 * 1024
"""Pushes go in acknowledged chunks of this size: on a 250 kB/s link a STOP beside a push then
waits 60 to 160 ms instead of 5 s (measured)."""

ALIVE = Topic("alive", Flow.LIVELINESS, rate="while the daemon runs")
DECISION = Topic("telemetry/decision", Flow.PUBLISH, "mbot.v1.Decision", rate="every tick")
OBSERVATION = Topic("telemetry/observation", Flow.PUBLISH, FOXGLOVE_PICTURE, rate="every tick")
CAMERA = Topic("telemetry/camera", Flow.PUBLISH, FOXGLOVE_PICTURE, rate="every tick, if watched")
STATUS = Topic("status", Flow.QUERY, "", "mbot.v1.Status")
STOP = Topic("stop", Flow.QUERY, "mbot.v1.Command", "mbot.v1.CommandReply")
COMMAND = Topic("command", Flow.QUERY, "mbot.v1.Command", "mbot.v1.CommandReply", right=Right.DRIVE)
PUSH_NONCE = Topic(
    "models/push/nonce", Flow.QUERY, "mbot.v1.PushNonce", "mbot.v1.PushNonceReply", right=Right.PUSH
)
PUSH_BEGIN = Topic(
    "models/push/begin", Flow.QUERY, "mbot.v1.PushBegin", "mbot.v1.PushReply", right=Right.PUSH
)
PUSH_CHUNK = Topic(
    "models/push/chunk",
    Flow.QUERY,
    "mbot.v1.PushChunk",
    "mbot.v1.PushReply",
    "one at a time",
    Right.PUSH,
    CHUNK_BYTES + SMALL_BYTES,
)
PUSH_COMMIT = Topic(
    "models/push/commit", Flow.QUERY, "mbot.v1.PushCommit", "mbot.v1.PushReply", right=Right.PUSH
)
MODELS = Topic("models/list", Flow.QUERY, "", "mbot.v1.ModelList", right=Right.PUSH)
ACTIVATE = Topic(
    "models/activate", Flow.QUERY, "mbot.v1.Activate", "mbot.v1.ModelList", right=Right.PUSH
)
RELEASE_BEGIN = Topic(
    "releases/push/begin",
    Flow.QUERY,
    "mbot.v1.ReleaseBegin",
    "mbot.v1.PushReply",
    right=Right.PUSH,
    largest_bytes=CHUNK_BYTES + SMALL_BYTES,
)
RELEASE_CHUNK = Topic(
    "releases/push/chunk",
    Flow.QUERY,
    "mbot.v1.PushChunk",
    "mbot.v1.PushReply",
    "one at a time",
    Right.PUSH,
    CHUNK_BYTES + SMALL_BYTES,
)
RELEASE_COMMIT = Topic(
    "releases/push/commit", Flow.QUERY, "mbot.v1.PushCommit", "mbot.v1.PushReply", right=Right.PUSH
)
RELEASES = Topic("releases/list", Flow.QUERY, "", "mbot.v1.ReleaseList", right=Right.PUSH)
RECORDINGS = Topic("recordings/list", Flow.QUERY, "", "mbot.v1.RecordingList")
RECORDING_READ = Topic(
    "recordings/read",
    Flow.QUERY,
    "mbot.v1.RecordingRead",
    "mbot.v1.RecordingPart",
    "one at a time",
)
RECORDING_DIGEST = Topic(
    "recordings/digest", Flow.QUERY, "mbot.v1.RecordingDigest", "mbot.v1.RecordingDigestReply"
)
RECORDING_KEEP = Topic(
    "recordings/keep",
    Flow.QUERY,
    "mbot.v1.RecordingKeep",
    "mbot.v1.RecordingList",
    right=Right.PUSH,
)
RECORDING_REMOVE = Topic(
    "recordings/remove",
    Flow.QUERY,
    "mbot.v1.RecordingRemove",
    "mbot.v1.RecordingList",
    right=Right.PUSH,
)

DOORS = {
    right: Topic(f"may/{right.value}", Flow.LIVELINESS, rate="while the daemon runs", right=right)
    for right in Right
}
"""Tokens that show which rights somebody has: each is seen by those with its right only. A denied
query is answered by nobody, so without them a person would never learn why."""

PRESENCE = Topic("here/*", Flow.LIVELINESS, rate="while a workstation is connected")
"""Not the robot's token but the workstations': one each, with its session in the place of `*`."""

TOPICS = (
    ALIVE,
    DECISION,
    OBSERVATION,
    CAMERA,
    STATUS,
    STOP,
    COMMAND,
    PUSH_NONCE,
    PUSH_BEGIN,
    PUSH_CHUNK,
    PUSH_COMMIT,
    MODELS,
    ACTIVATE,
    RELEASE_BEGIN,
    RELEASE_CHUNK,
    RELEASE_COMMIT,
    RELEASES,
    RECORDINGS,
    RECORDING_READ,
    RECORDING_DIGEST,
    RECORDING_KEEP,
    RECORDING_REMOVE,
    *DOORS.values(),
    PRESENCE,
)


def presence_key(robot_id: str, session: str) -> str:
    """The key of one workstation's token."""
    return PRESENCE.key(robot_id).replace("*", session)


_ROBOT_ID = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")


def check_robot_id(robot_id: str) -> str:
    """Return the identifier if it is safe as one part of a Zenoh key.

    Raises:
        ConfigurationError: it is not 1 to 32 of a-z, 0-9, `-`, `_`, beginning with a letter or
            digit; a wildcard would make a robot answer for others.

    """
    if not _ROBOT_ID.fullmatch(robot_id):
        raise ConfigurationError(
            f"robot id is {robot_id!r}, expected 1 to 32 of a-z, 0-9, '-' and '_', such as 'mbot-1'"
        )
    return robot_id


def robot_id_of(key: str) -> str:
    """The robot's part of a whole key."""
    return key.split("/")[1]
