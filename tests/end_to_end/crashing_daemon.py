"""The real daemon, but a model named "crasher" takes the whole process down with its first answer.

What a bug in the inference library would do. The dry run's child process is not affected, as with a
bug that depends on the daemon's other threads.
"""

import os

from mbot_agent import main
from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy import policy
from mbot_protocol.policy.policy_contract import Memory

_decide = policy.Policy.decide


def _crash(self: policy.Policy, observation: Picture, memory: Memory) -> policy.Answer:
    if self.metadata.name == "crasher":
        os.abort()
    return _decide(self, observation, memory)


if __name__ == "__main__":
    policy.Policy.decide = _crash
    main.main()
