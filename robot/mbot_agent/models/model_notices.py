"""What a person should know of the robot's models, though it drives."""

import time
from collections.abc import Callable

from mbot_agent.faults import Notice
from mbot_agent.models.activation import Activation
from mbot_agent.models.trust import Trust


def model_notices(
    activation: Activation,
    name_of: Callable[[str], str],
    trust: Trust,
    *,
    has_model: bool,
    unusable: str,
) -> tuple[Notice, ...]:
    """The notices that hold now.

    Args:
        activation: as it is on disk.
        name_of: a stored model's name by its digest; empty if unknown.
        trust: whose models are taken.
        has_model: whether there is one in use.
        unusable: why the active one could not be loaded when the daemon started; empty if it was.

    """
    found: list[Notice] = []
    active = f"{name_of(activation.active) or 'model'} {activation.active[:12]}"
    if trust.accepts_unsigned:
        text = (
            "takes models from anyone who reaches it (trust.allow_unsigned = true): for "
            "development only"
        )
        found.append(Notice("unsigned-models", text))
    elif not trust.keys:
        text = "takes no models: `workstation keys new` makes a key and says how it gets here"
        found.append(Notice("no-trusted-key", text))
    if (rollback := activation.rollback) is not None:
        given_up, successor = (
            f"{name_of(one) or 'model'} {one[:12]}" for one in (rollback.sha256, rollback.successor)
        )
        text = f"{given_up} was rolled back to {successor}: {rollback.reason}"
        found.append(Notice("model-rolled-back", text))
    elif not has_model and (crashes := activation.crashes(activation.active, time.time())):
        text = f"{active} is the only one, and {crashes}: push another one"
        found.append(Notice("model-left-out", text))
    elif not has_model and unusable:
        found.append(Notice("model-unusable", f"{active} cannot be used: {unusable}"))
    return tuple(found)
