"""A page as a file of its exact size: PNG, SVG or PDF.

The PDF is one page of filled paths and Helvetica, which every reader has. matplotlib's writer draws
as well, but cannot tell the printer not to scale, which is what spoils a printed board most often.
Structure and operators: ISO 32000-1, 7.5 and 8.5.
"""

from io import BytesIO
from pathlib import Path
from xml.sax.saxutils import escape

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.measure.targets.sheet import Page, Text

DOTS_A_MM = 300 / 25.4
"""300 dots an inch: the edge of a cell of a marker is within 0.04 mm, less than paper moves."""

_SHIFT = 8
"""Bits after the point in the coordinates that OpenCV fills polygons with."""


def draw(page: Page, dots_a_mm: float = DOTS_A_MM) -> NDArray[np.uint8]:
    """The page as a grey picture. Shape (height, width)."""
    size = round(page.height_mm * dots_a_mm), round(page.width_mm * dots_a_mm)
    picture = np.full(size, 255, np.uint8)
    for shape in page.shapes:
        for polygon in shape.polygons:
            # OpenCV counts from the middle of a dot and fills the last one too.
            corners = (np.array(polygon) * dots_a_mm - 0.5) * 2**_SHIFT
            inner = corners + np.sign(corners.mean(axis=0) - corners) * 2 ** (_SHIFT - 1)
            level = round(255 * shape.grey)
            cv2.fillPoly(picture, [np.round(inner).astype(np.int32)], level, shift=_SHIFT)
    for text in page.texts:
        at = round(text.at[0] * dots_a_mm), round(text.at[1] * dots_a_mm)
        scale = text.size_mm * dots_a_mm / 34  # of OpenCV's letters, which are this high at 1
        thick = max(1, round(0.12 * text.size_mm * dots_a_mm))
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(picture, text.words, at, font, scale, 0, thick, cv2.LINE_AA)
    return picture


def to_png(page: Page) -> bytes:
    """The page as the bytes of a PNG file with its dots per metre in it."""
    file = BytesIO()
    dots_an_inch = DOTS_A_MM * 25.4
    Image.fromarray(draw(page)).save(file, "PNG", dpi=(dots_an_inch, dots_an_inch))
    return file.getvalue()


def to_svg(page: Page) -> bytes:
    """The page as the bytes of an SVG file; its units are millimetres."""
    width, height = f"{page.width_mm:g}", f"{page.height_mm:g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f"<title>{escape(page.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for shape in page.shapes:
        level = round(255 * shape.grey)
        outlines = " ".join(
            "M " + " L ".join(f"{x:.4f} {y:.4f}" for x, y in polygon) + " Z"
            for polygon in shape.polygons
        )
        lines.append(f'<path fill="rgb({level},{level},{level})" d="{outlines}"/>')
    for text in page.texts:
        x, y = text.at
        lines.append(
            f'<text x="{x:.4f}" y="{y:.4f}" font-family="Helvetica, Arial, sans-serif" '
            f'font-size="{text.size_mm:g}">{escape(text.words)}</text>'
        )
    return "\n".join([*lines, "</svg>", ""]).encode()


POINTS_A_MM = 72 / 25.4


def to_pdf(page: Page) -> bytes:
    """The page as the bytes of a PDF file."""
    content = _content(page).encode("latin-1", "replace")
    size = f"{page.width_mm * POINTS_A_MM:.4f} {page.height_mm * POINTS_A_MM:.4f}"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size}] /Contents 5 0 R "
        "/Resources << /Font << /F1 4 0 R >> >> >>".encode(),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Title (%s) >>" % _escaped(page.title).encode("latin-1", "replace"),
    ]
    data = b"%PDF-1.4\n"
    places: list[int] = []
    for number, body in enumerate(objects, start=1):
        places.append(len(data))
        data += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    return data + (
        b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R /Info 6 0 R >>\n"
        b"startxref\n%d\n%%%%EOF\n" % (len(objects) + 1, table, len(objects) + 1, len(data))
    )


def _content(page: Page) -> str:
    """The drawing operators. A PDF counts y up from the lower edge, in points."""
    # From here on in millimetres from the upper left corner, as the page is.
    lines = [f"{POINTS_A_MM:.8f} 0 0 {-POINTS_A_MM:.8f} 0 {page.height_mm * POINTS_A_MM:.4f} cm"]
    for shape in page.shapes:
        lines.append(f"{shape.grey:g} g")
        for polygon in shape.polygons:
            corners = [f"{x:.4f} {y:.4f}" for x, y in polygon]
            lines.append(f"{corners[0]} m " + " ".join(f"{at} l" for at in corners[1:]) + " h")
        lines.append("f")
    lines.append("0 g")
    lines += [_text(text) for text in page.texts]
    return "\n".join(lines)


def _text(text: Text) -> str:
    x, y = text.at
    # Its own matrix turns the letters the right way up again.
    return f"BT /F1 {text.size_mm:g} Tf 1 0 0 -1 {x:.4f} {y:.4f} Tm ({_escaped(text.words)}) Tj ET"


def _escaped(words: str) -> str:
    return words.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")


_ENCODINGS = {".pdf": to_pdf, ".svg": to_svg, ".png": to_png}


def save_page(path: Path, page: Page) -> None:
    """Write it as its ending says; raises ConfigurationError for another, or if it can't be."""
    encode = _ENCODINGS.get(path.suffix.lower())
    if encode is None:
        raise ConfigurationError(
            f"can't write {path}: expected a file ending in .pdf, .svg or .png"
        )
    atomic_file.save(path, encode(page))
