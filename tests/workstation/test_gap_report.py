"""The gap report as a whole: `gap_report.report`, `gap_report.page` and the command."""

import json
import math
import re
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.identify import gap_report
from mbot_workstation.cli.presenter import plain
from mbot_workstation.learn.studies.tolerance_file import write_tolerances
from mbot_workstation.measure.gap_report.answer import gap_answer
from mbot_workstation.measure.gap_report.page import light_from, page, way
from mbot_workstation.measure.gap_report.simulated_view import FramePair
from mbot_workstation.measure.identification.exclusion import Exclusion, Fault
from mbot_workstation.measure.tracks.maneuver import MANEUVERS, maneuver_named
from mbot_workstation.measure.tracks.recording_folder import write_maneuvers
from mbot_workstation.sim.body.parameter_table import PARAMETERS
from mbot_workstation.sim.calibrated.calibration_folder import (
    CalibrationFiles,
    write_body,
    write_camera,
    write_light,
    write_motion,
)
from mbot_workstation.sim.calibrated.motion_calibration import motion_value

from .calibrations import BODY, CAMERA, LIGHT, MOTION
from .called import output_of
from .driven_robot import session
from .gap_samples import FITTED, TRUE, compared_runs, report, tolerances

ALL = CalibrationFiles(
    folder="calibration/mbot-1", camera=CAMERA, motion=MOTION, body=BODY, light=LIGHT
)
ONLY_MOTION = CalibrationFiles(folder="calibration/mbot-1", motion=MOTION)


class Page(HTMLParser):
    """What of a page matters here."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.headings: list[str] = []
        self.words: list[str] = []
        self._in_heading = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self._in_heading = tag == "h3"
        for name, value in attrs:
            if name in ("src", "href", "srcset", "data", "action", "xlink:href") and value:
                self.links.append(value)

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if self._in_heading:
            self.headings.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.mark.slow
def test_the_page_shows_every_maneuver_and_needs_no_other_file() -> None:
    text = page(report(compared_runs(), ALL, tolerances()))
    shown = Page(text)
    for maneuver in MANEUVERS:
        assert shown.headings.count(maneuver.name) == 2  # path and error
    assert not {"script", "link", "iframe", "object"} & set(shown.tags)
    assert all(link.startswith(("data:", "#")) for link in shown.links)
    assert not re.search(r"https?://|@import|url\((?!#)", text)
    assert len(text.encode()) < 5e6
    charts = [link for link in shown.links if link.startswith("data:image/svg+xml")]
    assert len(charts) == 8 + 8 + 1 + 1
    assert all(words.strip() for words in re.findall(r'<img[^>]* alt="([^"]*)"', text))
    assert text.index("At speed the simulated robot is off by") < text.index(
        "of driving on the same"
    )
    tiles = ("Steady speed", "Steady turn rate", "Position off after", "Verdict on red-cube")
    places = [text.index(words) for words in tiles]
    assert places == sorted(places)
    assert places[-1] < text.index("Heading off after")
    for maneuver in MANEUVERS:
        assert text.count(way(maneuver.name)) == 2


def test_the_same_data_make_the_same_page() -> None:
    one = report(compared_runs(MANEUVERS[:2], 1), ONLY_MOTION)
    assert page(one) == page(one)


def test_a_known_gap_is_what_the_page_says() -> None:
    driven_ones = MANEUVERS[:2]
    runs = compared_runs(driven_ones, offset=(0.03, -0.04, math.radians(2)))
    result = report(runs, ALL, tolerances())
    found = plain(gap_answer(result, "gap.html"))
    assert found["calibrated"]["position_m"] == pytest.approx(0.05)
    assert found["calibrated"]["worst_position_m"] == pytest.approx(0.05)
    assert found["calibrated"]["yaw_deg"] == pytest.approx(2)
    assert found["calibrated"]["speed_share"] == pytest.approx(0, abs=1e-3)
    assert found["held_out_runs"] == 4
    assert found["after_s"] == pytest.approx(4)
    for maneuver in driven_ones:
        errors = found["maneuvers"][maneuver.name]["calibrated"]
        assert errors["position_m"] == pytest.approx([0.05, 0.05])
        assert errors["yaw_deg"] == pytest.approx([2, 2])
    json.dumps(found, allow_nan=False)
    shown = Page(page(result)).text
    turned = np.mean([abs(run.measured[-1, 2] - run.measured[0, 2]) for run in runs])
    assert found["turned_deg"] == pytest.approx(math.degrees(turned))
    assert "5.0 cm and 2.0°" in shown
    assert f"of {math.degrees(turned):.0f}° turned" in shown
    assert f"{CAMERA.reprojection_error_px:.2f} px" in shown
    assert f"{LIGHT.delta_e_after:.1f}" in shown
    assert f"before {LIGHT.delta_e_before:.1f}" in shown


def test_runs_that_are_too_short_for_a_speed_say_none() -> None:
    result = report(compared_runs(MANEUVERS[:1], 1, duration_s=0.9), ONLY_MOTION)
    assert gap_answer(result, "gap.html").maneuvers["forward-forward"].rates == []
    assert result.driving.calibrated.speed_share is None
    assert "No run is long enough" in Page(page(result)).text


def test_the_page_gives_both_verdicts_in_words() -> None:
    # Asymmetry 10 % and a track 4 % wider than nominal; both exactly as fitted.
    names = ("forward-forward", "backward-forward")
    runs = compared_runs([maneuver_named(name) for name in names], 1, true=TRUE, fitted=FITTED)
    shown = Page(page(report(runs, ALL, tolerances()))).text
    assert "Trained on the nominal robot: will not hold on gain asymmetry" in shown
    assert "borderline on track" in shown
    assert "Trained on this calibration: 2 of 7 fine" in shown


def test_what_is_missing_is_said_with_the_command_that_makes_it() -> None:
    runs = compared_runs([maneuver_named("forward-forward")])
    empty = CalibrationFiles(folder="calibration/mbot-1")
    shown = Page(page(report(runs, empty))).text
    for command in (
        "workstation calibrate body COMPONENTS.toml --calibration calibration/mbot-1",
        "workstation calibrate camera PHOTOS --calibration calibration/mbot-1",
        "workstation calibrate light PHOTOS --calibration calibration/mbot-1",
        "workstation panorama PHOTO.jpg --calibration calibration/mbot-1",
        "workstation identify recordings/mbot-1 --calibration calibration/mbot-1",
        "--maneuver backward-backward",
        "workstation study tolerance POLICY.onnx",
        "--frames FOLDER",
    ):
        assert command in shown
    assert shown.count("not measured") >= 2  # lens and light
    assert "no tolerance map" in shown


def test_words_from_files_are_no_html() -> None:
    excluded = {"run <b>": Exclusion(Fault.ODD_MOTOR, "a & b")}
    text = page(report(compared_runs(MANEUVERS[:1], 1), ONLY_MOTION, excluded=excluded))
    assert "run &lt;b&gt;: a &amp; b" in text
    assert "run <b>" not in text


def test_frames_stand_side_by_side() -> None:
    real = np.full((48, 64, 3), 100, np.uint8)
    pair = FramePair("frame <1>", real, real + 10, real + 40)
    text = page(report(compared_runs(MANEUVERS[:1], 1), ONLY_MOTION, frames=(pair,)))
    shown = Page(text)
    assert shown.tags.count("img") == 3 + 3  # three charts: path, errors, rates
    assert "10.0 of 255 levels" in shown.text
    assert "40.0 of 255 levels" in shown.text
    assert "frame &lt;1&gt;" in text


def test_without_motors_the_page_says_so() -> None:
    unknown = CalibrationFiles("calibration/mbot-1", CAMERA)
    shown = Page(page(report(compared_runs(MANEUVERS[:1], 1), unknown))).text
    assert "Its motors have not been identified yet" in shown
    assert "None yet; the command is named at the top." in shown


def test_every_parameter_that_the_file_has_is_shown() -> None:
    shown = Page(page(report(compared_runs(MANEUVERS[:1], 1), ALL))).text
    known = [one for one in PARAMETERS if motion_value(MOTION, one) is not None]
    assert len(known) > 10
    for one in known:
        assert one.words in shown
    assert "1.05 to 1.07" in shown
    assert "free speed [rpm] scales with both gains" in shown
    assert "latency [ms] 35 15" in shown


def test_where_nothing_was_gained_is_said() -> None:
    right = (0.40, 0.40, 0.115)
    runs = compared_runs(MANEUVERS[:1], true=right, fitted=TRUE)
    shown = Page(page(report(runs, ALL))).text
    assert "The calibration did not help with the position and heading of forward-forward" in shown
    helped = Page(page(report(compared_runs(MANEUVERS[:1]), ALL))).text
    assert "did not help" not in helped


def test_light_is_told_by_where_it_comes_from() -> None:
    assert light_from((0, 0.5, -0.5)) == "45° above the horizon, 90° to the right"
    assert light_from((-1, -1, 0)) == "0° above the horizon, 45° to the left"


run_command = partial(output_of, gap_report)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "mbot-1"
    write_maneuvers(folder, "mbot-1", session(repetitions=2, duration_s=3.0))
    return folder


@pytest.mark.slow
def test_the_command_makes_a_page_from_a_recording(recording: Path, tmp_path: Path) -> None:
    calibration = tmp_path / "calibration"
    write_motion(calibration, MOTION)
    write_camera(calibration, CAMERA)
    write_light(calibration, LIGHT)
    write_body(calibration, BODY)
    maps = write_tolerances(tmp_path / "tolerance.json", tolerances())
    where = tmp_path / "gap.html"
    said = run_command(
        str(recording),
        *("--calibration", str(calibration), "--tolerance", str(maps), "-o", str(where), "--json"),
    )
    found = json.loads(said)
    assert found["held_out_runs"] == 8
    assert set(found["maneuvers"]) == {maneuver.name for maneuver in MANEUVERS}
    # The recorded robot drives at (0.41 + 0.39) / 2 m/s on wheels 0.117 m apart.
    (rate,) = found["maneuvers"]["forward-forward"]["rates"]
    assert rate["measured"]["speed_mps"] == pytest.approx(0.40, rel=0.01)
    assert rate["measured"]["turn_radps"] == pytest.approx(-0.02 / 0.117, abs=0.02)
    (spin,) = found["maneuvers"]["backward-forward"]["rates"]
    assert spin["measured"]["turn_radps"] == pytest.approx(0.80 / 0.117, rel=0.01)
    asymmetry = found["verdicts"][0]["uncalibrated"]
    assert asymmetry["value"] == pytest.approx(0.05, abs=0.004)  # 0.02 of 0.40 m/s
    assert asymmetry["used"] == pytest.approx(asymmetry["value"] / 0.05, rel=0.01)
    assert Page(where.read_text()).headings.count("backward-neutral") == 2


@pytest.mark.slow
def test_a_robot_without_calibration_is_reported_as_such(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where, ships = tmp_path / "gap.html", tmp_path / "tolerance.json"
    write_tolerances(ships, tolerances())
    monkeypatch.setattr("mbot_workstation.cli.identify.SHIPPED_MAP", ships)
    said = run_command(str(recording), "--calibration", str(tmp_path), "-o", str(where))
    assert "16 held-out runs" in said  # nothing was fitted, so all count
    assert "missing: no motion.toml" in said
    assert "Trained on the nominal robot: will not hold" in said  # by the map that ships
    assert "Its motors have not been identified yet" in Page(where.read_text()).text


def test_bad_input_is_named(recording: Path, tmp_path: Path) -> None:
    def fails(*arguments: str) -> str:
        with pytest.raises(ConfigurationError) as error:
            run_command(*arguments)
        return str(error.value)

    assert "no calibration folder" in fails(str(recording), "--calibration", str(tmp_path / "x"))
    assert "is not a recording" in fails(str(tmp_path), "--calibration", str(tmp_path))
    wrong = tmp_path / "wrong.json"
    wrong.write_text("[]")
    options = ("--calibration", str(tmp_path))
    assert "wrong.json" in fails(str(recording), *options, "--tolerance", str(wrong))
    other = tmp_path / "other"
    write_maneuvers(other, "mbot-2", session(None, 1, 2.0, MANEUVERS[:1]))
    assert "mbot-2" in fails(str(recording), str(other), *options)
    missing = str(tmp_path / "no" / "gap.html")
    assert "there is no folder" in fails(str(recording), *options, "-o", missing)
