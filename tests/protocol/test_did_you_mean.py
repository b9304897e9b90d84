import pytest

from mbot_protocol.did_you_mean import did_you_mean


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("frame_rat_hz", "; did you mean frame_rate_hz?"),
        ("Port", "; did you mean port?"),
        ("colour", ""),
    ],
)
def test_the_nearest_known_word_is_offered(word: str, said: str) -> None:
    assert did_you_mean(word, ["frame_rate_hz", "port"]) == said
