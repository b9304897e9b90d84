from mbot_agent.configuration import Access
from mbot_agent.network.session_guard import (
    BANNED_S,
    LARGEST_RATE,
    LOOK_EVERY_S,
    MOST_A_NAME,
    Doorkeeper,
    Visitor,
)
from mbot_protocol.keys import Right

ACCESS = Access(
    people={"vera": (Right.VIEW,), "paul": (Right.PUSH,)},
    routers=("lab",),
)


def visitor(name: str | None, port: int) -> Visitor:
    return Visitor(name, ("10.0.0.7", port), f"session {port}")


def test_who_is_on_the_roll_stays_and_who_is_not_goes() -> None:
    known = [visitor("person:vera", 1), visitor("router:lab", 2), visitor(None, 3)]
    strangers = [visitor("person:nick", 4), visitor("robot:mbot-2", 5), visitor("vera", 6)]
    found = Doorkeeper(ACCESS).unwelcome([(one, 0) for one in (*known, *strangers)], 0.0)
    assert set(found) == set(strangers)


def test_one_name_has_a_few_places_and_the_first_to_come_stay() -> None:
    keeper = Doorkeeper(ACCESS)
    first = [visitor("person:vera", port) for port in range(MOST_A_NAME)]
    assert keeper.unwelcome([(one, 0) for one in first], 0.0) == {}
    late = visitor("person:vera", 99)
    other = visitor("person:paul", 100)
    assert set(keeper.unwelcome([(one, 0) for one in (late, other, *first)], 1.0)) == {late}
    assert keeper.unwelcome([(one, 0) for one in (late, *first[1:])], 2.0) == {}


def test_a_router_brings_as_many_as_it_likes() -> None:
    many = [(visitor("router:lab", port), 0) for port in range(20)]
    assert Doorkeeper(ACCESS).unwelcome(many, 0.0) == {}


def test_who_may_only_look_and_floods_is_shown_out_for_a_while() -> None:
    keeper = Doorkeeper(ACCESS)
    vera, paul = visitor("person:vera", 1), visitor("person:paul", 2)
    quick = round(LARGEST_RATE * LOOK_EVERY_S * 1.5)
    assert keeper.unwelcome([(vera, 0), (paul, 0)], 10.0) == {}
    assert keeper.unwelcome([(vera, quick // 3), (paul, 9 * quick)], 10.0 + LOOK_EVERY_S) == {}
    flood = quick + quick // 3
    assert set(keeper.unwelcome([(vera, flood), (paul, 0)], 10.0 + 2 * LOOK_EVERY_S)) == {vera}
    again = visitor("person:vera", 3)
    assert set(keeper.unwelcome([(again, 0)], 15.0)) == {again}
    assert keeper.unwelcome([(again, 0)], 11.0 + BANNED_S) == {}
