"""A recorded drive as a page, a film and a sentence."""

import hashlib
import json
import re
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec import structs
from PIL import Image, ImageSequence
from typer.testing import CliRunner

from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision, Fault, State
from mbot_workstation.cli.drives import ReportOptions
from mbot_workstation.cli.drives import film as film_command
from mbot_workstation.cli.subcommands import app
from mbot_workstation.look.drives.attention import attention
from mbot_workstation.look.drives.drive_figures import HISTOGRAM_BINS, Latency, figures
from mbot_workstation.look.drives.drive_film import RATE_HZ, film
from mbot_workstation.look.drives.drive_page import drive_page
from mbot_workstation.look.drives.driven_path import PathPoint
from mbot_workstation.pictures.picture_file import encode_picture

from .called import output_of
from .hand_driven import hand_driven

called_film = partial(output_of, film_command)
RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"


def test_a_sentence_says_what_happened(drive: RecordedDrive) -> None:
    assert figures(drive).sentence == (
        "virtual was driven for 4.8 s by 93277d5c321b, 12 decisions, no beat missed. "
        "The recording ends while it still drives."
    )
    stopped = drive.beats[8]
    assert stopped.decision.state == State.STATE_STOPPED
    assert figures(replace(drive, beats=drive.beats[:9])).end == "It was stopped by root."


def test_of_a_hands_drive_is_said_whose_hand_and_what_the_wheels_were_told(tmp_path: Path) -> None:
    found = figures(read_drive(hand_driven(tmp_path / "drive")))
    assert found.sentence.startswith(
        "mbot-1 was driven for 1.6 s by 93277d5c321b, 4 decisions, "
        "driven by hand by anna@desk for 2.4 s, no beat missed."
    )
    assert [(left, right) for _, left, right in found.wheels[4:10]] == [(0.4, -0.2)] * 6
    assert "not driven" not in found.sentence
    log = [words for _, words in found.drive.log]
    assert "anna@desk drives by hand" in log
    assert "the 3.0 s before were wrong, says max" in log


def test_faults_missed_and_lost_beats_are_counted(drive: RecordedDrive) -> None:
    beats = list(drive.beats)
    for index in (3, 4, 6):
        beats[index].decision.faults.append(Fault(kind="camera-stalled", detail="no frame"))
    for beat in beats[5:]:
        beat.decision.missed_ticks = 2
    found = figures(replace(drive, beats=tuple(beats[:9] + beats[10:])))
    assert [(kind, detail) for _, kind, detail in found.faults] == [
        ("camera-stalled", "no frame")
    ] * 2
    assert (found.missed_beats, found.lost_records) == (2, 1)
    assert "2 beats missed; in the way: camera-stalled" in found.sentence


class Sources(HTMLParser):
    """Every address in a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.found += [
            value or "" for name, value in attrs if name in ("src", "href", "xlink:href")
        ]


def test_a_path_is_drawn_where_it_is_known(drive: RecordedDrive) -> None:
    began_ns = drive.beats[0].decision.unix_time_ns
    places = [
        PathPoint(began_ns + n * 10**8, (0.1 * n, 0.5), 0.0, (1.0, 2.0 if n < 5 else 3.0))
        for n in range(-3, 10)
    ]
    text = drive_page([figures(drive)], places)
    assert 'points="0.000,-0.500 0.100,-0.500' in text, "from this drive's beginning on, y up"
    assert text.count('fill="#c81e1e"') == 2
    before = [replace(place, unix_time_ns=1) for place in places]
    for none in ((), before):
        assert "<h2>Path</h2>" not in drive_page([figures(drive)], none)


def test_the_strip_shows_where_the_policy_looked(drive: RecordedDrive) -> None:
    one = figures(drive)
    looks, words = attention(one.chosen(24), [RECORDED / "seeing.onnx"])
    assert not words
    assert set(looks) == {beat.key for beat in drive.decided}
    text = drive_page([one], looks=[looks])
    assert text.count('class="looked"') == len(drive.decided)
    assert "what of it changes the wheels" in text
    assert "looked" not in drive_page([one]).partition("<body>")[2]


def test_the_strip_tells_two_lives_of_a_daemon_apart(drive: RecordedDrive) -> None:
    first = drive.decided[3]
    later = Decision()
    later.CopyFrom(first.decision)
    later.session_id += 1
    black = encode_picture(np.zeros((64, 64, 3), np.uint8), ".png", 0)
    second = replace(first, decision=later, encoded=black)
    looks, _ = attention([first, second], [RECORDED / "seeing.onnx"])
    assert looks[first.key].picture.any()
    assert not looks[second.key].picture.any(), "of its own picture"
    one = figures(replace(drive, beats=(first, second)))
    shown = re.findall(r'class="looked"[^>]* src="([^"]+)"', drive_page([one], looks=[looks]))
    assert len(set(shown)) == 2


def test_the_policy_looks_with_what_it_was_told_and_had_in_mind(drive: RecordedDrive) -> None:
    model = Path("models/red-cube.onnx")
    decision = Decision()
    decision.CopyFrom(drive.decided[3].decision)
    decision.model_sha256 = hashlib.sha256(model.read_bytes()).hexdigest()
    seen = []
    for told, memory in ((0.0, 0.0), (0.9, 0.0), (0.0, 0.5)):
        known = drive.decided[3].policy_input
        assert known is not None
        mind = np.full(128, memory, "<f4").tobytes()
        known = structs.replace(
            known, told_left=told, told_right=-told, memory=mind, began_anew=False
        )
        beat = replace(drive.decided[3], decision=decision, policy_input=known)
        seen.append(attention([beat], [model])[0][beat.key].picture)
    assert np.any(seen[0] != seen[1])
    assert np.any(seen[0] != seen[2])


def test_what_matters_glows_and_what_does_not_stays_gray(drive: RecordedDrive) -> None:
    beat = drive.decided[3]
    plain = np.full((64, 64, 3), 90, np.uint8)
    spotted = plain.copy()
    spotted[40:48, 8:16] = 255
    beats = [
        replace(beat, encoded=encode_picture(picture, ".png", 0)) for picture in (plain, spotted)
    ]
    looks = [attention([one], [RECORDED / "seeing.onnx"])[0] for one in beats]
    gray, glowing = (next(iter(look.values())).picture.astype(int) for look in looks)
    assert np.ptp(gray, axis=-1).max() == 0, "nothing is there to be hidden"
    glow = glowing[..., 0] - glowing[..., 2]
    assert glow[38:50, 6:18].max() > 40
    assert glow[:24, 32:].max() == 0


def test_a_model_that_is_not_here_or_telemetry_alone_is_said(
    drive: RecordedDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks, words = attention(drive.beats, [])
    assert not looks
    assert len(words) == 1
    assert "model 93277d5c321b drove" in words[0]
    telemetry = [replace(beat, policy_input=None) for beat in drive.beats]
    looks, words = attention(telemetry, [RECORDED / "seeing.onnx"])
    assert not looks
    assert "only telemetry" in words[0]
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["report", str(RECORDED)])
    assert result.exit_code == 0, result.output
    assert "where it looked is not shown: model 93277d5c321b" in result.stderr


def test_the_strip_has_every_picture_with_its_wheels(drive: RecordedDrive) -> None:
    text = drive_page([figures(drive)])
    assert text.count('class="bars"') == text.count("<img ") == len(drive.beats)
    steps = drive.beats[0].decision.steps
    left, right = round(100 * steps.left / 250), round(100 * steps.right / 250)
    assert f'aria-label="left wheel {left} %, right wheel {right} %"' in text


def test_the_page_needs_nothing_else(drive: RecordedDrive) -> None:
    text = drive_page([figures(drive), figures(drive)])
    sources = Sources()
    sources.feed(text)
    assert len(sources.found) == 2 * 13
    assert all(source.startswith("data:image/jpeg;base64,") for source in sources.found)
    assert not sources.tags & {"script", "link", "iframe"}
    assert "http" not in re.sub(r"base64,[^\"]*", "", text)
    assert text.count("was driven for") == 2
    assert "5 of 5 chunks read, it was never ended properly" in text


def test_what_a_robot_says_of_itself_is_no_markup(drive: RecordedDrive) -> None:
    drive.beats[3].decision.faults.append(Fault(kind="<script>", detail="<img src=x>"))
    text = drive_page([figures(drive)])
    assert "<script>" not in text
    assert "&lt;img src=x&gt;" in text


def test_a_histogram_counts_all() -> None:
    latency = Latency("decide", (0.0, 1.0, 1.0, 4.0, -0.5))
    counts = latency.histogram(4.0)
    assert len(counts) == HISTOGRAM_BINS
    assert (counts[0], counts[10], counts[-1], sum(counts)) == (2, 2, 1, 5)


def test_a_film_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "drive.mp4").write_bytes(b"another")
    with pytest.raises(ConfigurationError, match=r"drive.mp4 exists already; choose another name"):
        called_film(RECORDED, tmp_path / "drive.mp4")
    assert (tmp_path / "drive.mp4").read_bytes() == b"another"


def test_a_film_keeps_time(drive: RecordedDrive, tmp_path: Path) -> None:
    path = tmp_path / "drive.mp4"
    lasts_s = film(drive, path)
    assert lasts_s == pytest.approx(drive.duration_s + 0.4, abs=0.2)
    found = cv2.VideoCapture(str(path))
    assert found.get(cv2.CAP_PROP_FRAME_COUNT) == pytest.approx(lasts_s * RATE_HZ)
    whole, picture = found.read()
    assert whole
    assert picture.shape == (648, 512, 3)
    without = replace(drive, beats=tuple(replace(beat, encoded=b"") for beat in drive.beats))
    with pytest.raises(ConfigurationError, match="no pictures"):
        film(without, path)
    with pytest.raises(ConfigurationError, match="can't write a film"):
        film(drive, tmp_path / "none" / "drive.mp4")


def test_a_gif_keeps_time_too(drive: RecordedDrive, tmp_path: Path) -> None:
    path = tmp_path / "drive.gif"
    lasts_s = film(drive, path)
    assert lasts_s == pytest.approx(drive.duration_s + 0.4, abs=0.2)
    with Image.open(path) as found:
        assert found.size == (256, 324)
        frames = [frame.info["duration"] for frame in ImageSequence.Iterator(found)]
    assert sum(frames) == pytest.approx(1000 * lasts_s)
    with pytest.raises(ConfigurationError, match="can't write a film"):
        film(drive, tmp_path / "none" / "drive.gif")


def test_the_commands(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["report", str(RECORDED), "-o", str(page), "--json"])
    assert result.exit_code == 0, result.output
    (told,) = json.loads(result.stdout)["drives"]
    assert told["decisions"] == 12
    assert page.read_text().startswith("<!DOCTYPE html>")
    before = page.read_bytes()
    result = CliRunner().invoke(app, ["report", str(RECORDED), "-o", str(page)])
    assert isinstance(result.exception, ConfigurationError)
    assert "exists already" in str(result.exception)
    assert page.read_bytes() == before
    result = CliRunner().invoke(app, ["film", str(RECORDED), str(tmp_path / "drive.mp4")])
    assert "drive.mp4, 5.2 s" in result.output.replace("\n", "")
    assert ReportOptions(recordings=[RECORDED]).output == Path("drive.html")
