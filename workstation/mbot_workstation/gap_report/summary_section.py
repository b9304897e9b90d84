"""The top of the page: what a person should know in ten seconds."""

from html import escape

from mbot_workstation.gap_report.elements import paragraph
from mbot_workstation.gap_report.number_words import degrees, metres, percent, seconds
from mbot_workstation.gap_report.report import GapReport
from mbot_workstation.gap_report.verdict import Judged, Word


def summary_section(report: GapReport) -> str:
    """HTML."""
    return "".join(
        [
            f"<h1>How far {escape(report.robot_id)} and its simulation are apart</h1>",
            paragraph(_what(report), "soft"),
            f'<p class="lead">{_lead(report)}</p>',
            f'<div class="tiles">{_tiles(report)}</div>',
            *(
                f"<p><b>{escape(title)}:</b> {escape(words)}.</p>"
                for title, words in verdict_lines(report)
            ),
            _missing(report),
        ]
    )


def _what(report: GapReport) -> str:
    where = ", ".join(report.recordings)
    return (
        f"{report.made_on} · calibration {report.files.folder} · {where}: {report.recorded_runs} "
        f"runs recorded, {report.held_out} of them held out and shown here"
    )


def _lead(report: GapReport) -> str:
    after, before = report.calibrated, report.nominal
    time = seconds(report.driven_s)
    if report.files.motion is None:
        return (
            f"After {time} of driving on the same commands, the nominal simulation is "
            f'<b class="before">{metres(before.position_m)} and {degrees(before.yaw_rad)}</b> '
            "away from the real robot. Its motors have not been identified yet."
        )
    rates = [
        f'<b class="after">{percent(share)}</b> in {what}'
        for share, what in ((after.speed, "speed"), (after.turn, "turn rate"))
        if share is not None
    ]
    at_speed = f"At speed the simulated robot is off by {' and '.join(rates)}. " if rates else ""
    return (
        f"{at_speed}After {time} of driving on the same commands, it is "
        f'<b class="after">{metres(after.position_m)} and {degrees(after.yaw_rad)}</b> away from '
        f"the real one. Without the calibration it would be "
        f'<b class="before">{metres(before.position_m)} and {degrees(before.yaw_rad)}</b>.'
    )


def _tiles(report: GapReport) -> str:
    after, before = report.calibrated, report.nominal
    camera, light = report.files.camera, report.files.light
    time = seconds(report.driven_s)
    tiles = [
        _tile("Steady speed", _rate(after.speed), f"nominal {percent(before.speed)}"),
        _tile("Steady turn rate", _rate(after.turn), f"nominal {percent(before.turn)}"),
        _tile(
            f"Position after {time}",
            metres(after.position_m),
            f"nominal {metres(before.position_m)}",
        ),
        _tile(
            f"Heading after {time}",
            degrees(after.yaw_rad),
            f"of {degrees(report.turned_rad)} turned; nominal {degrees(before.yaw_rad)}",
        ),
        _tile(
            "Heading, of the angle turned",
            _rate(after.turned_share),
            f"nominal {percent(before.turned_share)}",
        ),
        _tile(
            "Camera, reprojection",
            None if camera is None else f"{camera.reprojection_error_px:.2f} px",
            "" if camera is None else f"{camera.pictures} pictures, {camera.width_px} px wide",
        ),
        _tile(
            "Gray card, ΔE 2000",
            None if light is None else f"{light.delta_e_after:.1f}",
            "" if light is None else f"before {light.delta_e_before:.1f}",
        ),
    ]
    return "".join(tiles)


def _rate(share: float | None) -> str | None:
    return None if share is None else percent(share)


def _tile(name: str, value: str | None, was: str) -> str:
    style = "tile" if value is not None else "tile empty"
    shown = "not measured" if value is None else value
    return (
        f'<div class="{style}"><div class="name">{escape(name)}</div>'
        f'<div class="value">{escape(shown)}</div><div class="was">{escape(was)}</div></div>'
    )


def verdict_lines(report: GapReport) -> tuple[tuple[str, str], ...]:
    """Under what condition a policy holds, and how well, in words."""
    if report.tolerances is None:
        why = "nobody knows whether a policy bears that: there is no tolerance map of it yet"
        return (("Verdict", why),)
    before = _sentence([(one, one.uncalibrated.word) for one in report.judged])
    after = _sentence([(one, one.calibrated.word) for one in report.judged])
    return (("Trained on the nominal robot", before), ("Trained on this calibration", after))


def _sentence(words: list[tuple[Judged, Word]]) -> str:
    parts: list[str] = []
    for word in (Word.WILL_NOT_HOLD, Word.BORDERLINE):
        names = [one.quantity.title.lower() for one, found in words if found is word]
        if names:
            verb = "will not hold on" if word is Word.WILL_NOT_HOLD else "borderline on"
            parts.append(f"{verb} {', '.join(names)}")
    fine = sum(found is Word.FINE for _, found in words)
    unknown = sum(found is Word.UNKNOWN for _, found in words)
    if fine:
        parts.append(f"{fine} of {len(words)} fine")
    if unknown:
        parts.append(f"{unknown} not known")
    return ", ".join(parts)


def _missing(report: GapReport) -> str:
    if not report.missing:
        return ""
    items = "".join(
        f"<li>{escape(one.what)}: <code>{escape(one.command)}</code></li>" for one in report.missing
    )
    return f'<div class="missing"><b>Missing here</b><ul>{items}</ul></div>'
