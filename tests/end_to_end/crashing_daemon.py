"""The real daemon, but a model named "crasher" takes the whole process down with its first answer.

What a bug in the inference library would do. The dry run's child process is not affected, as with a
bug that depends on the daemon's other threads.
"""

import os

from mbot_agent import main
from mbot_agent.models import policy
from mbot_protocol.picture import Picture

_act = policy.Policy.act


def _crash(self: policy.Policy, observation: Picture) -> tuple[float, float]:
    if self.metadata.name == "crasher":
        os.abort()
    return _act(self, observation)


if __name__ == "__main__":
    policy.Policy.act = _crash
    main.main()
