"""Try a model in a process of its own before it may come near the motors.

A model that hangs, eats memory or crashes takes that process down, not the daemon.
"""

import resource
import subprocess
import sys
from pathlib import Path

from mbot_protocol.errors import ContractError, MbotError, NewerSchemaError

TIMEOUT_S = 20.0
"""Importing onnxruntime takes 3 to 5 s on a Pi Zero 2 (estimate); a good model then needs ms."""

MEMORY_BYTES = 1 << 30
"""Address space; onnxruntime with the paper's network maps about 350 MB (measured)."""

_CPU_S = 15
_PICTURES = 8


def dry_run(path: Path) -> None:
    """Load a model file in a child process and let it decide on a few pictures.

    Raises:
        ContractError: it does not load, break the contract, takes too long, or answers nonsense.
        NewerSchemaError: it follows a newer contract.

    """
    try:
        child = subprocess.run(
            [sys.executable, "-m", "mbot_agent.dry_run", str(path)],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        raise ContractError(f"the model's dry run took more than {TIMEOUT_S:.0f} s") from None
    if child.returncode == 0:
        return
    if child.returncode < 0:
        raise ContractError(f"the model's dry run was ended by signal {-child.returncode}")
    lines = child.stderr.strip().splitlines() or ["no reason given"]
    if child.returncode == NewerSchemaError.exit_code:
        raise NewerSchemaError(lines[-1])
    raise ContractError(lines[-1])


def _try(path: Path) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (_CPU_S, _CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import numpy as np

    from mbot_agent.policy import Policy
    from mbot_protocol.policy_contract import OBSERVATION_SHAPE

    policy = Policy.load(path)
    random = np.random.default_rng(0)
    for level in (0, 128, 255):
        policy.act(np.full(OBSERVATION_SHAPE[1:], level, np.uint8))
    for _ in range(_PICTURES):
        policy.act(random.integers(0, 256, OBSERVATION_SHAPE[1:], np.uint8))


if __name__ == "__main__":
    try:
        _try(Path(sys.argv[1]))
    except MbotError as reason:
        print(reason, file=sys.stderr)
        sys.exit(reason.exit_code)
    except MemoryError:
        print("the model needs too much memory", file=sys.stderr)
        sys.exit(ContractError.exit_code)
