import json
import os
import shutil
from pathlib import Path

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read when onnxruntime is imported

import cv2
import numpy as np
import pytest
import torch

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FULL_VIEW, PolicyMetadata
from mbot_workstation.cli.evaluate import explain
from mbot_workstation.cli.train import training_curve
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.learn.evaluation.activations import ActivationReader, Glance
from mbot_workstation.learn.evaluation.explanation import (
    as_observation,
    mosaic,
    recorded_glances,
)
from mbot_workstation.learn.learning.policy_graph import policy_graph
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.worlds.example_frames import (
    NO_OBJECT,
    OBJECT_CENTRAL,
    OBJECT_LEFT,
    example_frames,
)

from .called import output_of
from .samples import decision, picture

SHIPPED = Path(__file__).parents[2] / "models" / "red-cube.onnx"
RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"

NAMES = {
    "features_extractor.first": (16, 3, 8, 8),
    "features_extractor.second": (32, 16, 4, 4),
    "features_extractor.dense": (256, 1152),
    "action_net": (2, 256),
}


def weights() -> dict[str, torch.Tensor]:
    torch.manual_seed(0)
    made = {f"{name}.weight": torch.randn(shape) * 0.05 for name, shape in NAMES.items()}
    return made | {f"{name}.bias": torch.randn(shape[0]) * 0.05 for name, shape in NAMES.items()}


@pytest.fixture(scope="module")
def model() -> bytes:
    return policy_graph(weights(), PolicyMetadata("learned")).SerializeToString()


@pytest.fixture
def model_file(model: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "learned.onnx"
    path.write_bytes(model)
    return path


def test_the_microscope_shows_what_torch_computes(model: bytes) -> None:
    frame = np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    seen = ActivationReader(model).look(frame)
    scaled = torch.from_numpy(frame).permute(2, 0, 1)[None] / 255 - 0.5
    first = weights()["features_extractor.first.weight"], weights()["features_extractor.first.bias"]
    expected = torch.nn.functional.conv2d(scaled, *first, stride=4)[0].numpy()
    assert seen.convolution is not None
    assert seen.convolution.shape == (16, 15, 15)
    np.testing.assert_allclose(seen.convolution, expected, atol=1e-5)
    assert seen.activation is not None
    leaky = np.where(expected > 0, expected, 0.01 * expected)
    np.testing.assert_allclose(seen.activation, leaky, atol=1e-5)
    assert all(-1 <= wheel <= 1 for wheel in seen.action)


def test_any_policy_shows_where_it_looks(tmp_path: Path) -> None:
    servo = servo_model(ServoGains(), PolicyMetadata("servo")).SerializeToString()
    reader = ActivationReader(servo)
    frame = np.full((64, 64, 3), 120, np.uint8)
    nothing = reader.look(frame)
    frame[36:44, 8:16] = (200, 20, 20)
    seen = reader.look(frame)
    assert seen.convolution is None
    assert nothing.saliency.max() < 1e-3
    row, column = np.unravel_index(int(seen.saliency.argmax()), seen.saliency.shape)
    # Places of 8 x 8 pixels begin 4 apart; half a blob hidden moves its middle most.
    assert abs(row - 9) <= 1
    assert abs(column - 2) <= 1
    assert seen.saliency.max() > 0.05
    assert seen.saliency[:6].max() < 1e-3
    path = tmp_path / "servo.onnx"
    path.write_bytes(servo)
    assert "wrote" in output_of(explain, str(path), "-o", str(tmp_path / "servo.png"))


def test_what_a_policy_remembers_is_told_from_what_it_sees() -> None:
    reader = ActivationReader(SHIPPED.read_bytes())
    frames = list(example_frames().values())
    straight = (0.2, 0.2)
    drive = [Glance(frames[1]), *[Glance(frames[1], straight)] * 11, Glance(frames[0], straight)]
    (first, last) = reader.look_back(drive, [0, 12])
    assert first.first_action == pytest.approx(first.action)
    assert last.first_action == pytest.approx(reader.look(frames[0]).action)
    assert last.first_action is not None
    assert np.abs(np.subtract(last.action, last.first_action)).max() > 0.05


def test_a_recorded_policy_does_what_it_did_on_the_robot() -> None:
    """Its memory goes on and is zeroed where the robot did that, and it hears what wheels did."""
    model = (RECORDED / "seeing.onnx").read_bytes()
    decided = [beat for beat in read_drive(RECORDED).beats if beat.decided]
    _, glances = recorded_glances(RECORDED, FULL_VIEW)
    assert len(glances) == len(decided) + 1  # in one beat it was not asked
    looks = ActivationReader(model).look_back(glances, range(len(glances)))
    actions = [one.action for one in looks]
    del actions[8]
    then = [(beat.decision.action.left, beat.decision.action.right) for beat in decided]
    np.testing.assert_allclose(actions, then, atol=1e-5)
    uninterrupted = [Glance(one.frame, one.told or (0.0, 0.0)) for one in glances]
    other = ActivationReader(model).look_back(uninterrupted, [9])[0].action
    assert np.abs(np.subtract(other, then[8])).max() > 1e-3


def test_telemetry_tells_where_a_policy_started_over(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with TelemetryFile(path, "mbot-1") as recording:
        for number in (0, 1, 2, 4, 5, 6, 7, 8):  # 3 was lost
            made = decision(number)
            if number == 8:
                made.model_sha256 = "b" * 64  # another model from here on
            if number == 5:
                made.ClearField("action")  # held: the policy was not asked
            recording.write(made)
            recording.write(picture(made.unix_time_ns))
    _, glances = recorded_glances(path, FULL_VIEW)
    on = (125 / 250, -62 / 250)
    assert [glance.told for glance in glances] == [None, on, on, None, None, None, on, None]


def test_the_example_frames_show_what_they_say() -> None:
    frames = example_frames()
    red = {
        name: (frame[..., 0] > 90) & (frame[..., 1] < 70) & (frame[..., 2] < 70)
        for name, frame in frames.items()
    }
    assert not red[NO_OBJECT].any()
    for name, low, high in ((OBJECT_LEFT, 0, 24), (OBJECT_CENTRAL, 24, 40)):
        columns = np.nonzero(red[name].any(axis=0))[0]
        assert len(columns) >= 4
        assert low <= columns.mean() < high


def test_without_frames_the_papers_three_are_explained(model_file: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.png"
    told = output_of(explain, str(model_file), "-o", str(output))
    assert all(name in told for name in (NO_OBJECT, OBJECT_LEFT, OBJECT_CENTRAL))
    image = cv2.imread(str(output))
    assert image is not None
    assert image.std() > 10


def test_frames_of_any_size_are_explained(model_file: Path, tmp_path: Path) -> None:
    for name, shape in (("small", (64, 64, 3)), ("camera", (240, 320, 3))):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full(shape, 90, np.uint8))
    files = [str(tmp_path / "small.png"), str(tmp_path / "camera.png")]
    told = output_of(
        explain, str(model_file), "--frames", *files, "-o", str(tmp_path / "o.png"), "--json"
    )
    assert '"small"' in told
    assert '"camera"' in told
    assert as_observation(np.zeros((240, 320, 3), np.uint8), FULL_VIEW).shape == (64, 64, 3)


def test_a_recording_is_explained(model_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with TelemetryFile(path, "mbot-1") as recording:
        for number in range(11):
            made = decision(number)
            recording.write(made)
            recording.write(picture(made.unix_time_ns))
    told = output_of(
        explain,
        *(str(model_file), "--recording", str(path), "--count", "3"),
        *("-o", str(tmp_path / "o.png")),
    )
    assert [line.split(":")[0] for line in told.splitlines()[:3]] == ["0.0 s", "0.5 s", "1.0 s"]


def test_what_cannot_be_explained_is_named(model_file: Path, tmp_path: Path) -> None:
    text = tmp_path / "a.png"
    text.write_text("not a picture")
    for arguments, message in (
        (("--frames", str(tmp_path / "none.png")), "can't read"),
        (("--frames", str(text)), "not a picture"),
        (("--frames", str(text), "--recording", str(text)), "one of the two"),
        (("-o", str(tmp_path / "missing" / "o.png")), "there is no folder"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            output_of(explain, str(model_file), *arguments)


def test_maps_are_laid_out_in_rows() -> None:
    maps = np.arange(16 * 4, dtype=np.float32).reshape(16, 2, 2)
    wall = mosaic(maps)
    assert wall.shape == (4 * 3 - 1, 4 * 3 - 1)
    np.testing.assert_array_equal(wall[3:5, 3:5], maps[5])
    assert np.isnan(wall[2]).all()


def test_the_training_curve_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text(json.dumps(TrainingConfig().resolved()))
    progress = tmp_path / "progress.csv"
    header = "step,wall_s,lesson,mean_reward,mean_length,mean_touches,episodes"
    progress.write_text(header + "\n")
    with pytest.raises(ConfigurationError, match="no row"):
        output_of(training_curve, str(tmp_path))
    rows = [f"{40_000 * n},{30 * n},{min(n, 10)},{2 * n},{300 - 9 * n},1,50" for n in range(1, 11)]
    progress.write_text("\n".join([header, *rows]) + "\n")
    output_of(training_curve, str(tmp_path))
    alone = (tmp_path / "curve.png").read_bytes()
    assert alone.startswith(b"\x89PNG")
    shutil.copytree(tmp_path, tmp_path / "second")
    output_of(training_curve, str(tmp_path), str(tmp_path / "second"))
    assert (tmp_path / "curve.png").read_bytes() != alone
