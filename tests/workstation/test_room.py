from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.scene.floor_textures import vinyl
from mbot_workstation.sim.scene.room import fit_room, load_room
from mbot_workstation.sim.scene.room_dome import dome_mesh
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_parameters import Room


def written(path: Path, width: int, height: int) -> Path:
    picture = np.zeros((height, width, 3), np.uint8)
    picture[..., 2] = 250  # red, in the order OpenCV writes
    cv2.imwrite(str(path), picture)
    return path


def test_a_panorama_is_read_as_rgb_and_made_exactly_two_to_one(tmp_path: Path) -> None:
    room = load_room(written(tmp_path / "room.png", 402, 200))
    assert room.shape == (200, 400, 3)
    assert tuple(room[0, 0]) == (250, 0, 0)


def test_a_large_panorama_is_made_smaller() -> None:
    assert fit_room(np.zeros((3000, 6000, 3), np.uint8)).shape == (2048, 4096, 3)


def test_a_flat_photo_is_refused_with_its_name_and_size(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"flat\.png is 400 x 300.*360"):
        load_room(written(tmp_path / "flat.png", 400, 300))


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("hello")
    empty = tmp_path / "empty.jpg"
    empty.touch()
    for path in (text, empty):
        with pytest.raises(ConfigurationError, match=r"is not a picture.*PNG"):
            load_room(path)
    with pytest.raises(ConfigurationError, match=r"missing\.png: No such file"):
        load_room(tmp_path / "missing.png")


def test_generated_rooms_repeat_with_their_seed_only() -> None:
    one, same, other = (generate_room(seed, 256) for seed in (1, 1, 2))
    assert one.shape == (128, 256, 3)
    assert np.array_equal(one, same)
    assert np.abs(one.astype(int) - other).mean() > 5


def test_a_generated_room_closes_without_a_seam() -> None:
    room = generate_room(3, 512).astype(int)
    seam = np.abs(room[:, 0] - room[:, -1]).mean()
    elsewhere = np.abs(np.diff(room, axis=1)).mean()
    assert seam < 3 * elsewhere


def test_no_generated_room_is_as_red_as_the_object() -> None:
    for seed in range(5):
        red, green, blue = np.moveaxis(generate_room(seed, 256).astype(int), -1, 0)
        assert not ((red > 2 * green) & (red > 2 * blue) & (red > 90)).any()


def test_the_dome_faces_inwards_and_shows_the_photo_unmirrored() -> None:
    room = Room()
    dome = dome_mesh(room)
    a, b, c = (dome.vertices_m[dome.triangles[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    inwards = np.array([0, 0, room.photo_height_m]) - (a + b + c) / 3
    assert (np.einsum("ij,ij->i", normal, inwards) > 0).all()
    ahead = np.isclose(dome.texture[:, 0], 0.5)
    assert np.allclose(dome.vertices_m[ahead, 1], 0, atol=1e-5)
    assert (dome.vertices_m[ahead, 0] > 0).all()
    right = np.isclose(dome.texture[:, 0], 0.75)
    assert (dome.vertices_m[right, 1] < 0).all()  # the photo's right half is to the right


def test_the_dome_shows_every_point_in_the_direction_it_was_taken_in() -> None:
    room = Room()
    dome = dome_mesh(room)
    seen_from = dome.vertices_m - np.array([0, 0, room.photo_height_m])
    elevation = np.arcsin(seen_from[:, 2] / np.linalg.norm(seen_from, axis=1))
    assert np.allclose(dome.texture[:, 1], 0.5 - elevation / np.pi, atol=1e-5)


def test_the_floor_is_light_and_repeats_without_a_seam() -> None:
    tile = vinyl(0).picture.astype(int)
    assert 160 < tile.mean() < 220
    assert np.abs(tile[:, 0] - tile[:, -1]).mean() < 3
