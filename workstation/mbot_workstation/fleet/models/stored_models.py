"""The models a robot keeps: list them, go back to an earlier one."""

from collections.abc import Sequence

import msgspec

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import Activate, Model, ModelList
from mbot_protocol.wire.keys import ACTIVATE, MODELS
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.key_choice import ChooseKey
from mbot_workstation.fleet.models.push import sign_for_once
from mbot_workstation.wording import one_line

ACTIVATE_TIMEOUT_S = 60.0
"""As with a push, the robot loads the model before it answers."""


class StoredModel(msgspec.Struct, frozen=True):
    """A model that a robot keeps; None where the robot does not know, as of an inactive one."""

    sha256: str
    name: str | None
    size_bytes: int
    decision_rate_hz: float | None
    stored_unix_time_ns: int
    active: bool
    previous: bool
    signed_by: str | None
    proven: bool
    rejected: bool

    @classmethod
    def of(cls, model: Model) -> "StoredModel":
        """As the robot tells it."""
        return cls(
            sha256=model.sha256,
            name=model.name or None,
            size_bytes=model.size_bytes,
            decision_rate_hz=round(model.decision_rate_hz, 3) or None,
            stored_unix_time_ns=model.stored_unix_time_ns,
            active=model.active,
            previous=model.previous,
            signed_by=model.signed_by or None,
            proven=model.proven,
            rejected=model.rejected,
        )

    @property
    def standing(self) -> str:
        """What it is to the robot, in a word or two; empty if it is only kept."""
        if self.active:
            return "active" if self.proven else "active, on trial"
        if self.rejected:
            return "rolled back"
        return "previous" if self.previous else ""


def list_models(link: RobotLink) -> list[Model]:
    """The models the robot keeps; raises as `RobotLink.query`, and RefusedError."""
    return _models(link, link.query(MODELS, None, ModelList))


def newest_named(models: Sequence[StoredModel], name: str) -> StoredModel:
    """Of those that a robot keeps the one that is called that; of several the newest.

    Raises:
        RefusedError: none is.

    """
    called = [model for model in models if model.name == name]
    if not called:
        names = sorted({one_line(model.name) for model in models if model.name})
        raise RefusedError(
            f"the robot keeps no model {name!r}, only {', '.join(names) or 'none'}"
            f"{did_you_mean(name, names)}; `workstation push-model` sends one"
        )
    return max(called, key=lambda model: model.stored_unix_time_ns)


def activate(link: RobotLink, choose_key: ChooseKey, sha256: str = "") -> list[Model]:
    """Make a stored model active, signed like a push; the models afterwards.

    Args:
        link: to the robot.
        choose_key: whose signature; a robot that takes unsigned models needs none.
        sha256: the whole digest or its first 8 or more digits; empty: the previous model.

    Raises:
        RefusedError: no key of ours would do, or the robot says why not: no such model, or it
            does not load.
        UnreachableError, NewerSchemaError, MalformedMessageError: as `RobotLink.query`.

    """
    request = Activate(schema_version=SCHEMA_VERSION, robot_id=link.robot_id, sha256=sha256)
    fitting = [
        model
        for model in list_models(link)
        if (model.sha256.startswith(sha256) if sha256 else model.previous)
    ]
    # Where none or several fit, the robot says so.
    if len(fitting) == 1 and (key := choose_key(link.status())) is not None:
        request.sha256 = fitting[0].sha256
        sign_for_once(link, request, fitting[0].size_bytes, key)
    return _models(link, link.query(ACTIVATE, request, ModelList, ACTIVATE_TIMEOUT_S))


def _models(link: RobotLink, reply: ModelList) -> list[Model]:
    if not reply.accepted:
        raise RefusedError(f"robot {link.robot_id} refused: {one_line(reply.reason)}")
    return list(reply.models)
