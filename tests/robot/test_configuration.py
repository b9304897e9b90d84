import sys
from pathlib import Path

import numpy as np
import pytest

from mbot_agent import main
from mbot_agent.board import motor_stop
from mbot_agent.camera.picture_check import PictureCheck
from mbot_agent.configuration import CameraSettings, Configuration, decode, load, load_board
from mbot_agent.configuration_files import calibrated
from mbot_agent.doctor import examine_lens
from mbot_protocol.drive.actions import MotorMap, Steps
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError, UnreachableError

from ..protocol.test_calibration import CAMERA_TEXT, MOTION_TEXT
from ..ran import ran

EXAMPLE = Path(__file__).parents[2] / "deploy" / "config.toml"


def test_the_annotated_example_shows_the_defaults() -> None:
    assert load(EXAMPLE) == Configuration(robot_id="mbot-1")


def test_the_example_shows_every_setting() -> None:
    text = EXAMPLE.read_text()
    for section in (CameraSettings, CameraModel):
        for name in section.__struct_fields__:
            assert f"{name} = " in text or f".{name}]" in text, name


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "robot_id is missing; add it"),
        ("robot_id = 3", "robot_id is 3 (line 1), expected a text in quotes"),
        ('robot_id = "two words"', "expected 1 to 32"),
        (
            'robot_id = "a"\n[camera]\nsorce = "x"',
            "camera.sorce is unknown (line 3); did you mean source?",
        ),
        (
            'robot_id = "a"\n[camera]\nstale_after_ms = 5000',
            "camera.stale_after_ms is 5000 (line 3)",
        ),
        ('robot_id = "a"\n[camera]\nwidth_px = 320', "belong together"),
        ('robot_id = "a"\n[board.gpio]\nleft = [17, 4]', "board.gpio.left"),
        ('robot_id = "a"\n[board.gpio]\nleft = [17]', "board.gpio.left"),
        ('robot_id = "a"\n[board.gpio]\nleft = [17, 22]', "board.gpio: pins are [17, 22, 22, 23]"),
        (
            'robot_id = "a"\n[board.gpio]\nenabel = [25]',
            "board.gpio.enabel is unknown (line 3); did you mean enable?",
        ),
        (
            'robot_id = "a"\n[control]\ndecision_rate_hz = 50',
            "control.decision_rate_hz is 50 (line 3)",
        ),
        ('robot_id = "a"\n[motors.left]\ntrim = 0.5\ndead_band = 140', "motors.left: dead_band"),
        ('robot_id = "a"\n[network]\nlisten = ["tcp/0.0.0.0:7447"]', "anyone on the network"),
        ('robot_id = "a"\n[network]\nlisten = ["tcp/[::]:7447"]', "anyone on the network"),
        ('robot_id = "a"\n[network]\nlisten = ["tls/0.0.0.0:7447"]', "[network.tls]"),
        ('robot_id = "a"\n[network]\nlisten = ["udp/127.0.0.1:1"]', "not understood"),
        ('robot_id = "a"\n[network.tls]\nca="a"\ncertificate="b"\nkey="c"', "nobody could talk"),
        ('robot_id = "a"\n[access.people]\nrosa = ["view"]', "which takes [network.tls]"),
        ('robot_id = "a"\n[access.people]\n"Rosa" = ["view"]', "expected 1 to 32"),
        ('robot_id = "a"\n[access.people]\nrosa = ["fly"]', "access.people.rosa[0] is 'fly'"),
        (
            'robot_id = "a"\n[control]\non_lost_link = "wait"',
            "on_lost_link is 'wait' (line 3), expected one of drive, stop",
        ),
        ("robot_id =", "not valid TOML"),
    ],
)
def test_a_mistake_is_named_in_one_line(text: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        decode(text, "robot.toml")
    message = str(caught.value)
    assert message.startswith("robot.toml")
    assert words in message
    assert "\n" not in message


ANNA = "ed25519:AAECAwQFBgcICQoLDA0ODxAREhMUFRYXGBkaGxwdHh8= anna"


def test_trusted_keys_are_read() -> None:
    trust = decode(f'robot_id = "a"\n[trust]\nkeys = ["{ANNA}"]', "x").trust
    assert [key.name for key in trust.public_keys] == ["anna"]
    assert not trust.allow_unsigned


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ('["anna"]', "trust.keys: 'anna' is not a signing key"),
        (f'["{ANNA}", "{ANNA.replace("anna", "bert")}"]', "trust.keys: a key is there twice"),
        (f'"{ANNA}"', "trust.keys is 'ed25519"),
    ],
)
def test_a_key_that_is_none_is_named(keys: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        decode(f'robot_id = "a"\n[trust]\nkeys = {keys}', "robot.toml")
    assert words in str(caught.value)


def test_a_missing_file_says_where_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"copy deploy/config\.toml there"):
        load(tmp_path / "none.toml")


def test_a_motor_section_keeps_the_sides_own_direction() -> None:
    configuration = decode('robot_id = "a"\n[motors.left]\ntrim = 0.9', "x")
    assert configuration.motors.left.reversed
    assert not configuration.motors.right.reversed


def test_calibrated_intrinsics_are_scaled_to_the_frames() -> None:
    camera = CameraSettings(
        intrinsics=CameraModel(
            width_px=640,
            height_px=480,
            focal_x_px=600.0,
            focal_y_px=610.0,
            principal_x_px=319.5,
            principal_y_px=239.5,
            distortion=(-0.1, 0.01, 0.0, 0.0, 0.0),
        )
    )
    model = camera.model_at(320, 240)
    assert (model.focal_x_px, model.focal_y_px) == (300.0, 305.0)
    assert model.distortion[0] == -0.1


LENS = """robot_id = "a"
[camera.intrinsics]
width_px = 640
height_px = 480
focal_x_px = 320.0
focal_y_px = 320.0
principal_x_px = 319.5
principal_y_px = 239.5
"""


def test_a_wide_lens_has_eight_numbers_and_no_lens_six() -> None:
    wide = decode(f"{LENS}distortion = [0.1, 0.2, 0, 0, 0, 0.3, 0.1, 0]", "x").camera.intrinsics
    assert wide is not None
    assert wide.distortion[5] == 0.3
    with pytest.raises(ConfigurationError, match=r"focal_x_px is 6.0, expected 86 to 3658"):
        decode(LENS.replace("focal_x_px = 320.0", "focal_x_px = 6.0"), "x")
    with pytest.raises(ConfigurationError, match=r"width_px"):
        decode(LENS.replace("width_px = 640", "width_px = 8"), "x")
    with pytest.raises(ConfigurationError, match=r"has 6 numbers, expected 5 .*or 8"):
        decode(f"{LENS}distortion = [0, 0, 0, 0, 0, 0]", "x")
    with pytest.raises(ConfigurationError, match=r"distorsion is unknown \(line 9\)"):
        decode(f"{LENS}distorsion = [0, 0, 0, 0, 0]", "x")


@pytest.fixture
def robot_toml(tmp_path: Path) -> Path:
    """A configuration beside its calibration, as both lie on the robot."""
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration" / "camera.toml").write_text(CAMERA_TEXT)
    (tmp_path / "calibration" / "motion.toml").write_text(MOTION_TEXT)
    path = tmp_path / "robot.toml"
    path.write_text('robot_id = "a"\ncalibration = "calibration"\n')
    return path


def test_the_calibration_gives_camera_and_motors(robot_toml: Path) -> None:
    configuration = calibrated(load(robot_toml), robot_toml)
    model = configuration.camera.model_at(1014, 760)
    assert (model.focal_x_px, model.focal_y_px) == (1936.5 / 2, 1934.0 / 2)
    assert model.principal_x_px == pytest.approx((1020.25 + 0.5) / 2 - 0.5)
    assert model.distortion == (-0.11, 0.05, 0.0005, -0.0003, 0.0)
    maps = configuration.motors
    assert maps.left == MotorMap(True, 0.9, 45)
    assert maps.right == MotorMap(False, 1.0, 40)
    assert maps.levels(maps.duties(Steps(250, -250))) == (-230, -255)


def test_half_a_calibration_leaves_the_other_half_nominal(robot_toml: Path) -> None:
    (robot_toml.parent / "calibration" / "camera.toml").unlink()
    configuration = calibrated(load(robot_toml), robot_toml)
    assert configuration.camera == CameraSettings()
    assert configuration.motors.left.trim == 0.9
    (robot_toml.parent / "calibration" / "motion.toml").unlink()
    with pytest.raises(ConfigurationError, match=r"neither camera\.toml nor motion\.toml"):
        calibrated(load(robot_toml), robot_toml)


def test_without_a_calibration_nothing_changes(robot_toml: Path) -> None:
    configuration = decode('robot_id = "a"', "x")
    assert calibrated(configuration, robot_toml) is configuration
    assert configuration.motors.right == MotorMap(False, 1.0, 40)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("[camera]\nwidth_px = 640\nheight_px = 360", "640 x 360, another shape than the 2028"),
        ("[motors.left]\ntrim = 0.95", "motors.left.trim is set"),
        ("[motors.right]\ndead_band = 40", "motors.right.dead_band is set"),
        (
            "[camera.intrinsics]\nwidth_px = 640\nheight_px = 480\nfocal_x_px = 600.0\n"
            "focal_y_px = 600.0\nprincipal_x_px = 320.0\nprincipal_y_px = 240.0",
            "delete one of the two",
        ),
    ],
)
def test_what_stands_in_both_is_refused(robot_toml: Path, more: str, words: str) -> None:
    robot_toml.write_text(robot_toml.read_text() + more)
    with pytest.raises(ConfigurationError) as caught:
        calibrated(load(robot_toml), robot_toml)
    assert str(caught.value).startswith(str(robot_toml))
    assert words in str(caught.value)


@pytest.mark.parametrize("action", ["check", "run"])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("trim = 0.9 -> trim = 9", "motion.toml: left_motor: trim is 9"),
        ("focal_x_px = 1936.5 -> focal_x_px = 6.0", "camera.toml: focal_x_px is 6.0"),
        ("gone", "no calibration folder"),
    ],
)
def test_an_unusable_calibration_stops_the_daemon_with_one_line(
    robot_toml: Path, action: str, change: str, words: str
) -> None:
    folder = robot_toml.parent / "calibration"
    if change == "gone":
        folder.rename(robot_toml.parent / "elsewhere")
    else:
        old, new = change.split(" -> ")
        for path in folder.iterdir():
            path.write_text(path.read_text().replace(old, new))
    done = ran(sys.executable, "-m", "mbot_agent.main", action, "--config", robot_toml)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert words in done.stderr


def test_motors_can_be_stopped_whatever_the_calibration_says(
    robot_toml: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """stop-motors uses the configured port even if the calibration is unusable."""
    (robot_toml.parent / "calibration" / "motion.toml").write_text("broken =")
    robot_toml.write_text(robot_toml.read_text() + '[board]\nport = "/dev/none-such"\n')
    monkeypatch.setattr(motor_stop, "TIME_LIMIT_S", 0.1)
    with pytest.raises(UnreachableError, match="/dev/none-such"):
        main._stop_motors(robot_toml)  # pyright: ignore[reportPrivateUsage]


def test_frames_of_another_shape_than_the_calibration_are_no_frames(robot_toml: Path) -> None:
    check = PictureCheck(calibrated(load(robot_toml), robot_toml).camera)
    rng = np.random.default_rng(0)
    good = rng.integers(100, 200, (240, 320, 3), np.uint8)
    assert check.judge(good, 0) is None
    check = PictureCheck(calibrated(load(robot_toml), robot_toml).camera)
    fault = check.judge(rng.integers(100, 200, (180, 320, 3), np.uint8), 0)
    assert fault is not None
    assert fault.kind == "camera-wrong-shape"
    assert "320 x 180, another shape than the calibrated" in fault.detail


def test_check_says_what_it_takes_the_lens_for(robot_toml: Path) -> None:
    configuration = calibrated(load(robot_toml), robot_toml)
    lens = examine_lens(configuration)
    assert (lens.verdict, lens.detail) == ("ok", "calibrated at 2028 x 1520, from calibration")
    assert examine_lens(decode('robot_id = "a"', "x")).verdict == "warning"


@pytest.mark.parametrize(
    ("text", "port", "baud_rate"),
    [
        ('robot_id = "x"\n[board]\nport = "/dev/ttyUSB7"\n', "/dev/ttyUSB7", 115_200),
        ('[board]\nport = "/dev/ttyUSB7"\nbaud_rate = 9600\n', "/dev/ttyUSB7", 9600),
        (
            'robot_id = "x"\n[camera]\nsourc = 1\n[board]\nport = "/dev/ttyUSB7"\n',
            "/dev/ttyUSB7",
            115_200,
        ),
        (
            "robot_id = ???\n  [board]\n port='/dev/ttyUSB7' # ours\n[motors",
            "/dev/ttyUSB7",
            115_200,
        ),
        ('[board\nport = "/dev/ttyUSB7"\n', "auto", 115_200),
        ('[camera]\nport = "/dev/ttyUSB7"\n[board]\n[x]\nport = "/dev/ttyUSB8"\n', "auto", 115_200),
        ("", "auto", 115_200),
    ],
)
def test_the_boards_port_is_found_in_a_broken_configuration(
    tmp_path: Path, text: str, port: str, baud_rate: int
) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    board = load_board(path)
    assert (board.port, board.baud_rate) == (port, baud_rate)


def test_the_boards_kind_is_found_in_a_broken_configuration(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text('robot_id = ???\n[board]\nkind = "lines"\n')
    assert load_board(path).kind == "lines"
    path.write_text('robot_id = "a"\n')
    assert load_board(path).kind == "mcore"


def test_the_boards_pins_are_found_in_a_broken_configuration(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    board = '[board]\nkind = "gpio"\n[board.gpio]\nleft = [12, 13]\n'
    for broken in ("[camera\n", '[camera]\nsorce = "x"\n', "[boards]\n"):
        path.write_text(f"robot_id = ???\n{board}{broken}")
        found = load_board(path)
        assert (found.kind, found.gpio.left) == ("gpio", (12, 13))


def test_without_a_configuration_the_board_is_looked_for_on_usb(tmp_path: Path) -> None:
    assert load_board(tmp_path / "missing.toml").port == "auto"
