"""How many drives end with a wheel over a table's edge: the compiled firmware, in MuJoCo's world.

Full speed ahead from anywhere on a table of 1.2 x 0.8 m, whole on it at the start, for 4 s: with
the kit's one module of infrared pairs, with one in front of each wheel, and with the reflex off.

    python benchmarks/table_edge.py [DRIVES]      # 100 of each take 10 minutes
"""

import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # for tests/

from mbot_workstation.fleet.firmware.firmware_file import find_firmware
from mbot_workstation.sim.body.feelers import Feelers
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.virtual.emulated.board_simulator import simulator_program
from tests.firmware import test_table_edge as drives
from tests.firmware.simulated_board import Simulator


def over(feelers: Feelers, request: bytes, count: int) -> int:
    """How many of so many drives."""
    simulator = Simulator(simulator_program(), find_firmware("deadman"))
    falls = partial(drives.ends_in, drives.has_fallen, Simulation(), simulator, request)
    return sum(falls(start, drives.on_a_table(feelers)) for start in drives.starts(feelers, count))


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    for name, feelers, request in (
        ("reflex off", drives.KIT, drives.ONLY_TOLD),
        ("the kit's module in the middle", drives.KIT, drives.EDGE),
        ("a module in front of each wheel", drives.BEFORE_EACH_WHEEL, drives.EDGE),
    ):
        print(f"{name}: {over(feelers, request, count)} of {count} over the edge", flush=True)


if __name__ == "__main__":
    main()
