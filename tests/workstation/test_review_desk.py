"""What is said on the review page is written beside its drive, and nowhere else."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.look.collect.review_desk import ReviewDesk
from mbot_workstation.look.collect.reviews import Place, read_review

from .hand_driven import hand_driven


@pytest.fixture
def desk(tmp_path: Path) -> ReviewDesk:
    hand_driven(tmp_path / "drives" / "mbot-1" / "drive-0001")
    hand_driven(tmp_path / "elsewhere" / "drive-0002")
    return ReviewDesk(tmp_path / "drives")


def test_what_is_said_is_written_and_shown(desk: ReviewDesk, tmp_path: Path) -> None:
    assert desk.change(b'{"drive": "mbot-1/drive-0001", "verdict": "keep"}').endswith("keep")
    desk.change(b'{"drive": "mbot-1/drive-0001", "beat": 104, "place": {"x": 0.2, "y": 0.3}}')
    desk.change(b'{"drive": "mbot-1/drive-0001", "beat": 105, "place": null}')
    review = read_review(tmp_path / "drives" / "mbot-1" / "drive-0001")
    assert (review.verdict, review.labels) == ("keep", {"104": Place(0.2, 0.3), "105": None})
    page, nonce = desk.page()
    assert "1 kept" in page
    assert page.count(f'nonce="{nonce}"') == 2
    assert desk.page()[1] != nonce
    assert 'data-live="1"' in page


@pytest.mark.parametrize(
    "said",
    [
        b'{"drive": "../elsewhere/drive-0002", "verdict": "keep"}',
        b'{"drive": "/etc/passwd", "verdict": "keep"}',
        b'{"drive": "mbot-1", "verdict": "keep"}',
        b'{"drive": "mbot-1/drive-0001"}',
        b'{"drive": "mbot-1/drive-0001", "verdict": "burn"}',
        b'{"drive": "mbot-1/drive-0001", "verdict": "keep", "beat": 104}',
        b'{"drive": "mbot-1/drive-0001", "beat": 9}',
        b'{"drive": "mbot-1/drive-0001", "beat": 104, "place": {"x": 7, "y": 0}}',
        b"[" * 4000,
    ],
)
def test_what_cannot_be_said_changes_nothing(desk: ReviewDesk, tmp_path: Path, said: bytes) -> None:
    with pytest.raises(ConfigurationError):
        desk.change(said)
    assert not list(tmp_path.rglob("*.review.json"))


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=80))
def test_noise_is_refused(desk: ReviewDesk, said: bytes) -> None:
    with pytest.raises(ConfigurationError):
        desk.change(said)


def test_an_empty_folder_says_how_to_fill_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="recordings fetch"):
        ReviewDesk(tmp_path).page()
