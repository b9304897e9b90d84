"""The worker processes of a vectorised environment: started, talked to, ended, watched."""

import contextlib
import itertools
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for_any
from multiprocessing.process import BaseProcess
from typing import NoReturn

from mbot_protocol.errors import MbotError
from mbot_workstation.learn.worlds.shared_arrays import SharedArrays, SharedMemory
from mbot_workstation.learn.worlds.worker import (
    Done,
    Failed,
    Quit,
    Reply,
    Request,
    run_worker,
)
from mbot_workstation.learn.worlds.world_settings import WorldSettings
from mbot_workstation.tasks.find import find_task

QUIT_S = 5.0
"""A worker that has not ended by itself by then is made to; a step takes milliseconds."""


class WorkerError(RuntimeError):
    """A worker has failed by a mistake of ours; its environment is of no more use."""


class WorkerGoneError(MbotError):
    """A worker has gone without a word; likewise."""


@dataclass(frozen=True, slots=True)
class _Worker:
    process: BaseProcess
    pipe: Connection
    robots: range


class WorkerPool:
    """Workers with about equal shares of the robots; close it.

    Attributes:
        arrays: what they share with this process.

    """

    def __init__(self, robots: int, workers: int, settings: WorldSettings) -> None:
        # A fresh interpreter: a forked one would inherit torch's threads and any OpenGL in use.
        context = get_context("spawn")
        memory = SharedMemory.allocate(context, robots, find_task(settings.task))
        self.arrays: SharedArrays = memory.arrays()
        self._workers: list[_Worker] = []
        self._owing: deque[tuple[int, _Worker]] = deque()  # who has not replied yet, to which
        self._asked = 0
        try:
            for share in _shares(robots, workers):
                ours, theirs = context.Pipe()
                process = context.Process(
                    target=run_worker,
                    args=(theirs, memory, share),
                    name=f"robots {share.start} to {share.stop - 1}",
                    daemon=True,
                )
                with _ctrl_c_ignored():
                    process.start()
                theirs.close()
                self._workers.append(_Worker(process, ours, share))
            # Not among the arguments: multiprocessing hands those over by a pipe whose other end it
            # holds too, and megabytes of rooms would wait there for ever if a worker has died.
            for worker in self._workers:
                self._send(worker, settings.task)
                self._send(worker, settings)
            self._owing.extend((self._asked, worker) for worker in self._workers)
            self.wait()  # until all worlds are built
        except BaseException:
            self.close()
            raise

    @property
    def shares(self) -> list[range]:
        """The rows of each worker."""
        return [worker.robots for worker in self._workers]

    def ask(self, requests: Sequence[Request]) -> int:
        """Send each worker its request; they carry out one after another.

        Returns:
            The number to `wait` for.

        """
        self._asked += 1
        for worker, request in zip(self._workers, requests, strict=True):
            self._send(worker, request)
            self._owing.append((self._asked, worker))
        return self._asked

    def wait(self, number: int | None = None) -> list[Done]:
        """Wait until all have done what they were asked, up to this number; all of it when None.

        Returns:
            Their replies to that number.

        Raises:
            WorkerError: one has failed.
            MbotError: likewise, in a way that a person can mend; or it has gone.

        """
        last = self._asked if number is None else number
        replies: list[Done] = []
        while self._owing and self._owing[0][0] <= last:
            worker = self._owing[0][1]
            # The end of the pipe alone does not tell of a worker that died while it started.
            if worker.pipe not in wait_for_any([worker.pipe, worker.process.sentinel]):
                self._raise_gone(worker)
            try:
                reply: Reply = worker.pipe.recv()
            except (EOFError, ConnectionResetError):
                self._raise_gone(worker)
            asked, _ = self._owing.popleft()
            match reply:
                case Done():
                    if asked == last:
                        replies.append(reply)
                case Failed(MbotError() as error):
                    raise error
                case Failed(text):
                    raise WorkerError(f"the worker of {worker.process.name} failed:\n{text}")
        return replies

    def close(self) -> None:
        """End all workers; a second time does nothing."""
        for worker in self._workers:
            with contextlib.suppress(OSError):
                worker.pipe.send(Quit())
        for worker in self._workers:
            worker.process.join(QUIT_S)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
            worker.pipe.close()
            worker.process.close()
        self._workers = []
        self._owing.clear()

    def _send(self, worker: _Worker, message: Request | WorldSettings | str) -> None:
        try:
            worker.pipe.send(message)
        except (BrokenPipeError, ConnectionResetError):
            self._raise_gone(worker)

    def _raise_gone(self, worker: _Worker) -> NoReturn:
        worker.process.join(QUIT_S)
        raise WorkerGoneError(
            f"the worker of {worker.process.name} has gone with exit code "
            f"{worker.process.exitcode}; was it killed, or is memory short?"
        ) from None


@contextlib.contextmanager
def _ctrl_c_ignored() -> Iterator[None]:
    """A process started meanwhile ignores Ctrl-C from its first moment on.

    In a terminal it reaches all processes, and only the one that trains decides what it means.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may change this
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _shares(robots: int, workers: int) -> list[range]:
    """Rows 0 to robots - 1 in as many runs as there are workers, none empty."""
    edges = [round(robots * worker / workers) for worker in range(workers + 1)]
    return [range(start, stop) for start, stop in itertools.pairwise(edges)]
