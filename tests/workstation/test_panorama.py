import json
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.calibrate import panorama as panorama_command
from mbot_workstation.measure.calibration.room.panorama_checks import PanoramaTags, read_tags
from mbot_workstation.measure.calibration.room.panorama_import import prepare_room
from mbot_workstation.measure.calibration.room.panorama_level import (
    camera_tilt,
    directions,
    find_tilt,
    level,
    look_at,
    tilt_of,
)
from mbot_workstation.sim.calibrated.calibration_folder import read_calibration
from mbot_workstation.sim.scene.room import load_room
from mbot_workstation.sim.scene.room_generator import generate_room

from .called import output_of


@cache
def room(seed: int = 0) -> NDArray[np.uint8]:
    return generate_room(seed, 1024)


def photographed(picture: NDArray, pitch_deg: float, roll_deg: float) -> NDArray[np.uint8]:
    """The same room by a camera that was tilted."""
    return look_at(picture, directions(picture.shape[1]) @ camera_tilt(pitch_deg, roll_deg).T)


def written(path: Path, picture: NDArray, *, tags: str = "") -> Path:
    encoded = cv2.imencode(path.suffix, np.ascontiguousarray(picture[..., ::-1]))[1].tobytes()
    if tags:
        xmp = b"http://ns.adobe.com/xap/1.0/\0" + tags.encode()
        segment = b"\xff\xe1" + (len(xmp) + 2).to_bytes(2, "big") + xmp
        encoded = encoded[:2] + segment + encoded[2:]
    path.write_bytes(encoded)
    return path


def xmp(first: str, inside: str = "") -> str:
    """A packet as cameras write it; `first` goes on after "GPano:" where it is not empty."""
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
        f'xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" {first and f"GPano:{first}"}>'
        f"{inside}</rdf:Description></rdf:RDF></x:xmpmeta>"
    )


run = partial(output_of, panorama_command)


def test_a_room_is_checked_resized_kept_and_shown(tmp_path: Path) -> None:
    photo = written(tmp_path / "lab.png", cv2.resize(room(), (1400, 700)))
    folder = tmp_path / "calibration"
    fields = json.loads(run(str(photo), "--calibration", str(folder), "--json"))
    assert fields["path"] == str(folder / "rooms" / "lab.jpg")
    assert (fields["pitch_deg"], fields["roll_deg"]) == (0, 0)
    assert read_calibration(folder).rooms == (folder / "rooms" / "lab.jpg",)
    kept = load_room(folder / "rooms" / "lab.jpg")
    assert kept.shape == (512, 1024, 3)
    assert np.abs(kept.astype(int) - room()).mean() < 4
    preview = cv2.imread(fields["preview"])
    assert preview is not None
    assert preview.std() > 30
    assert not list(folder.glob("rooms/.*")), "no half-written file is left"


@pytest.mark.parametrize(("pitch", "roll"), [(0, 0), (5, -4), (-11, 8)])
@pytest.mark.parametrize("seed", [0, 3])
def test_upright_edges_tell_the_tilt(seed: int, pitch: float, roll: float) -> None:
    found = find_tilt(photographed(room(seed), pitch, roll))
    assert found is not None
    assert tilt_of(found.vertical) == pytest.approx((pitch, roll), abs=0.3)
    assert found.known_to_deg < 0.3


def test_a_tilted_photo_is_levelled(tmp_path: Path) -> None:
    photo = written(tmp_path / "room.png", photographed(room(), 6, -5))
    said = run(str(photo), "--calibration", str(tmp_path / "calibration"))
    assert "levelled by pitch +6.0, roll -5.0 degrees" in said
    kept = load_room(tmp_path / "calibration" / "rooms" / "room.jpg")
    tilted = np.abs(photographed(room(), 6, -5).astype(int) - room()).mean()
    assert np.abs(kept.astype(int) - room()).mean() < 0.4 * tilted
    given = prepare_room(photo, tilt_deg=(6, -5))
    assert (given.pitch_deg, given.roll_deg, given.tilt) == (6, -5, None)


def test_a_room_without_upright_edges_is_left_as_it_is(tmp_path: Path) -> None:
    plain = np.repeat(np.linspace(90, 200, 256, dtype=np.uint8)[:, None], 512, axis=1)
    photo = written(
        tmp_path / "fog.jpg",
        np.repeat(plain[..., None], 3, axis=2),
        tags=xmp('PosePitchDegrees="3.5" GPano:PoseRollDegrees="-1"'),
    )
    prepared = prepare_room(photo)
    assert (prepared.pitch_deg, prepared.roll_deg, prepared.tilt) == (0, 0, None)
    assert "--pitch and --roll" in prepared.notes[0]
    assert "--pitch 3.5 --roll -1" in prepared.notes[1]


@settings(max_examples=20)
@given(
    pitch=st.floats(-40, 40),
    roll=st.floats(-40, 40),
    heading=st.floats(-180, 180),
    where=st.tuples(st.floats(-180, 180), st.floats(-60, 60)),
)
def test_turning_brings_everything_where_it_belongs(
    pitch: float, roll: float, heading: float, where: tuple[float, float]
) -> None:
    right, up = np.radians(where)
    seen = np.array([np.cos(up) * np.cos(right), -np.cos(up) * np.sin(right), np.sin(up)])
    in_photo = camera_tilt(pitch, roll).T @ seen
    grid = directions(256)
    photo = (grid @ in_photo > np.cos(np.radians(6))).astype(np.uint8)[..., None] * 255
    turned = level(np.repeat(photo, 3, axis=2), 256, pitch, roll, heading)[..., 0]
    found = (grid * turned[..., None]).sum(axis=(0, 1)) * 1.0
    weights = np.linalg.norm(grid[..., :2], axis=2)[..., None]  # rows near the poles are narrower
    found = (grid * turned[..., None] * weights).sum(axis=(0, 1))
    right -= np.radians(heading)
    wanted = np.array([np.cos(up) * np.cos(right), -np.cos(up) * np.sin(right), np.sin(up)])
    assert found @ wanted / np.linalg.norm(found) > np.cos(np.radians(2))


@given(st.floats(-60, 60), st.floats(-60, 60))
def test_a_vertical_tells_pitch_and_roll(pitch: float, roll: float) -> None:
    vertical = camera_tilt(pitch, roll).T @ [0, 0, 1]
    assert tilt_of(vertical) == pytest.approx((pitch, roll), abs=1e-6)


def tags_of(folder: Path, text: str) -> PanoramaTags:
    return read_tags(written(folder / "tags.jpg", room()[:64, :128], tags=text).read_bytes())


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=300))
def test_tags_never_stumble(tmp_path: Path, data: str) -> None:
    read_tags(data.encode("utf-8", "replace"))
    tags_of(tmp_path, data.encode("utf-8", "replace").decode() or "-")
    tags_of(tmp_path, xmp(f'PosePitchDegrees="{data}"').encode("utf-8", "replace").decode())


CUT = PanoramaTags("cylindrical", (0.5, 1.0), (3.0, -1.0))
TOLD = {
    "ProjectionType": "Cylindrical",
    "CroppedAreaImageWidthPixels": "512",
    "FullPanoWidthPixels": "1024",
    "PosePitchDegrees": "3.0",
    "PoseRollDegrees": "-1",
}


@pytest.mark.parametrize("between", ["\n  ", ""])
def test_tags_are_read_as_attributes_and_as_elements(tmp_path: Path, between: str) -> None:
    attributes = " ".join(f'GPano:{name}="{value}"' for name, value in TOLD.items())
    elements = between.join(f"<GPano:{n}>{v}</GPano:{n}>" for n, v in TOLD.items())
    assert tags_of(tmp_path, xmp(attributes.removeprefix("GPano:"))) == CUT
    assert tags_of(tmp_path, xmp("", f"{between}{elements}{between}")) == CUT
    renamed = xmp("", elements).replace("GPano:", "photo:").replace(":GPano", ":photo")
    assert tags_of(tmp_path, renamed) == CUT, "a prefix is any name"


def test_no_entity_is_unfolded_and_nothing_else_is_read(tmp_path: Path) -> None:
    laughs = "".join(f'<!ENTITY a{n + 1} "{f"&a{n};" * 10}">' for n in range(9))
    secret = tmp_path / "secret"
    secret.write_text("cylindrical")
    for entities in (f'<!ENTITY a0 "ha">{laughs}', f'<!ENTITY a9 SYSTEM "{secret.as_uri()}">'):
        bomb = f"<!DOCTYPE x [{entities}]>" + xmp(
            "", "<GPano:ProjectionType>&a9;</GPano:ProjectionType>"
        )
        assert tags_of(tmp_path, bomb) == PanoramaTags()


def fisheyes() -> NDArray[np.uint8]:
    picture = np.zeros((256, 512, 3), np.uint8)
    for middle in (128, 384):
        cv2.circle(picture, (middle, 128), 124, (150, 140, 130), cv2.FILLED)
    return picture


def framed() -> NDArray[np.uint8]:
    picture = np.full((528, 1056, 3), (250, 250, 248), np.uint8)
    picture[8:-8, 16:-16] = room()
    return picture


def cut_above_and_below() -> NDArray[np.uint8]:
    """The middle third of a room that is lit from one side, stretched."""
    light = 0.7 + 0.3 * np.cos(np.linspace(0, 2 * np.pi, 512))
    return (cv2.resize(room()[170:340], (512, 256)) * light[:, None]).astype(np.uint8)


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (room()[:384, :512], r"is 512 x 384, a common flat photo"),
        (room()[:, :512], r"is 512 x 512, square"),
        (room()[150:350], r"is 1024 x 200, a strip, or the six sides"),
        (room()[60:460], r"is 1024 x 400, a strip such as phones"),
        (cv2.resize(room()[:, 100:700], (512, 256)), "does not close: its left and right edge"),
        (cut_above_and_below(), "upper or lower edge with different things"),
        (framed(), "plain frame around it"),
        (fisheyes(), "two round fisheye pictures"),
        (np.zeros((256, 512, 3), np.uint8), "one colour from top to bottom"),
    ],
)
def test_what_is_no_panorama_is_refused_as_what_it_is(
    tmp_path: Path, picture: NDArray, words: str
) -> None:
    photo = written(tmp_path / "photo.png", picture)
    with pytest.raises(ConfigurationError, match=words + r".*twice as wide as high"):
        run(str(photo), "--calibration", str(tmp_path / "calibration"))
    assert not (tmp_path / "calibration").exists()


def test_what_the_file_says_of_itself_counts(tmp_path: Path) -> None:
    for tags, words in (
        (xmp('ProjectionType="cylindrical"'), "has a cylindrical projection"),
        (
            xmp('FullPanoHeightPixels="2000" GPano:CroppedAreaImageHeightPixels="800"'),
            "covers 360 x 72 degrees",
        ),
    ):
        with pytest.raises(ConfigurationError, match=words):
            prepare_room(written(tmp_path / "photo.jpg", room(), tags=tags))


def test_force_takes_it_all_the_same_and_black_parts_are_noted(tmp_path: Path) -> None:
    picture = room().copy()
    picture[-90:] = 0
    photo = written(tmp_path / "photo.png", np.roll(picture, 1, axis=1)[:, :-14])
    prepared = prepare_room(photo, whole=False)
    assert prepared.picture.shape == (256, 512, 3)
    assert any("lower 31 degrees are black" in note for note in prepared.notes)


def test_bad_options_are_named(tmp_path: Path) -> None:
    photo = written(tmp_path / "photo.png", room())
    for options, words in (
        (("--width", "1000"), "--width is 1000, expected a power of two"),
        (("--name", "../up"), r"--name is '\.\./up', expected a plain name"),
        (("--name", ".hidden"), "expected a plain name"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            run(str(photo), *options, "--calibration", str(tmp_path / "calibration"))
    with pytest.raises(ConfigurationError, match="No such file"):
        run(str(tmp_path / "none.jpg"))
