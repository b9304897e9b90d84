"""A page as a PDF, the one format every printer prints at its exact size.

One page, filled paths and Helvetica, which every reader has. matplotlib's writer draws as well, but
cannot tell the printer not to scale, which is what spoils a printed board most often.
Structure and operators: ISO 32000-1, 7.5 and 8.5.
"""

from mbot_workstation.measure.targets.sheet import Page, Text

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
