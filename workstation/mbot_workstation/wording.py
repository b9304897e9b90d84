"""How values are written for people: lengths and shares, digests, texts from the wire."""

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from mbot_protocol.drive.senses import Senses

if TYPE_CHECKING:  # loading messages takes longer than `--help` may
    from mbot_protocol.v1 import messages_pb2
    from mbot_protocol.v1.messages_pb2 import Decision, Fault, Status

LONGEST_TEXT = 400
"""Longer texts from the wire are cut: an error is one line a person reads."""


def one_line(text: str) -> str:
    """A text from the wire, made safe to print: one line, no control characters, not endless.

    Without this a broken or hostile sender could move the cursor or recolour the terminal.
    """
    printable = "".join(c if c.isprintable() else " " for c in text[: LONGEST_TEXT + 1])
    words = " ".join(printable.split())
    return words if len(words) <= LONGEST_TEXT else words[: LONGEST_TEXT - 1] + "…"


def typed(path: Path | str) -> str:
    """A file or folder as it is typed in a command that is printed to be copied."""
    return shlex.quote(str(path))


def metres(value_m: float) -> str:
    """Such as 4 mm, 3.2 cm or 1.31 m."""
    if value_m < 0.01:
        return f"{value_m * 1000:.1f} mm"
    return f"{value_m * 100:.1f} cm" if value_m < 1 else f"{value_m:.2f} m"


def degrees(value_deg: float) -> str:
    """Such as 0.8° or 123°."""
    return f"{value_deg:.1f}°" if value_deg < 10 else f"{value_deg:.0f}°"


def percent(share: float | None) -> str:
    """Such as 0.31 % or 12 %."""
    if share is None:
        return "not known"
    value = 100 * share
    return f"{value:.{0 if value >= 10 else 1 if value >= 1 else 2}f} %"


def seconds(value_s: float) -> str:
    """Such as 10 s."""
    return f"{value_s:.3g} s"


def short_digest(sha256: str) -> str:
    """The first 12 digits of a digest: enough to tell models apart, and for a roll-back."""
    return one_line(sha256)[:12] or "none"


def computer_words(decision: "Decision") -> str:
    """How the robot's computer is, as far as it tells: "52 °C, load 0.75, 200 MiB"."""
    known: list[str] = []
    if decision.HasField("cpu_temperature_c"):
        known.append(f"{decision.cpu_temperature_c:.0f} °C")
    if decision.HasField("load_1min"):
        known.append(f"load {decision.load_1min:.2f}")
    if decision.HasField("resident_memory_bytes"):
        known.append(f"{decision.resident_memory_bytes / 2**20:.0f} MiB")
    if decision.under_voltage:
        known.append("under-voltage: check battery and cable")
    return ", ".join(known)


def senses_words(told: "messages_pb2.Senses") -> str:
    """What a board feels, and whether it holds the robot back."""
    supply_v = told.supply_v if told.HasField("supply_v") else None
    floor = (told.floor_1, told.floor_2)
    senses = Senses(told.distance_m, floor, told.edge, told.obstacle, supply_v)
    held = "; it holds back" if told.edge or told.obstacle else ""
    return senses.words + held


def size_words(size_bytes: int) -> str:
    """A file's size: "4.6 kB", "2.41 MB"."""
    return f"{size_bytes / 1e3:.1f} kB" if size_bytes < 1e6 else f"{size_bytes / 1e6:.2f} MB"


class Told(Protocol):
    """A fault or notice, as the robot tells it."""

    @property
    def kind(self) -> str:
        """A slug."""
        ...

    @property
    def detail(self) -> str:
        """What was found and what to do."""
        ...


def fault_lines(faults: Iterable[Told]) -> list[str]:
    """Each fault or notice in one line: kind, what was found, what to do."""
    return [f"{one_line(fault.kind)}: {one_line(fault.detail)}" for fault in faults]


_MENDED = {
    "link-lost": "a workstation is connected",
    "model-failed": "it has another model",
    "no-model": "it has a model",
}
_DEVICE_MENDED = {"lost": "is back", "stalled": "is back", "starting": "is ready"}


def waiting_words(faults: "Sequence[Fault]") -> str:
    """What an armed robot that stands is waiting for, and the faults behind it."""
    if not faults:
        return "it does not drive yet, and reports no fault"
    mended = dict.fromkeys(_mended(one_line(fault.kind)) for fault in faults)
    return f"it drives when {' and '.join(mended)} ({'; '.join(fault_lines(faults))})"


def _mended(kind: str) -> str:
    device, _, what = kind.partition("-")
    if device in ("board", "camera"):
        return f"the {device} {_DEVICE_MENDED.get(what, 'is in order')}"
    return _MENDED.get(kind, "that is mended")


def standing_words(status: "Status") -> str:
    """Why a robot stands that is `stopped`, and since when: a hand has let go, or a stop."""
    if not status.let_go_monotonic_ns:
        return stop_words(status)
    ago_s = max(0.0, (status.now_monotonic_ns - status.let_go_monotonic_ns) / 1e9)
    return f"the hand let go {duration(ago_s)} ago"


def stop_words(status: "Status") -> str:
    """Who or what has stopped a robot last, and how long before it said so."""
    stop = status.last_stop
    if not stop.monotonic_ns:
        return "not stopped since its start"
    ago_s = max(0.0, (status.now_monotonic_ns - stop.monotonic_ns) / 1e9)
    if stop.why:
        return f"stopped {duration(ago_s)} ago ({one_line(stop.why)})"
    return f"stopped by {one_line(stop.by) or 'somebody'} {duration(ago_s)} ago"


def duration(value_s: float) -> str:
    """Such as 0.4 s, 12 s, 3 min or 5 h."""
    if value_s < 100:
        return f"{value_s:.{1 if value_s < 10 else 0}f} s"
    return f"{value_s / 60:.0f} min" if value_s < 6000 else f"{value_s / 3600:.0f} h"
