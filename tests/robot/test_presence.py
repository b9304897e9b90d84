import threading

import pytest

from mbot_agent.configuration import Control
from mbot_agent.network.presence import Presence

STOPS = Control(on_lost_link="stop", lost_link_after_s=3)


class World:
    """A clock that stands still, and whether anybody is there."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.there = False
        self.broken = False
        self.looked = threading.Event()

    def look(self, timeout_s: float) -> bool:
        assert timeout_s > 0
        self.looked.set()
        if self.broken:
            raise OSError("the session is closed")
        return self.there

    def presence(self, control: Control = STOPS) -> Presence:
        return Presence(control, self.look, lambda: self.now_s)


def test_a_robot_that_may_drive_alone_never_minds() -> None:
    world = World()
    presence = world.presence(Control())
    world.now_s += 1e6
    assert presence.fault is None
    with presence:
        assert "presence" not in {thread.name for thread in threading.enumerate()}


def test_silence_is_a_fault_after_its_time_and_a_look_ends_it() -> None:
    world = World()
    presence = world.presence()
    world.now_s += 2.9
    presence.look()
    assert presence.fault is None
    world.now_s = 1000.0 + STOPS.lost_link_after_s
    fault = presence.fault
    assert fault is not None
    assert fault.kind == "link-lost"
    assert "control.on_lost_link" in fault.detail
    world.there = True
    presence.look()
    assert presence.fault is None


def test_a_command_counts_before_its_sender_is_seen() -> None:
    world = World()
    presence = world.presence()
    world.now_s += 100
    presence.heard()
    assert presence.fault is None
    world.now_s += 3.1
    assert presence.fault is not None


@pytest.mark.parametrize("broken", [False, True])
def test_a_link_that_fails_counts_as_lost(broken: bool) -> None:
    world = World()
    world.broken = broken
    presence = world.presence()
    world.now_s += 3.1
    presence.look()
    assert presence.fault is not None


def test_it_looks_by_itself() -> None:
    world = World()
    with world.presence() as presence:
        assert world.looked.wait(5.0)
        thread = presence._thread  # pyright: ignore[reportPrivateUsage]
    assert not thread.is_alive(), "and looks no more when it is left"
