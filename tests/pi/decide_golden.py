"""Decides on a model's golden frames; prints JSON, with the modules of the daemon it has imported.

`python decide_golden.py CHECKOUT MODEL [SITE]`, on any processor. MBOT_POLICY_ONLY=1 where not all
that the daemon needs is there; else every module of it is imported.
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
    sys.path[:0] = [*sys.argv[3:], str(checkout / "shared/protocol"), str(checkout / "robot")]
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    import mbot_agent
    from mbot_protocol.drive.actions import to_steps
    from mbot_protocol.policy import engine
    from mbot_protocol.policy.policy import Policy
    from mbot_protocol.policy.policy_contract import Memory

    modules = [
        importlib.import_module(found.name).__name__
        for found in pkgutil.walk_packages(mbot_agent.__path__, "mbot_agent.")
        if "MBOT_POLICY_ONLY" not in os.environ
    ]
    policy = Policy.load(checkout / sys.argv[2])
    memory, actions = policy.blank, []
    for frame in policy.golden_frames():
        answer = policy.decide(frame.picture, policy.blank if frame.fresh else memory)
        actions.append((answer.left, answer.right))
        memory = Memory(answer.state, to_steps(*frame.action).action)
    done = {
        "machine": platform.machine(),
        "engine": "OpenCV" if engine.onnxruntime is None else "onnxruntime",
        "modules": modules,
        "actions": actions,
    }
    print(json.dumps(done))


if __name__ == "__main__":
    main()
