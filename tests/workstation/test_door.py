import pytest

from mbot_workstation.look.console.door import Door, new_token

TOKEN = "k7Qe-secret_token"
PATH = f"/{TOKEN}/live"
HOST = "127.0.0.1:8700"
OWN = {"host": HOST, "origin": f"http://{HOST}"}


@pytest.fixture
def door() -> Door:
    return Door(TOKEN)


@pytest.mark.parametrize("host", [HOST, "localhost:9000", "[::1]:8700", "localhost"])
def test_the_console_itself_is_let_in_at_any_port_of_a_tunnel(door: Door, host: str) -> None:
    assert not door.refusal(PATH, {"host": host}, acts=False)
    assert not door.refusal(PATH, {"host": host, "origin": f"http://{host}"}, acts=True)


@pytest.mark.parametrize(
    "path",
    ["/", "", f"/{TOKEN}x/", f"/{TOKEN[:-1]}/", f"//{TOKEN}/", "/live", "/é/", f"/x/{TOKEN}"],
)
def test_without_the_token_nobody_gets_in(door: Door, path: str) -> None:
    assert "token" in door.refusal(path, OWN, acts=False)


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8700",
        "127.0.0.1.evil.example",
        "",
        "x@127.0.0.1:8700",
        "[",
        "a:b",
    ],
)
def test_a_name_that_somebody_else_points_to_this_machine_is_refused(door: Door, host: str) -> None:
    headers = {"host": host, "origin": f"http://{host}"}
    assert "host" in door.refusal(PATH, headers, acts=True)
    assert "host" in door.refusal(PATH, {"host": host}, acts=False)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:8700", "http://127.0.0.1:9999", ""]
)
def test_a_page_of_another_site_is_refused(door: Door, origin: str) -> None:
    assert "page" in door.refusal(PATH, {"host": HOST, "origin": origin}, acts=True)
    assert "page" in door.refusal(PATH, {"host": HOST, "origin": origin}, acts=False)


def test_whoever_acts_says_from_where(door: Door) -> None:
    assert "page" in door.refusal(PATH, {"host": HOST}, acts=True)


def test_tokens_are_long_and_never_the_same() -> None:
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 24
