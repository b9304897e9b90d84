import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.link.address import parse_address


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        ("", "tcp/127.0.0.1:7447"),
        ("mbot-1.local", "tcp/mbot-1.local:7447"),
        (" 10.0.0.7:7000 ", "tcp/10.0.0.7:7000"),
        ("tcp/mbot:1", "tcp/mbot:1"),
        ("tls/mbot", "tls/mbot:7447"),
        ("[::1]:7000", "tcp/[::1]:7000"),
        ("tcp/[fe80::1]", "tcp/[fe80::1]:7447"),
    ],
)
def test_every_form_becomes_an_endpoint_that_reads_back(text: str, endpoint: str) -> None:
    assert str(parse_address(text)) == endpoint
    assert str(parse_address(endpoint)) == endpoint


@pytest.mark.parametrize(("text", "endpoint"), [("m", "tls/m:7447"), ("", "tls/127.0.0.1:7447")])
def test_certificates_make_tls_the_default(text: str, endpoint: str) -> None:
    assert str(parse_address(text, secured=True)) == endpoint
    assert parse_address("tcp/m", secured=True).protocol == "tcp"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("udp/mbot", "'udp'"),
        ("mbot:0", "port 0"),
        ("mbot:70000", "port 70000"),
        ("mbot:many", "no host and port"),
        ("fe80::1", "brackets"),
        ("a b", "expected HOST"),
        ("tcp/", "expected HOST"),
        ("http://mbot/", "expected HOST"),
        ("mbot#iface=eth0", "expected HOST"),
    ],
)
def test_a_bad_address_says_what_is_wrong(text: str, word: str) -> None:
    with pytest.raises(ConfigurationError, match=word):
        parse_address(text)
