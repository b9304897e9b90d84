import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.calibration_files.calibration_folder import (
    CalibrationFiles,
    write_body,
    write_camera,
    write_light,
    write_motion,
)
from mbot_workstation.commands.gap_report import gap_report
from mbot_workstation.gap_report.bearable import bearable
from mbot_workstation.gap_report.compared_run import CALIBRATED, NOMINAL
from mbot_workstation.gap_report.deviation import deviation
from mbot_workstation.gap_report.figures_json import figures
from mbot_workstation.gap_report.frame_pair import FramePair, RealFrame, frame_pairs
from mbot_workstation.gap_report.frames_folder import read_frames
from mbot_workstation.gap_report.page import page
from mbot_workstation.gap_report.quantity import DEVIATIONS_OF_QUANTITIES, Quantity, quantities
from mbot_workstation.gap_report.report import driven
from mbot_workstation.gap_report.simulated_view import Place
from mbot_workstation.gap_report.steady_rates import steady_rate, steady_rates
from mbot_workstation.gap_report.telemetry_frames import telemetry_frames
from mbot_workstation.gap_report.verdict import Word, judge
from mbot_workstation.recordings.drive_mcap import Recording
from mbot_workstation.recordings.maneuver import MANEUVERS, maneuver_named
from mbot_workstation.recordings.recording_folder import TELEMETRY_FILE, write_recording
from mbot_workstation.simulation.pose import ORIGIN, Pose
from mbot_workstation.training.studies.study_plans import DEVIATIONS
from mbot_workstation.training.studies.tolerance_file import (
    Tolerances,
    read_tolerances,
    write_tolerances,
)
from mbot_workstation.training.studies.tolerance_map import BEARABLE, ToleranceMap, as_file

from .calibrations import BODY, CAMERA, LIGHT, MOTION
from .driven_robot import session
from .gap_samples import FITTED, TRUE, compared_runs, report, tolerances
from .samples import decision, picture

ALL = CalibrationFiles(
    folder="calibration/mbot-1", camera=CAMERA, motion=MOTION, body=BODY, light=LIGHT
)
ONLY_MOTION = CalibrationFiles(folder="calibration/mbot-1", motion=MOTION)


class Page(HTMLParser):
    """What of a page matters here."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.headings: list[str] = []
        self.words: list[str] = []
        self._in_heading = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self._in_heading = tag == "h3"
        for name, value in attrs:
            if name == "id" and value:
                self.ids.append(value)
            if name in ("src", "href", "srcset", "data", "action", "xlink:href") and value:
                self.links.append(value)

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if self._in_heading:
            self.headings.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def test_the_page_shows_every_manoeuvre_and_needs_no_other_file() -> None:
    text = page(report(compared_runs(), ALL, tolerances()))
    shown = Page(text)
    for maneuver in MANEUVERS:
        assert shown.headings.count(maneuver.name) == 2  # path and error
    assert not {"script", "link", "iframe", "object"} & set(shown.tags)
    assert all(link.startswith(("data:", "#")) for link in shown.links)
    assert not re.search(r"https?://|@import|url\((?!#)", text)
    assert len(text.encode()) < 5e6
    assert len(set(shown.ids)) == len(shown.ids)
    used = [link[1:] for link in shown.links if link.startswith("#")]
    used += re.findall(r"url\(#([^)]+)\)", text)
    assert used
    assert set(used) <= set(shown.ids)
    assert shown.tags.count("svg") >= 8 + 8 + 1 + 1
    assert "At speed the simulated robot is off by" in text


def test_the_same_data_make_the_same_page() -> None:
    one = report(compared_runs(MANEUVERS[:2], 1), ONLY_MOTION)
    assert page(one) == page(one)


def test_a_known_gap_is_what_the_page_says() -> None:
    driven_ones = MANEUVERS[:2]
    runs = compared_runs(driven_ones, offset=(0.03, -0.04, math.radians(2)))
    result = report(runs, ALL, tolerances())
    assert result.calibrated.position_m == pytest.approx(0.05)
    assert result.calibrated.worst_position_m == pytest.approx(0.05)
    assert result.calibrated.yaw_rad == pytest.approx(math.radians(2))
    assert result.calibrated.speed == pytest.approx(0, abs=1e-3)
    found = figures(result)
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


def test_errors_of_the_nominal_robot_are_those_of_its_path() -> None:
    (run,) = compared_runs([maneuver_named("forward-forward")], 1)
    result = driven([run])
    away = np.hypot(*(run.nominal - run.measured)[-1, :2])
    assert result.nominal.position_m == pytest.approx(away)
    assert result.nominal.yaw_rad == pytest.approx(abs(run.measured[-1, 2]))
    assert result.nominal.position_m > 0.2


def test_bands_reach_over_all_repetitions() -> None:
    maneuver = maneuver_named("forward-forward")
    near, far = (compared_runs([maneuver], 1, offset=(size, 0.0, 0.0))[0] for size in (0.01, 0.03))
    (gap,) = driven([near, far]).maneuvers
    assert gap.calibrated.position_m.low == pytest.approx(np.full_like(gap.calibrated.time_s, 0.01))
    assert gap.calibrated.position_m.high[-1] == pytest.approx(0.03)
    assert gap.calibrated.position_m.middle[-1] == pytest.approx(0.02)


@given(
    speed=st.floats(-0.7, 0.7),
    turn=st.floats(-9, 9),
    start=st.floats(-3, 3),
    seed=st.integers(0, 99),
)
@settings(max_examples=40, deadline=None)
def test_steady_rates_are_found_through_the_trackers_noise(
    speed: float, turn: float, start: float, seed: int
) -> None:
    time_s = np.arange(0, 5, 0.02)
    yaw = start + turn * time_s
    way = np.cumsum(speed * 0.02 * np.exp(1j * (yaw - turn * 0.01)))
    rng = np.random.default_rng(seed)
    path = np.stack([way.real, way.imag, yaw], axis=1)
    noisy = path + rng.normal(0, [0.002, 0.002, 0.002], path.shape)
    found = steady_rate(time_s, noisy)
    assert found.turn_radps == pytest.approx(turn, abs=2e-3)
    assert found.speed_mps == pytest.approx(speed, abs=6e-3)


@given(
    left=st.floats(0.3, 0.5),
    right=st.floats(0.3, 0.5),
    track=st.floats(0.10, 0.13),
)
@settings(max_examples=30, deadline=None)
def test_deviations_are_read_from_straight_runs_and_spins(
    left: float, right: float, track: float
) -> None:
    names = ("forward-forward", "backward-backward", "forward-backward", "backward-forward")
    maneuvers = [maneuver_named(name) for name in names]
    runs = compared_runs(maneuvers, 1, true=(left, right, track), fitted=(0.4, 0.4, 0.115))
    found = deviation(steady_rates(runs), CALIBRATED)
    assert found is not None
    middle = (left + right) / 2
    assert found.asymmetry == pytest.approx((left - right) / middle, abs=5e-3)
    assert found.radius_scale == pytest.approx(middle / 0.4, rel=5e-3)
    assert found.track_scale == pytest.approx(track / 0.115, rel=5e-3)


def test_without_spins_no_deviation_is_invented() -> None:
    runs = compared_runs([maneuver_named("forward-forward")])
    assert deviation(steady_rates(runs), NOMINAL) is None
    rows = quantities(CalibrationFiles(), None, None)
    assert [row.uncalibrated for row in rows] == [None] * 7
    assert "workstation maneuvers run" in rows[0].source


def test_runs_that_are_too_short_for_a_speed_say_none() -> None:
    result = report(compared_runs(MANEUVERS[:1], 1, duration_s=0.9), ONLY_MOTION)
    assert result.rates == ()
    assert result.calibrated.speed is None
    assert "No run is long enough" in Page(page(result)).text


def quantity(value: float | None, name: str = "gain asymmetry") -> Quantity:
    nominal = 0.0 if name == "gain asymmetry" else 1.0
    return Quantity("Q", name, "%", 100.0, nominal, nominal, value, 0.0, "test")


@pytest.mark.parametrize(
    ("value", "word", "used"),
    [
        (0.0, Word.FINE, 0.0),
        (0.02, Word.FINE, 0.4),
        (-0.04, Word.BORDERLINE, 0.8),
        (0.06, Word.WILL_NOT_HOLD, 1.2),
        (-0.5, Word.WILL_NOT_HOLD, 10.0),
    ],
)
def test_verdicts_follow_the_way_to_the_border(value: float, word: Word, used: float) -> None:
    # The reward falls by 1 % a percent of asymmetry, and 95 % must be left: the border is at 5 %.
    found = judge(quantity(value), tolerances()).uncalibrated
    assert found.word is word
    assert found.used == pytest.approx(used, abs=1e-9)
    assert found.reward_share == pytest.approx(1 - min(abs(value), 0.3), abs=1e-9)


def test_beyond_a_map_whose_border_is_not_on_it_nothing_is_sure() -> None:
    wide = tolerances(share=0.6)  # all of the map is bearable: 70 % are left at its ends
    borne = bearable(wide, "gain asymmetry")
    assert borne is not None
    assert (borne.ends_low, borne.ends_high) == (True, True)
    inside, outside = (judge(quantity(value), wide).uncalibrated for value in (0.1, 0.4))
    assert inside.word is Word.FINE
    assert outside.word is Word.BORDERLINE
    assert "beyond" in outside.why


def test_of_two_maps_the_stricter_one_counts() -> None:
    mild, strict = tolerances(), tolerances()
    harder = strict.maps[0]
    rewards = tuple(tuple(20 - 2 * (20 - reward) for reward in row) for row in harder.rewards)
    both = Tolerances(
        contestant="x",
        nominal_reward=20.0,
        bearable_share=0.95,
        how="",
        maps=(mild.maps[0], type(harder)(harder.across, harder.up, rewards)),
    )
    borne = bearable(both, "gain asymmetry")
    assert borne is not None
    assert borne.high == pytest.approx(0.025)
    assert borne.low == pytest.approx(-0.025)


def test_without_map_or_value_there_is_no_verdict() -> None:
    assert judge(quantity(0.1), None).uncalibrated.word is Word.UNKNOWN
    assert judge(quantity(None), tolerances()).uncalibrated.word is Word.UNKNOWN
    assert judge(quantity(1.1, "fov_scale"), tolerances()).uncalibrated.word is Word.UNKNOWN


@given(value=st.floats(-0.3, 0.3))
@settings(deadline=None)
def test_a_bearable_deviation_leaves_enough_reward(value: float) -> None:
    verdict = judge(quantity(value), tolerances()).uncalibrated
    assert verdict.reward_share is not None
    assert (verdict.reward_share >= 0.95 - 1e-9) == (verdict.word is not Word.WILL_NOT_HOLD)


def test_quantities_stand_on_the_axes_of_the_tolerance_maps() -> None:
    rows = quantities(ALL, None, None)
    assert tuple(row.deviation for row in rows) == DEVIATIONS_OF_QUANTITIES
    for row in rows:
        assert row.nominal == DEVIATIONS[row.deviation].nominal
    values = {row.title: row.uncalibrated for row in rows}
    assert values["Mounting pitch"] == pytest.approx(2.0)
    assert values["Latency"] == pytest.approx(60 + 35 - 15)
    assert values["Exposure"] == pytest.approx(0.8)
    view = math.tan(math.radians(55.3 / 2)) * math.tan(math.radians(42.9 / 2))
    mine = (2028 / 2 / 1990) * (1520 / 2 / 1985)
    assert values["Field of view"] == pytest.approx(math.sqrt(mine / view), rel=1e-3)


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
    left_out = {"run 3 <b>": "a & b"}
    text = page(report(compared_runs(MANEUVERS[:1], 1), ONLY_MOTION, left_out=left_out))
    assert "run 3 &lt;b&gt;: a &amp; b" in text
    assert "run 3 <b>" not in text


def test_frames_stand_side_by_side() -> None:
    real = np.full((48, 64, 3), 100, np.uint8)
    pair = FramePair("frame <1>", real, real + 10, real + 40)
    text = page(report(compared_runs(MANEUVERS[:1], 1), ONLY_MOTION, frames=(pair,)))
    shown = Page(text)
    assert shown.tags.count("img") == 3
    assert "10.0 of 255 levels" in shown.text
    assert "40.0 of 255 levels" in shown.text
    assert "frame &lt;1&gt;" in text


def test_a_frame_is_drawn_as_the_robot_would_see_it() -> None:
    cube = Pose(0.6, 0.0, 0.0)
    frame = RealFrame("x", np.zeros((120, 160, 3), np.uint8), Place(ORIGIN, cube), False)
    observation = RealFrame("y", np.zeros((64, 64, 3), np.uint8), Place(ORIGIN, cube), True)
    dark = CalibrationFiles(light=LIGHT)  # exposure 0.8
    first, second = frame_pairs([frame, observation], dark)
    assert first.calibrated.shape == first.nominal.shape == (120, 160, 3)
    assert second.calibrated.shape == (64, 64, 3)
    red = first.nominal.astype(int)
    assert (red[..., 0] - red[..., 1] > 80).any()  # the cube
    assert first.calibrated.mean() < 0.95 * first.nominal.mean()


def test_frames_are_read_with_their_places(tmp_path: Path) -> None:
    picture = np.zeros((30, 40, 3), np.uint8)
    picture[..., 2] = 200  # red, in OpenCV's order
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((900, 1280, 3), np.uint8))
    (tmp_path / "frames.csv").write_text(
        "file,x_m,y_m,yaw_deg,cube_x_m,cube_y_m,cube_yaw_deg\n"
        "a.png,0.5,-0.2,90,1,0,45\nb.png,0,0,0,,,\n"
    )
    first, second = read_frames(tmp_path)
    assert first.place == Place(Pose(0.5, -0.2, math.pi / 2), Pose(1.0, 0.0, math.pi / 4))
    assert first.picture[0, 0].tolist() == [200, 0, 0]
    assert second.place.cube is None
    assert second.picture.shape == (450, 640, 3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "can't read"),
        ("file,x,y\n", "has the columns"),
        ("file,x_m,y_m,yaw_deg\n", "names no picture"),
        ("file,x_m,y_m,yaw_deg\na.png,0,zero,0\n", "line 2: y_m is 'zero'"),
        ("file,x_m,y_m,yaw_deg\na.png,500,0,0\n", "line 2: x_m is 500"),
        ("file,x_m,y_m,yaw_deg\na.png,0,0,nan\n", "line 2: yaw_deg is nan"),
        ("file,x_m,y_m,yaw_deg\nmissing.png,0,0,0\n", "line 2: can't read"),
        ("file,x_m,y_m,yaw_deg\nframes.csv,0,0,0\n", "is no picture"),
        ("file,x_m,y_m,yaw_deg,cube_x_m\na.png,0,0,0,1\n", "cube_y_m is ''"),
    ],
)
def test_unusable_frames_are_named(tmp_path: Path, content: str | None, message: str) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((30, 40, 3), np.uint8))
    if content is not None:
        (tmp_path / "frames.csv").write_text(content)
    with pytest.raises(ConfigurationError, match=message):
        read_frames(tmp_path)


def test_frames_of_the_first_run_are_found_in_telemetry(tmp_path: Path) -> None:
    (run,) = compared_runs([maneuver_named("forward-forward")], 1, duration_s=4.0)
    # Decisions from 100 s on, every 0.1 s; their pictures are 0.03 s older.
    with Recording(tmp_path / TELEMETRY_FILE, "mbot-1") as file:
        for number in range(80):
            one = decision(number)
            if number != 17:  # one picture got lost
                file.write(picture(one.unix_time_ns))
            file.write(one)
    frames = telemetry_frames(tmp_path, run, start_s=103.0)
    assert [frame.title for frame in frames] == [
        "before it starts",
        "1.4 s into forward-forward",
        "2.8 s into forward-forward",
    ]
    assert frames[0].place.robot == ORIGIN
    driven_s = 1.4 - 0.03
    where = frames[1].place.robot
    expected = [np.interp(driven_s, run.time_s, column) for column in run.measured.T]
    assert (where.x_m, where.y_m, where.yaw_rad) == pytest.approx(expected, abs=0.01)
    assert frames[0].picture[0, 0].tolist() == [255, 0, 0]
    assert telemetry_frames(tmp_path, run, start_s=500.0) == ()
    assert telemetry_frames(tmp_path / "none", run, start_s=103.0) == ()


def test_tolerance_maps_survive_their_file(tmp_path: Path) -> None:
    grid = ToleranceMap.of("track_scale", "exposure_gain", 3)
    rewards = np.arange(9.0).reshape(3, 3)
    made = as_file([(grid, rewards)], "servo", 19.5, "how")
    found = read_tolerances(write_tolerances(tmp_path / "tolerance.json", made))
    assert found == made
    assert found.bearable_share == BEARABLE
    (one,) = found.maps
    assert one.across.nominal == DEVIATIONS["track_scale"].nominal
    assert one.rewards[2] == (6.0, 7.0, 8.0)


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        "no json",
        '{"contestant": "x", "nominal_reward": -1, "bearable_share": 0.95, "how": "", "maps": []}',
    ],
)
def test_another_file_is_no_tolerance_map(tmp_path: Path, content: str) -> None:
    path = tmp_path / "tolerance.json"
    path.write_text(content)
    with pytest.raises(ConfigurationError, match=re.escape(str(path))):
        read_tolerances(path)


def run_command(*arguments: str) -> str:
    app = typer.Typer()
    app.command()(gap_report)
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "mbot-1"
    write_recording(folder, "mbot-1", session(repetitions=2, duration_s=3.0))
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


def test_a_robot_without_calibration_is_reported_as_such(recording: Path, tmp_path: Path) -> None:
    where = tmp_path / "gap.html"
    said = run_command(str(recording), "--calibration", str(tmp_path), "-o", str(where))
    assert "16 held-out runs" in said  # nothing was fitted, so all count
    assert "missing: no motion.toml" in said
    assert "Its motors have not been identified yet" in Page(where.read_text()).text


def test_bad_input_is_named(recording: Path, tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(gap_report)

    def fails(*arguments: str) -> str:
        with pytest.raises(ConfigurationError) as error:
            CliRunner().invoke(app, list(arguments), catch_exceptions=False)
        return str(error.value)

    assert "no calibration folder" in fails(str(recording), "--calibration", str(tmp_path / "x"))
    assert "is no recording" in fails(str(tmp_path), "--calibration", str(tmp_path))
    wrong = tmp_path / "wrong.json"
    wrong.write_text("[]")
    options = ("--calibration", str(tmp_path))
    assert "wrong.json" in fails(str(recording), *options, "--tolerance", str(wrong))
    other = tmp_path / "other"
    write_recording(other, "mbot-2", session(None, 1, 2.0, MANEUVERS[:1]))
    assert "mbot-2" in fails(str(recording), str(other), *options)
    assert "can't write" in fails(str(recording), *options, "-o", str(tmp_path / "no" / "gap.html"))
