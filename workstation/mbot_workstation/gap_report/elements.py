"""Small pieces of HTML. Text is escaped here; what is HTML already says so by its name."""

import base64
from collections.abc import Sequence
from html import escape
from typing import cast

import cv2

from mbot_protocol.picture import Picture

JPEG_QUALITY = 88


def paragraph(text: str, style: str = "") -> str:
    """Plain text."""
    return f"<p{_class(style)}>{escape(text)}</p>"


def table(header: Sequence[str], rows: Sequence[Sequence[str]], numbers: int = 0) -> str:
    """Plain text in cells; of every row the last `numbers` are to the right."""
    words = len(header) - numbers
    head = "".join(
        f"<th{_number(place >= words)}>{escape(c)}</th>" for place, c in enumerate(header)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{_number(place >= words)}>{escape(c)}</td>" for place, c in enumerate(row))
        + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><tr>{head}</tr>{body}</table></div>'


def figure(content_html: str, caption: str, title: str = "") -> str:
    """A chart or picture with its caption below and its title above."""
    head = f"<h3>{escape(title)}</h3>" if title else ""
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{head}{content_html}{below}</figure>"


def picture(pixels: Picture, words: str) -> str:
    """A picture inside the page; small ones exactly, their pixels shown as squares."""
    is_small = pixels.shape[1] <= 128
    options = [] if is_small else [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    kind = "png" if is_small else "jpg"
    bgr = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(f".{kind}", bgr, options)
    data = base64.b64encode(cast(bytes, encoded.tobytes())).decode()
    style = ' class="small"' if is_small else ""
    mime = "image/png" if is_small else "image/jpeg"
    return f'<img{style} alt="{escape(words)}" src="data:{mime};base64,{data}">'


def _class(style: str) -> str:
    return f' class="{style}"' if style else ""


def _number(is_number: bool) -> str:
    return ' class="number"' if is_number else ""
