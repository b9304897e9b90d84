"""The real daemon at 100 decisions a second, five times what its configuration may say."""

import msgspec

from mbot_agent import configuration, main
from mbot_agent.configuration import Configuration

RATE_HZ = 100.0

_decode = configuration.decode


def _hasten(text: str, origin: str) -> Configuration:
    found = _decode(text, origin)
    control = msgspec.structs.replace(found.control, decision_rate_hz=RATE_HZ)
    return msgspec.structs.replace(found, control=control)


if __name__ == "__main__":
    configuration.decode = _hasten
    main.main()
