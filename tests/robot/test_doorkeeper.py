from mbot_agent.configuration import Access
from mbot_agent.network.doorkeeper import (
    BANNED_S,
    LARGEST_RATE,
    LOOK_EVERY_S,
    MOST_A_NAME,
    MOST_MESSAGES,
    MOST_UNREAD,
    NEWCOMER_S,
    UNREAD_WITHIN_S,
    Doorkeeper,
    Traffic,
    Visitor,
)
from mbot_protocol.wire.keys import Right

ACCESS = Access(
    people={"vera": (Right.VIEW,), "paul": (Right.PUSH,), "dora": (Right.DRIVE,)},
    routers=("lab",),
)


def visitor(name: str | None, port: int) -> Visitor:
    return Visitor(name, ("10.0.0.7", port), f"session {port}")


def looks(keeper: Doorkeeper, seen: dict[Visitor, Traffic], now_s: float) -> set[Visitor]:
    return set(keeper.unwelcome(seen.items(), now_s))


def test_who_is_on_the_roll_stays_and_who_is_not_goes() -> None:
    known = [visitor("person:vera", 1), visitor("router:lab", 2), visitor(None, 3)]
    strangers = [visitor("person:nick", 4), visitor("robot:mbot-2", 5), visitor("vera", 6)]
    found = Doorkeeper(ACCESS).unwelcome([(one, Traffic()) for one in (*known, *strangers)], 0.0)
    assert set(found) == set(strangers)


def test_one_name_has_a_few_places_and_the_first_to_come_stay() -> None:
    keeper = Doorkeeper(ACCESS)
    first = {visitor("person:vera", port): Traffic() for port in range(MOST_A_NAME)}
    assert looks(keeper, first, 0.0) == set()
    late, later = visitor("person:vera", 99), visitor("person:vera", 101)
    other = {visitor("person:paul", 100): Traffic()}
    assert looks(keeper, first | other | {late: Traffic(), later: Traffic()}, 1.0) == {later}
    assert looks(keeper, first | other | {late: Traffic()}, 1.0 + NEWCOMER_S) == {late}
    (gone, *_) = first
    del first[gone]
    assert looks(keeper, first | {late: Traffic()}, 3.0) == set()


def test_a_router_brings_as_many_as_it_likes() -> None:
    many = [(visitor("router:lab", port), Traffic()) for port in range(20)]
    assert Doorkeeper(ACCESS).unwelcome(many, 0.0) == {}


def test_who_may_only_look_and_floods_is_shown_out_for_a_while() -> None:
    keeper = Doorkeeper(ACCESS)
    vera, paul = visitor("person:vera", 1), visitor("person:paul", 2)
    quick = round(LARGEST_RATE * LOOK_EVERY_S * 1.5)
    assert looks(keeper, {vera: Traffic(), paul: Traffic()}, 10.0) == set()
    calm = {vera: Traffic(quick // 3), paul: Traffic(9 * quick)}
    assert looks(keeper, calm, 10.0 + LOOK_EVERY_S) == set()
    flood = {vera: Traffic(quick + quick // 3), paul: Traffic(9 * quick)}
    assert looks(keeper, flood, 10.0 + 2 * LOOK_EVERY_S) == {vera}
    again = visitor("person:vera", 3)
    assert looks(keeper, {again: Traffic()}, 15.0) == {again}
    assert looks(keeper, {again: Traffic()}, 11.0 + BANNED_S) == set()


def test_messages_are_counted_of_all_sessions_of_a_name() -> None:
    """Few bytes, but each of them a question: no session alone asks too often."""
    keeper = Doorkeeper(ACCESS)
    sessions = [visitor("person:vera", port) for port in range(3)]
    paul = visitor("person:paul", 9)

    def at(now_s: float, messages: int) -> set[Visitor]:
        seen = {one: Traffic(received_segments=messages) for one in sessions}
        return looks(keeper, seen | {paul: Traffic(received_segments=50 * messages)}, now_s)

    a_look = MOST_MESSAGES * LOOK_EVERY_S / len(sessions)
    calm = [at(n * LOOK_EVERY_S, round(0.9 * n * a_look)) for n in range(100)]
    assert calm == [set()] * 100
    begun = round(0.9 * 99 * a_look)
    found = [at((99 + n) * LOOK_EVERY_S, begun + round(3 * n * a_look)) for n in range(1, 12)]
    assert found[0] == set(), "a burst is no flood"
    assert set(sessions) & found[-1]
    assert all(paul not in gone for gone in found), "a push sends as much as it likes"


def test_who_does_not_read_is_shown_out_and_may_come_again_twice() -> None:
    keeper = Doorkeeper(ACCESS)
    now_s = 1000.0
    for times in range(MOST_UNREAD + 1):
        paul = visitor("person:paul", times)
        assert looks(keeper, {paul: Traffic()}, now_s) == set()
        unread_us = round(LOOK_EVERY_S * 1e6)
        assert looks(keeper, {paul: Traffic(0, 0, unread_us)}, now_s + LOOK_EVERY_S) == set()
        gone = looks(keeper, {paul: Traffic(0, 0, 2 * unread_us)}, now_s + 2 * LOOK_EVERY_S)
        assert gone == {paul}
        now_s += 1.0
    again = visitor("person:paul", 9)
    assert looks(keeper, {again: Traffic()}, now_s) == {again}
    assert looks(keeper, {again: Traffic()}, now_s + BANNED_S) == set()


def test_a_short_wait_for_a_slow_reader_is_nothing() -> None:
    keeper = Doorkeeper(ACCESS)
    vera = visitor("person:vera", 1)
    unread_us = 0
    for look in range(20):
        unread_us += round(LOOK_EVERY_S * 1e6) if look % 2 else 0
        assert looks(keeper, {vera: Traffic(0, 0, unread_us)}, look * LOOK_EVERY_S) == set()


def test_when_too_much_is_held_all_go_who_may_only_look_or_drive_and_nobody_is_kept_away() -> None:
    """Nobody tells for whom it is held: who has driven for an hour has sent the most."""
    keeper = Doorkeeper(ACCESS)
    vera, dora = visitor("person:vera", 1), visitor("person:dora", 3)
    others = [visitor("person:paul", 4), visitor(None, 5), visitor("router:lab", 6)]
    assert set(keeper.hoarders([vera, dora, *others])) == {vera, dora}
    back = [visitor("person:dora", 7), visitor("person:vera", 8)]
    assert looks(keeper, {one: Traffic() for one in back}, 2.0) == set()


def test_a_fifth_session_that_comes_again_and_again_costs_the_four_nothing() -> None:
    """Zenoh's client reconnects by itself, and each handshake is a dozen messages."""
    keeper = Doorkeeper(ACCESS)
    four = {visitor("person:vera", port): Traffic() for port in range(MOST_A_NAME)}
    fifth = visitor("person:vera", 100)
    for look in range(100):
        fifth = visitor("person:vera", 100 + look)
        seen = four | {fifth: Traffic(20_000, 300)}
        assert looks(keeper, seen, look * LOOK_EVERY_S) == set()
    assert looks(keeper, four | {fifth: Traffic(90_000, 900)}, 9.9 + NEWCOMER_S) == {fifth}
    assert looks(keeper, four, 12.0) == set(), "and it was no flood of theirs"


def test_a_handshake_is_no_message() -> None:
    keeper = Doorkeeper(ACCESS)
    for look in range(100):
        comes_and_goes = visitor("person:vera", look)
        assert looks(keeper, {comes_and_goes: Traffic(9_000, 60)}, look * LOOK_EVERY_S) == set()


def test_a_guest_of_long_standing_has_sent_much_and_stays() -> None:
    """Megabytes in all, a little at a time; and what came before the first look is no flood."""
    keeper = Doorkeeper(ACCESS)
    vera = visitor("person:vera", 1)
    for look in range(100):
        seen = Traffic(10_000_000 + 5_000 * look, 100_000 + 20 * look, 5 * 10**6)
        if look == 0:
            seen = Traffic(seen.received_bytes, 20, seen.unread_us)
            assert looks(keeper, {vera: seen}, 1000.0) == set()
            continue
        begun = Traffic(seen.received_bytes, 20 * (look + 1), seen.unread_us)
        assert looks(keeper, {vera: begun}, 1000.0 + look * LOOK_EVERY_S) == set()


def test_a_burst_is_one_seconds_and_no_more() -> None:
    for messages, goes in ((0.9 * MOST_MESSAGES, False), (1.5 * MOST_MESSAGES, True)):
        keeper = Doorkeeper(ACCESS)
        vera = visitor("person:vera", 1)
        assert looks(keeper, {vera: Traffic()}, 10.0) == set()
        seen = {vera: Traffic(received_segments=round(messages))}
        assert bool(looks(keeper, seen, 10.0 + LOOK_EVERY_S)) is goes


def test_looks_in_quick_succession_are_one() -> None:
    """Whoever comes or goes makes the guard look."""
    keeper = Doorkeeper(ACCESS)
    vera = visitor("person:vera", 1)
    for passed_s in (0.0, 0.01, 0.02, 0.034, 0.068):
        seen = {vera: Traffic(unread_us=round(passed_s * 1e6))}
        assert looks(keeper, seen, 10.0 + passed_s) == set()
    assert looks(keeper, {vera: Traffic(unread_us=150_000)}, 10.15) == {vera}


def test_who_reads_half_of_the_time_reads() -> None:
    keeper = Doorkeeper(ACCESS)
    vera = visitor("person:vera", 1)
    for look in range(20):
        now_s = 10.0 + look * LOOK_EVERY_S
        unread_us = round(look * LOOK_EVERY_S * 0.5e6)
        assert looks(keeper, {vera: Traffic(unread_us=unread_us)}, now_s) == set()


def test_who_fell_asleep_long_ago_may_do_so_again() -> None:
    keeper = Doorkeeper(ACCESS)
    for times in range(2 * MOST_UNREAD + 2):
        now_s = 1000.0 + times * UNREAD_WITHIN_S
        paul = visitor("person:paul", times)
        for look in range(3):
            seen = {paul: Traffic(unread_us=round(look * LOOK_EVERY_S * 1e6))}
            gone = looks(keeper, seen, now_s + look * LOOK_EVERY_S)
            assert gone == ({paul} if look == 2 else set())
        assert looks(keeper, {visitor("person:paul", 99): Traffic()}, now_s + 1.0) == set()


def test_nobody_is_a_hoarder_where_nobody_is() -> None:
    keeper = Doorkeeper(ACCESS)
    assert keeper.hoarders([]) == {}
    assert keeper.hoarders([visitor("person:paul", 1)]) == {}


def test_who_has_gone_is_forgotten() -> None:
    """A daemon runs for months."""
    keeper = Doorkeeper(ACCESS)
    for port in range(1000):
        looks(keeper, {visitor("person:vera", port): Traffic()}, 10.0 + port * LOOK_EVERY_S)
    kept = (keeper._since_s, keeper._before, keeper._deaf_looks)  # pyright: ignore
    assert [len(one) for one in kept] == [1, 1, 1]
