"""What the policy bears, quantity by quantity, and where this robot is."""

import math
from collections.abc import Callable
from html import escape

from mbot_workstation.gap_report.bearable import Bearable
from mbot_workstation.gap_report.elements import figure, paragraph
from mbot_workstation.gap_report.quantity import Quantity
from mbot_workstation.gap_report.report import GapReport
from mbot_workstation.gap_report.svg import COLOURS
from mbot_workstation.gap_report.tolerance_plot import tolerance_plot
from mbot_workstation.gap_report.verdict import HALF_WAY, Judged, Verdict, Word

STYLES = {
    Word.FINE: "fine",
    Word.BORDERLINE: "borderline",
    Word.WILL_NOT_HOLD: "fails",
    Word.UNKNOWN: "unknown",
}


def verdict_section(report: GapReport) -> str:
    """HTML."""
    known = {one.quantity.deviation: one.quantity for one in report.judged}
    maps = report.tolerances.maps if report.tolerances is not None else ()
    plots = "".join(
        figure(tolerance_plot(number, one, report.tolerances, known), "")
        for number, one in enumerate(maps)
        if report.tolerances is not None
    )
    return "".join(
        [
            "<h2>Will a policy hold?</h2>",
            paragraph(_explanation(report), "soft"),
            '<div class="verdict head"><div>quantity</div><div>what the policy bears</div>'
            "<div>trained on the nominal robot</div><div>trained on this calibration</div></div>",
            *(_row(one) for one in report.judged),
            f'<div class="charts wide">{plots}</div>' if plots else "",
        ]
    )


def _explanation(report: GapReport) -> str:
    if report.tolerances is None:
        return (
            "No tolerance map: deviations are shown without a verdict. `workstation study "
            "tolerance POLICY.onnx -o FOLDER` tries the policy on robots that are off by more and "
            "more, and writes FOLDER/tolerance.json for --tolerance."
        )
    one = report.tolerances
    return (
        f"How {one.contestant} fares on robots that are off ({one.how}): it bears a deviation as "
        f"long as {100 * one.bearable_share:.0f} % of its reward {one.nominal_reward:.1f} is left "
        f"(green). Fine: at most {100 * HALF_WAY:.0f} % of the way to the border. Borderline: up "
        "to the border, or beyond the end of the map. Will not hold: beyond the border. Each "
        "quantity by itself; what several do together is on the maps."
    )


def _row(one: Judged) -> str:
    return (
        f'<div class="verdict"><h3>{escape(one.quantity.title)}</h3>'
        f'<div class="bar">{_bar(one)}</div>'
        f'<div><span class="label">trained on the nominal robot</span>'
        f"{_cell(one.quantity, one.uncalibrated)}</div>"
        f'<div><span class="label">trained on this calibration</span>'
        f"{_cell(one.quantity, one.calibrated)}</div>"
        f'<div class="why">{escape(one.quantity.source)}</div></div>'
    )


def _cell(quantity: Quantity, verdict: Verdict) -> str:
    amount = ""
    if verdict.value is not None:
        amount = f'<span class="amount">{escape(quantity.words(verdict.value))}</span>'
    words = verdict.why if verdict.word is Word.UNKNOWN else verdict.word.value
    pill = f'<span class="pill {STYLES[verdict.word]}">{escape(words)}</span>'
    detail = ""
    if verdict.used is not None and verdict.reward_share is not None:
        beyond = f", {verdict.why}" if verdict.why else ""
        way = f"{100 * verdict.used:.0f} % of the way to the border, "
        if math.isinf(verdict.used):
            way = "none of it is borne, "
        left = f"{100 * verdict.reward_share:.0f} % of the reward{beyond}"
        detail = f'<div class="detail">{escape(way + left)}</div>'
    return f"{amount}{pill}{detail}"


def _bar(one: Judged) -> str:
    """The map's range as a line, what is borne as a green bar, the robot as dots."""
    borne = one.borne
    if borne is None:
        return '<span class="detail">no tolerance map</span>'
    first, last = float(borne.values[0]), float(borne.values[-1])

    def place(value: float) -> float:
        return 100 * (min(max(value, first), last) - first) / (last - first)

    low, high = place(borne.low), place(borne.high)
    parts = [
        '<line x1="0" x2="100%" y1="12" y2="12" stroke="#d4d4d8" stroke-width="2"/>',
        f'<rect x="{low:.2f}%" width="{high - low:.2f}%" y="7" height="10" rx="2" fill="#b9dcc4"/>',
        f'<line x1="{place(borne.nominal):.2f}%" x2="{place(borne.nominal):.2f}%" y1="4" y2="20" '
        'stroke="#71717a"/>',
    ]
    dots = (
        (one.uncalibrated.value, COLOURS["nominal"]),
        (one.calibrated.value, COLOURS["calibrated"]),
    )
    for value, colour in dots:
        if value is not None:
            parts.append(
                f'<circle cx="{place(value):.2f}%" cy="12" r="5" fill="{colour}" stroke="#fff"/>'
            )
    parts.append(_end(one.quantity, borne, place))
    words = f"bearable from {one.quantity.words(borne.low)} to {one.quantity.words(borne.high)}"
    return f'<svg role="img" aria-label="{escape(words)}">{"".join(parts)}</svg>'


def _end(quantity: Quantity, borne: Bearable, place: Callable[[float], float]) -> str:
    """Both borders in words, below the ends of the green bar."""
    ends = ((borne.low, borne.ends_low, "end"), (borne.high, borne.ends_high, "start"))
    texts: list[str] = []
    for value, is_end, anchor in ends:
        words = ("beyond " if is_end else "") + quantity.words(value)
        # Away from the bar, so that the two never meet; but not out of the page.
        inside = "start" if place(value) < 20 else "end" if place(value) > 80 else anchor
        texts.append(
            f'<text x="{place(value):.2f}%" y="31" text-anchor="{inside}" font-size="11" '
            f'fill="#52525b">{escape(words)}</text>'
        )
    return "".join(texts)
