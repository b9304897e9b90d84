"""A page as an SVG, to be edited or cut by a plotter."""

from xml.sax.saxutils import escape

from mbot_workstation.measure.targets.sheet import Page


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
