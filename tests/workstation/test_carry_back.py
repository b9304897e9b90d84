"""On a free floor a robot that stands far away is carried back, and never while it drives."""

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.virtual.live_world import STANDING_S, CarryBack

STEP_S = 0.01
FAR = Pose(2.0, 0.0)


def carried_after_s(carry: CarryBack, pose: Pose, *, driven: bool = False) -> float | None:
    for step in range(1, 1000):
        if carry.is_due(driven=driven, pose=pose, elapsed_s=STEP_S):
            return step * STEP_S
    return None


def test_it_waits_until_the_run_is_surely_over() -> None:
    carry = CarryBack()
    waited_s = carried_after_s(carry, FAR)
    assert waited_s is not None
    assert abs(waited_s - STANDING_S) < 2 * STEP_S
    # Once carried it stands in the middle; far away again it waits once more.
    assert carried_after_s(carry, ORIGIN) is None


def test_a_driving_robot_is_never_carried() -> None:
    carry = CarryBack()
    assert carried_after_s(carry, FAR, driven=True) is None
    for _ in range(20):  # short stops, as between two commands
        assert carried_after_s(carry, ORIGIN, driven=True) is None
        assert not carry.is_due(driven=False, pose=FAR, elapsed_s=STANDING_S / 2)
        assert not carry.is_due(driven=True, pose=FAR, elapsed_s=STEP_S)
