"""The report as one HTML page that needs nothing else, and as the lines that are printed."""

import base64
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import jinja2
import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_workstation.measure.calibration.camera.camera_quality import view_deg
from mbot_workstation.measure.gap_report import plots
from mbot_workstation.measure.gap_report.compare import CALIBRATED, NOMINAL, PATHS, SETTLED_S
from mbot_workstation.measure.gap_report.figures import Driving, at_end, path_error
from mbot_workstation.measure.gap_report.report import GapReport
from mbot_workstation.measure.gap_report.verdict import HALF_WAY, Word
from mbot_workstation.measure.identification.exclusion import grouped
from mbot_workstation.pictures.picture_file import encode_picture
from mbot_workstation.sim.body.parameter_table import PARAMETERS, value
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration, motion_value
from mbot_workstation.sim.effects.presets import KNOWN
from mbot_workstation.wording import degrees, metres, percent, seconds

JPEG_QUALITY = 88


def page(report: GapReport) -> str:
    """The whole page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    filters = (metres, degrees, percent, seconds, way, light_from, data_uri)
    environment.filters |= {one.__name__: one for one in filters}
    files = report.files
    return environment.get_template("page.html").render(
        **{"report": report, "driving": report.driving, "files": files, "plots": plots},
        **{"HALF_WAY": HALF_WAY, "SETTLED_S": SETTLED_S},
        known={one.quantity.deviation: one.quantity for one in report.judged},
        worst=worst(report),
        verdict_lines=verdict_lines(report),
        left_out=grouped(report.excluded),
        turned_deg=math.degrees(report.driving.turned_rad),
        end_rows=end_rows(report.driving),
        rate_rows=list(rate_rows(report.driving)),
        lens=lens_rows(files.camera.model()) if files.camera else (),
        parameters=parameter_rows(files.motion) if files.motion else (),
        undetermined=undetermined_rows(files.motion) if files.motion else (),
        drawings={name: drawing(Path(files.folder) / name) for name in ("camera.png", "light.png")},
    )


def printed(report: GapReport) -> Iterator[str]:
    """What the command says."""
    after, before = report.driving.calibrated, report.driving.nominal
    if after.speed_share is not None and after.turn_share is not None:
        yield (
            f"at speed the calibrated simulation is off by {percent(after.speed_share)} in speed "
            f"and {percent(after.turn_share)} in turn rate, the nominal one by "
            f"{percent(before.speed_share)} and {percent(before.turn_share)}"
        )
    yield (
        f"{len(report.driving.runs)} held-out runs; after {seconds(report.driving.driven_s)} the "
        f"calibrated simulation is {metres(after.position_m)} and {degrees(after.yaw_deg)} off "
        f"(medians), the nominal one {metres(before.position_m)} and {degrees(before.yaw_deg)}"
    )
    if after.turned_share is not None:
        yield (
            f"of runs that turn, the heading is off by {percent(after.turned_share)} of the angle "
            f"turned, nominal {percent(before.turned_share)}"
        )
    if report.files.motion and report.driving.not_helped:
        yield f"the calibration did not help with {', '.join(report.driving.not_helped)}"
    yield from (f"{title}: {words}" for title, words in verdict_lines(report))
    yield from (f"left out: {line}" for line in grouped(report.excluded))
    yield from (f"missing: {one.what}: {one.command}" for one in report.missing)


def worst(report: GapReport) -> Word | None:
    """The worst verdict on a policy as it is, of quantities that are known; None without any."""
    words = [one.uncalibrated.verdict for one in report.judged]
    order = (Word.WILL_NOT_HOLD, Word.BORDERLINE, Word.FINE)
    return next((word for word in order if word in words), None)


def verdict_lines(report: GapReport) -> tuple[tuple[str, str], ...]:
    """Under what condition a policy holds, and how well, in words."""
    if report.tolerances is None:
        why = "nobody knows whether a policy bears that: there is no tolerance map of it yet"
        return (("Verdict", why),)
    before = _sentence([(one.quantity.title, one.uncalibrated.verdict) for one in report.judged])
    after = _sentence([(one.quantity.title, one.calibrated.verdict) for one in report.judged])
    whose = f"{report.tolerances.contestant} in simulated homes"
    homes = [(whose, one.words) for one in report.tolerances.mistakes]
    return (
        ("Trained on the nominal robot", before),
        ("Trained on this calibration", after),
        *homes,
    )


def _sentence(judged: Sequence[tuple[str, Word]]) -> str:
    names = {word: [title.lower() for title, found in judged if found is word] for word in Word}
    fine, unknown = len(names[Word.FINE]), len(names[Word.UNKNOWN])
    parts = (
        (names[Word.WILL_NOT_HOLD], f"will not hold on {', '.join(names[Word.WILL_NOT_HOLD])}"),
        (names[Word.BORDERLINE], f"borderline on {', '.join(names[Word.BORDERLINE])}"),
        (fine, f"{fine} of {len(judged)} fine"),
        (unknown, f"{unknown} not known"),
    )
    return ", ".join(words for is_so, words in parts if is_so)


def way(maneuver: str) -> str:
    """Which way a robot goes whose motors are told this, such as "turns left on the spot"."""
    left, _, right = maneuver.partition("-")
    if left == right:
        return "straight ahead" if left == "forward" else "straight back"
    if "neutral" not in (left, right):
        return f"turns {'right' if left == 'forward' else 'left'} on the spot"
    standing = "left" if left == "neutral" else "right"
    return f"{'ahead' if 'forward' in maneuver else 'back'}, round its {standing} wheel"


def data_uri(pixels: Picture) -> str:
    """A picture as an address inside the page; small ones exactly."""
    kind = "png" if pixels.shape[1] <= 128 else "jpeg"
    encoded = encode_picture(pixels, ".png" if kind == "png" else ".jpg", JPEG_QUALITY)
    return f"data:image/{kind};base64,{base64.b64encode(encoded).decode()}"


def drawing(path: Path) -> str | None:
    """What `calibrate` drew as an address inside the page, if it is still there."""
    if not path.is_file():
        return None
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"


def end_rows(driving: Driving) -> Iterator[tuple[str, ...]]:
    """Errors at the end of each maneuver, the middle ones of all repetitions."""
    for name, runs in driving.maneuvers.items():
        errors = [path_error(runs, path) for path in (CALIBRATED, NOMINAL)]
        places_m, turns_rad = zip(*(at_end(error) for error in errors), strict=True)
        turns = (degrees(math.degrees(turn)) for turn in turns_rad)
        yield name, seconds(float(errors[0].time_s[-1])), *map(metres, places_m), *turns


def rate_rows(driving: Driving) -> Iterator[tuple[str, ...]]:
    """Mean steady speeds and turn rates of each maneuver."""
    for name, runs in driving.maneuvers.items():
        if steady := [run for run in runs if run.is_steady]:
            rates = [[run.rate(path) for run in steady] for path in PATHS]
            speeds = (np.mean([one.speed_mps for one in some]) for some in rates)
            turns = (np.degrees(np.mean([one.turn_radps for one in some])) for some in rates)
            words = (f"{speed:+z.4f}" for speed in speeds)
            yield name, *words, *(f"{turn:+z.2f}" for turn in turns)


def lens_rows(lens: CameraModel) -> Iterator[tuple[str, ...]]:
    """A calibrated lens beside the data sheet's."""
    both = lens, RobotParameters().camera.scaled_to(lens.width_px, lens.height_px)
    for place, axis in enumerate(("across", "down")):
        yield f"field of view, {axis}", *(f"{view_deg(one)[place]:.2f}°" for one in both)
    right = [one.principal_x_px - (one.width_px - 1) / 2 for one in both]
    down = [one.principal_y_px - (one.height_px - 1) / 2 for one in both]
    axes = (f"{x:+.1f}, {y:+.1f} px" for x, y in zip(right, down, strict=True))
    yield "optical axis from the middle", *axes
    numbers = ([f"{one.distortion[place]:+.3f}" for place in (0, 1, 4)] for one in both)
    yield "distortion k1, k2, k3", *map(", ".join, numbers)


def parameter_rows(motion: MotionCalibration) -> Iterator[tuple[str, ...]]:
    """Identified parameters with their 95 % intervals, beside the nominal ones."""
    nominal = RobotParameters()
    rows = [
        (
            one.words,
            one.file_key,
            found,
            value(nominal, one.name),
            one.shown_factor,
            one.file_factor,
        )
        for one in PARAMETERS
        if (found := motion_value(motion, one)) is not None
    ]
    latency = (motion.latency_ms, KNOWN.action_latency_ms)
    rows.append(("latency [ms]", "latency_ms", *latency, 1.0, 1.0))
    for words, key, found, usual, shown, in_file in rows:
        interval = motion.intervals.get(key)
        ends = [shown / in_file * end for end in (interval.low, interval.high)] if interval else []
        between = " to ".join(f"{end:.4g}" for end in ends)
        yield words, f"{shown * found:.4g}", between, f"{shown * usual:.4g}"


def undetermined_rows(motion: MotionCalibration) -> list[tuple[str, str]]:
    """What the recordings can't tell, and why; one row a reason."""
    words = {one.file_key: one.words for one in PARAMETERS}
    reasons: dict[str, list[str]] = {}
    for key, why in motion.undetermined.items():
        reasons.setdefault(why, []).append(words.get(key, key))
    return [(", ".join(names), why) for why, names in reasons.items()]


def light_from(direction: Sequence[float]) -> str:
    """Where light comes from that goes this way."""
    x, y, z = np.array(direction) / np.linalg.norm(direction)
    side_deg = math.degrees(math.atan2(-y, -x))
    where = f"{abs(side_deg):.0f}° to the {'left' if side_deg > 0 else 'right'}"
    return f"{math.degrees(math.asin(-z)):z.0f}° above the horizon, {where}"
