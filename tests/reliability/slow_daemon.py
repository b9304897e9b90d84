"""The real daemon, but while the file `slow` is beside its configuration a decision takes 2 s.

As with a processor that is too hot, or a library that waits for a lock. Each slow decision writes
the monotonic time of its beginning, and of the one before it, into that file.
"""

import sys
import time
from pathlib import Path

from mbot_agent import main
from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy import policy

SLOW_S = 2.0

_decide = policy.Policy.decide
_switch = Path(sys.argv[sys.argv.index("--config") + 1]).with_name("slow")
_began_s = 0.0


def _dawdle(self: policy.Policy, observation: Picture, memory: policy.Memory) -> policy.Answer:
    global _began_s
    before_s, _began_s = _began_s, time.monotonic()
    if _switch.exists():
        _switch.write_text(f"{before_s} {_began_s}")
        time.sleep(SLOW_S)
    return _decide(self, observation, memory)


if __name__ == "__main__":
    policy.Policy.decide = _dawdle
    main.main()
