import re
import struct
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.print_targets import app
from mbot_workstation.measure.calibration.camera.board_detection import find_board
from mbot_workstation.measure.targets.sheet import cells
from mbot_workstation.measure.targets.specifications import (
    CARD_MARKER_IDS,
    MARKER_DICTIONARY,
    ROBOT_MARKER_EDGE_MM,
    ROBOT_MARKER_ID,
    Board,
    dictionary,
)

DOTS_A_MM = 6.0


def run(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def filled(outlines: list[tuple[float, NDArray]], width_mm: float, height_mm: float) -> NDArray:
    """A picture of outlines in millimetres, each with its grey."""
    picture = np.full((round(height_mm * DOTS_A_MM), round(width_mm * DOTS_A_MM)), 255, np.uint8)
    for grey, outline in outlines:
        corners = np.round(((outline * DOTS_A_MM) - 0.5) * 256).astype(np.int32)
        cv2.fillPoly(picture, [corners], round(255 * grey), shift=8)
    return picture


def pdf_picture(data: bytes) -> NDArray:
    """What the path operators of the PDF's page draw, in its own coordinates."""
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data)
    stream = re.search(rb"/Length (\d+) >>\nstream\n(.*)\nendstream", data, re.DOTALL)
    assert box
    assert stream
    assert len(stream[2]) == int(stream[1])
    width_pt, height_pt = float(box[1]), float(box[2])
    scale, right, down, shift = 1.0, 1.0, 1.0, 0.0
    grey, points, paths = 0.0, [], []
    outlines: list[tuple[float, NDArray]] = []
    for line in stream[2].decode("latin-1").splitlines():
        words = line.split()
        if words[-1] == "cm":
            right, down, shift = float(words[0]), float(words[3]), float(words[5])
        elif words[-1] == "g":
            grey = float(words[0])
        elif words[-1] == "h":
            points = re.findall(r"(-?[\d.]+) (-?[\d.]+) [ml]", line)
            paths.append(np.array(points, float))
        elif words == ["f"]:
            outlines += [(grey, path) for path in paths]
            paths = []
    scale = 25.4 / 72
    placed = []
    for grey, outline in outlines:
        x, y = outline[:, 0] * right, height_pt - (outline[:, 1] * down + shift)
        placed.append((grey, np.column_stack([x, y]) * scale))
    return filled(placed, width_pt * scale, height_pt * scale)


def svg_picture(data: bytes) -> NDArray:
    root = ET.fromstring(data)
    width, height = (float(root.attrib[name].removesuffix("mm")) for name in ("width", "height"))
    assert root.attrib["viewBox"] == f"0 0 {width:g} {height:g}"
    outlines = []
    for path in root.iter("{http://www.w3.org/2000/svg}path"):
        level = int(re.findall(r"\d+", path.attrib["fill"])[0])
        for outline in path.attrib["d"].split("Z")[:-1]:
            points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", outline), float)
            outlines.append((level / 255, points))
    return filled(outlines, width, height)


def png_picture(data: bytes) -> tuple[NDArray, float]:
    """The picture and its dots a millimetre."""
    at = data.index(b"pHYs")
    across, down, unit = struct.unpack(">IIB", data[at + 4 : at + 13])
    assert (across, unit) == (down, 1)
    assert struct.unpack(">I", data[at + 13 : at + 17])[0] == zlib.crc32(data[at : at + 13])
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    return np.asarray(picture), across / 1000


def page(path: Path) -> tuple[NDArray, float]:
    """What a file shows, and how many dots a millimetre has."""
    data = path.read_bytes()
    if path.suffix == ".png":
        return png_picture(data)
    return (pdf_picture(data) if path.suffix == ".pdf" else svg_picture(data)), DOTS_A_MM


@pytest.mark.parametrize("ending", ["pdf", "svg", "png"])
@pytest.mark.parametrize("charuco", [False, True])
def test_a_printed_board_is_found_at_its_exact_size(
    tmp_path: Path, ending: str, charuco: bool
) -> None:
    path = tmp_path / f"board.{ending}"
    options = ["--charuco"] if charuco else []
    said = run("board", *options, "--paper", "letter", "-o", str(path))
    assert "279.4 x 215.9 mm" in said
    picture, dots_a_mm = page(path)
    assert picture.shape == pytest.approx((215.9 * dots_a_mm, 279.4 * dots_a_mm), abs=1)
    board = Board(charuco=charuco)
    found = find_board(picture, board)
    assert found is not None
    assert found.mirrored is False
    assert len(found.points_m) == 63
    measured_mm, wanted_mm = found.corners_px / dots_a_mm, found.points_m[:, :2] * 1000
    assert np.linalg.norm(measured_mm[-1] - measured_mm[0]) == pytest.approx(200, abs=0.1)
    if charuco:
        moved = measured_mm - wanted_mm
        assert np.abs(moved - moved.mean(axis=0)).max() < 0.15


def markers(picture: NDArray) -> dict[int, NDArray]:
    found, numbers, _ = cv2.aruco.ArucoDetector(dictionary(MARKER_DICTIONARY)).detectMarkers(
        picture
    )
    return {
        int(n): np.asarray(corners).reshape(4, 2)
        for n, corners in zip(np.ravel(numbers), found, strict=True)
    }


@pytest.mark.parametrize("ending", ["pdf", "svg", "png"])
def test_the_robots_marker_points_its_upper_edge_forward(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"marker.{ending}"
    run("marker", "-o", str(path))
    picture, dots_a_mm = page(path)
    corners = markers(picture)[ROBOT_MARKER_ID] / dots_a_mm
    assert np.linalg.norm(corners[1] - corners[0]) == pytest.approx(ROBOT_MARKER_EDGE_MM, abs=0.4)
    assert corners[0][1] == pytest.approx(corners[1][1], abs=0.3)
    assert corners[3][1] > corners[0][1], "upright on the page, below the arrow"
    above = picture[: int(corners[0][1] * dots_a_mm) - 5]
    rows = np.flatnonzero(above[:, int(picture.shape[1] / 2)] < 100)
    assert np.ptp(rows) / dots_a_mm > 8, "the arrow"


def test_the_frame_for_the_gray_card_has_its_four_markers_in_order(tmp_path: Path) -> None:
    path = tmp_path / "frame.pdf"
    run("gray-card", "-o", str(path))
    middles = {n: corners.mean(axis=0) for n, corners in markers(page(path)[0]).items()}
    upper_left, upper_right, lower_right, lower_left = (middles[n] for n in CARD_MARKER_IDS)
    assert upper_left[0] == lower_left[0] < upper_right[0] == lower_right[0]
    assert upper_left[1] == upper_right[1] < lower_left[1] == lower_right[1]


def test_the_scale_to_check_the_print_with_is_100_mm(tmp_path: Path) -> None:
    path = tmp_path / "board.svg"
    run("board", "-o", str(path))
    picture = svg_picture(path.read_bytes())
    bottom = picture[int(picture.shape[0] - 12 * DOTS_A_MM) :]
    columns = np.flatnonzero((bottom < 100).any(axis=0))
    assert np.ptp(columns) / DOTS_A_MM == pytest.approx(100, abs=0.5)


def test_a_pdfs_table_of_objects_is_right(tmp_path: Path) -> None:
    path = tmp_path / "board.pdf"
    run("board", "-o", str(path))
    data = path.read_bytes()
    start = re.search(rb"startxref\n(\d+)\n%%EOF\n$", data)
    assert start
    table = data[int(start[1]) :]
    assert table.startswith(b"xref\n0 7\n")
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n ", table), start=1):
        assert data[int(place) :].startswith(b"%d 0 obj" % number)
    assert b"/PrintScaling /None" in data


@given(st.lists(st.lists(st.booleans(), min_size=5, max_size=5), min_size=1, max_size=5))
def test_cells_cover_just_the_black_ones(rows: list[list[bool]]) -> None:
    black = np.array(rows)
    painted = np.zeros(black.shape, int)
    for outline in cells(black, 2.0, 3.0, 0.5):
        (left, top), (right, bottom) = outline[0], outline[2]
        rows_at = slice(round((top - 3) / 0.5), round((bottom - 3) / 0.5))
        painted[rows_at, round((left - 2) / 0.5) : round((right - 2) / 0.5)] += 1
    assert (painted == black).all()


def test_what_does_not_fit_or_cannot_be_written_is_named(tmp_path: Path) -> None:
    for arguments, message in (
        (("board", "--square-mm", "40"), "400 x 320 mm, A4 has room for .*squares of 23 mm"),
        (("board", "--columns", "2"), "2 x 8 squares, expected 4 to 30"),
        (("board", "--charuco", "--columns", "20", "--rows", "20"), "has 100 markers"),
        (("board", "--paper", "a5"), "--paper is 'a5'"),
        (("board", "-o", "board.docx"), r"ending in \.pdf"),
        (("board", "-o", str(tmp_path / "none" / "board.pdf")), "No such file"),
        (("marker", "--edge-mm", "200"), "choose a smaller one"),
        (("gray-card", "--card-mm", "300", "200"), "does not fit"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            run(*arguments)


def test_a_board_that_cannot_tell_a_mirror_is_noted(tmp_path: Path) -> None:
    assert "mirrored" in run("board", "--columns", "9", "-o", str(tmp_path / "b.svg"))
    assert "mirrored" not in run("board", "-o", str(tmp_path / "b.svg"))
