"""Ends of the process that nobody planned: the motors are stopped before anything else.

Signals: a thread waits for them. Python runs ordinary signal handlers only between bytecodes of the
main thread: behind a 2.5 s inference that took 2.2 s; a waiting thread took 1 ms (measured).

Exceptions that end a thread: a daemon with a thread missing looks alive and is not.
"""

import logging
import os
import signal
import threading
from collections.abc import Callable

log = logging.getLogger(__name__)

SIGNALS = frozenset({signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT})
"""What a service manager, a person at a terminal, and a terminal that is closed may send."""

THREAD_DIED = 70
"""Exit code, as for an internal error (sysexits.h: EX_SOFTWARE)."""


def block_signals() -> None:
    """Keep the signals for `watch`. Call it before any thread starts: they inherit the mask."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)


def watch(stop_motors: Callable[[], bool], closing: threading.Event) -> None:
    """Start the thread. On the first signal it calls `stop_motors`, then sets `closing`.

    Args:
        stop_motors: says whether the board has confirmed it.
        closing: what the daemon waits for.

    """

    def wait() -> None:
        number = signal.sigwait(SIGNALS)
        log.info("%s: %s, closing down", signal.Signals(number).name, _stopped(stop_motors()))
        closing.set()

    threading.Thread(target=wait, name="signals", daemon=True).start()


def _stopped(confirmed: bool) -> str:
    return "motors stopped" if confirmed else "no board has confirmed that the motors stand"


def end_with_any_thread(stop_motors: Callable[[], bool], last_words: Callable[[], None]) -> None:
    """From now on an exception that ends any thread ends the process, motors first."""

    def fell_over(arguments: threading.ExceptHookArgs) -> None:
        name = arguments.thread.name if arguments.thread is not None else "?"
        try:
            log.critical(
                "the thread %r died: %s, ending",
                name,
                _stopped(stop_motors()),
                exc_info=(
                    arguments.exc_type,
                    arguments.exc_value or arguments.exc_type(),
                    arguments.exc_traceback,
                ),
            )
            last_words()
        finally:
            os._exit(THREAD_DIED)

    threading.excepthook = fell_over
