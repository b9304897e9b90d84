"""Try a model in a process of its own before it may come near the motors.

A model that hangs, eats memory or crashes takes that process down, not the daemon. It gets the
model through a pipe; from then on the process may compute and nothing else (`confinement.py`).
"""

import contextlib
import math
import os
import resource
import select
import selectors
import subprocess
import sys
import time
from pathlib import Path

import msgspec

from mbot_protocol.errors import ContractError, MbotError, NewerSchemaError, RefusedError

MODEL_S = 6.0
"""What a model may take, unless `models.dry_run_s` says otherwise. Then the child is killed: one
that hangs is refused within 10 s, also where the computer is too busy to start or end a process at
once."""

SLOWNESS = 2.0
"""On a slow or busy computer a model may take so many times what the child's imports took. They
take 0.3 s on a PC, 3 to 5 s on a Pi Zero 2 (estimated)."""

WORK_SHARE = 2 / 3
"""Of that time, as a bound on the model's own work. The slowest model allowed at the robot's usual
rate works 2.8 s on the pictures and three golden frames; one that brings a drive of 80 frames must
be quicker than 40 ms a decision."""

START_S = 30.0
"""The most that the child's imports may take, before it has seen the model."""

READY = b"!"
"""The child's first word, before it reads the model; its report follows."""

MEMORY_BYTES = 128 << 20
"""Address space on top of what Python and onnxruntime map. The largest model allowed (16 MiB) needs
less than 48 MiB, the paper's network less than 8 (measured). With the daemon's 115 MB and the 65
of Python and onnxruntime the unit's MemoryMax of 320 MB is not reached."""

END_S = 1.0
"""A child that has closed its pipes is at its end; so long may that take."""

LONGEST_ANSWER_BYTES = 64 << 10
"""A report has less than 100; what libraries may say besides has lines, not kilobytes."""

LONGEST_REASON = 500
"""Characters of the child's last line: those of onnxruntime have up to 300, paths included."""

SHARE_OF_PERIOD = 0.5
"""The most processor time a decision may take; the rest is the camera's and everybody else's."""

_PICTURES = 8

_ALONE = {"OPENBLAS_NUM_THREADS": "1"}
"""What other threads there are keep what they have when the child is confined."""


class Report(msgspec.Struct, frozen=True):
    """What a dry run has found.

    Attributes:
        inference_ms: processor time of a decision, mean.
        golden_frames: how many the model brings; all were right.
        confined: whether the kernel has kept the process from everything but computing.

    """

    inference_ms: float
    golden_frames: int
    confined: bool = True


def dry_run(data: bytes, rate_hz: float, model_s: float = MODEL_S) -> Report:
    """Load a model in a child process and let it decide on a few pictures.

    Args:
        data: the model file.
        rate_hz: decisions a second that this robot makes.
        model_s: what the model may take, on a computer that is neither slow nor busy.

    Raises:
        ContractError: it does not load, breaks the contract, takes too long, answers nonsense, or
            otherwise than when it was exported.
        NewerSchemaError: it follows a newer contract.
        RefusedError: no process could be started.

    """
    command = [
        sys.executable,
        "-B",
        "-m",
        "mbot_protocol.policy.dry_run",
        repr(rate_hz),
        repr(model_s),
    ]
    pipe = subprocess.PIPE
    try:
        child = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, bufsize=0, env=os.environ | _ALONE
        )
    except OSError as error:
        raise RefusedError(f"cannot try the model: {error.strerror}") from None
    with child:
        limit_s = max(model_s, SLOWNESS * _start(child))
        try:
            out, errors = _exchange(child, data, limit_s)
            child.wait(END_S)
        except subprocess.TimeoutExpired:
            child.kill()
            raise ContractError(
                f"the model's dry run took more than {limit_s:.0f} s (a slow computer may want "
                "more: models.dry_run_s)"
            ) from None
        except BaseException:
            child.kill()
            raise
    if child.returncode < 0:
        raise ContractError(f"the model's dry run was ended by signal {-child.returncode}")
    if child.returncode == 0:
        with contextlib.suppress(msgspec.MsgspecError):
            return msgspec.json.decode(out, type=Report)
    kind = NewerSchemaError if child.returncode == NewerSchemaError.exit_code else ContractError
    raise kind(_reason(errors))


def _exchange(child: "subprocess.Popen[bytes]", data: bytes, limit_s: float) -> tuple[bytes, bytes]:
    """Hand over the model, and hear the child's answer and its errors.

    Not `communicate`: that takes in whatever a model makes the child say, until there is no memory.

    Raises:
        TimeoutExpired: it has not said all in that time.
        ContractError: it says more than any answer is long.

    """
    assert child.stdin is not None
    assert child.stdout is not None
    assert child.stderr is not None
    deadline_s = time.monotonic() + limit_s
    rest, heard = memoryview(data), {child.stdout.fileno(): b"", child.stderr.fileno(): b""}
    os.set_blocking(child.stdin.fileno(), False)
    with selectors.DefaultSelector() as open_pipes:
        open_pipes.register(child.stdin, selectors.EVENT_WRITE)
        open_pipes.register(child.stdout, selectors.EVENT_READ)
        open_pipes.register(child.stderr, selectors.EVENT_READ)
        while open_pipes.get_map():
            left_s = deadline_s - time.monotonic()
            ready = open_pipes.select(left_s) if left_s > 0 else []
            if not ready:
                raise subprocess.TimeoutExpired(child.args, limit_s)
            for key, _ in ready:
                if key.fileobj is child.stdin:
                    rest = rest[_write(key.fd, rest) :]
                    more = len(rest) > 0
                else:
                    piece = os.read(key.fd, LONGEST_ANSWER_BYTES)
                    heard[key.fd] += piece
                    more = len(piece) > 0
                if len(heard.get(key.fd, b"")) > LONGEST_ANSWER_BYTES:
                    raise ContractError("the model's dry run says too much to be an answer")
                if not more:
                    open_pipes.unregister(key.fileobj)
            if not rest:
                child.stdin.close()
    out, errors = heard.values()
    return out, errors


def _write(descriptor: int, rest: memoryview) -> int:
    try:
        return os.write(descriptor, rest)
    except BrokenPipeError:  # it has died: its end says why
        return len(rest)


def _reason(errors: bytes) -> str:
    """The child's last line: for a terminal, and whoever the model's maker may be."""
    lines = errors.decode(errors="replace").strip().splitlines() or ["no reason given"]
    shown = "".join(sign if sign.isprintable() else "?" for sign in lines[-1])
    return shown if len(shown) <= LONGEST_REASON else f"{shown[:LONGEST_REASON]}..."


def _start(child: "subprocess.Popen[bytes]") -> float:
    """Wait until the child is ready for the model, or has died; the seconds it took."""
    assert child.stdout is not None
    began_s = time.monotonic()
    readable, _, _ = select.select([child.stdout], [], [], START_S)
    if not readable:
        child.kill()
        raise RefusedError(
            f"cannot try the model: its process did not start within {START_S:.0f} s"
        )
    os.read(child.stdout.fileno(), len(READY))  # nothing if it has died: its end says why
    return time.monotonic() - began_s


def _try(rate_hz: float, model_s: float) -> Report:
    from random import Random

    import numpy as np

    from mbot_protocol.drive.actions import to_steps
    from mbot_protocol.policy.confinement import confine
    from mbot_protocol.policy.golden_frames import check_deviation
    from mbot_protocol.policy.policy import Policy
    from mbot_protocol.policy.policy_contract import OBSERVATION_SHAPE, Memory

    os.write(sys.stdout.fileno(), READY)
    data = sys.stdin.buffer.read()
    _limit(model_s)
    confined = confine()
    policy = Policy(data)
    golden = policy.golden_frames()
    memory = policy.blank
    for frame in golden:
        answer = policy.decide(frame.picture, policy.blank if frame.fresh else memory)
        left, right = frame.action
        check_deviation(max(abs(answer.left - left), abs(answer.right - right)))
        memory = Memory(answer.state, to_steps(*frame.action).action)
    shape = OBSERVATION_SHAPE[1:]
    pictures = [np.full(shape, level, np.uint8) for level in (0, 128, 255)]
    noise = Random(0)
    pictures += [
        np.frombuffer(noise.randbytes(math.prod(shape)), np.uint8).reshape(shape)
        for _ in range(_PICTURES)
    ]
    # Not process_time: with RLIMIT_CPU set the kernel advances that by whole ticks only.
    began_s = time.thread_time()
    for picture in pictures:
        answer = policy.decide(picture, memory)
        memory = Memory(answer.state, to_steps(answer.left, answer.right).action)
    inference_s = (time.thread_time() - began_s) / len(pictures)
    if inference_s > SHARE_OF_PERIOD / rate_hz:
        raise ContractError(
            f"the model takes {inference_s * 1000:.0f} ms for a decision, expected at most "
            f"{SHARE_OF_PERIOD * 1000 / rate_hz:.0f} ms at {rate_hz:g} decisions/s"
        )
    return Report(inference_s * 1000, len(golden), confined)


def _limit(model_s: float) -> None:
    """Set the limits, once everything that a good model needs is loaded."""
    started_s = time.process_time()
    work_s = WORK_SHARE * max(model_s, SLOWNESS * started_s)
    mapped_bytes = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    for what, limit in (
        (resource.RLIMIT_AS, mapped_bytes + MEMORY_BYTES),
        (resource.RLIMIT_CPU, math.ceil(started_s + work_s)),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (limit, limit))
    # Politeness, which a hardened unit may forbid: decisions first, and if memory runs out all the
    # same, this process goes.
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")
    with contextlib.suppress(OSError):
        os.nice(10)


if __name__ == "__main__":
    try:
        limit_s = float(sys.argv[2]) if len(sys.argv) > 2 else MODEL_S
        sys.stdout.buffer.write(msgspec.json.encode(_try(float(sys.argv[1]), limit_s)))
    except MbotError as reason:
        print(reason, file=sys.stderr)
        sys.exit(reason.exit_code)
    except MemoryError:
        print("the model needs too much memory", file=sys.stderr)
        sys.exit(ContractError.exit_code)
