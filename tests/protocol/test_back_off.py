from mbot_protocol.back_off import BackOff


def test_the_first_attempts_come_soon_and_the_last_wait_repeats() -> None:
    back_off = BackOff()
    assert [back_off.next_s() for _ in range(6)] == [0.2, 0.5, 1.0, 2.0, 2.0, 2.0]


def test_a_success_starts_over() -> None:
    back_off = BackOff()
    for _ in range(3):
        back_off.next_s()
    back_off.succeeded()
    assert back_off.next_s() == 0.2
