"""Imports every module of the daemon and decides on a model's golden frames; prints JSON.

`python decide_golden.py CHECKOUT [SITE]`, on any processor.
"""

import importlib
import json
import os
import pkgutil
import platform
import sys
from pathlib import Path


def main() -> None:
    checkout = Path(sys.argv[1])
    sys.path[:0] = [*sys.argv[2:], str(checkout / "shared/protocol"), str(checkout / "robot")]
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    import mbot_agent
    from mbot_agent.models.policy import Memory, Policy
    from mbot_protocol.actions import to_steps

    modules = [
        importlib.import_module(found.name).__name__
        for found in pkgutil.walk_packages(mbot_agent.__path__, "mbot_agent.")
    ]
    policy = Policy.load(checkout / "models/red-cube.onnx")
    memory, actions = policy.blank, []
    for frame in policy.golden_frames():
        answer = policy.decide(frame.picture, policy.blank if frame.fresh else memory)
        actions.append((answer.left, answer.right))
        memory = Memory(answer.state, to_steps(*frame.action).action)
    print(json.dumps({"machine": platform.machine(), "modules": modules, "actions": actions}))


if __name__ == "__main__":
    main()
