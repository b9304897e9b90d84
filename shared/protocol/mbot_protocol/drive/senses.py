"""What a board feels of the world: the floor in front of it, the way ahead, its own supply."""

from dataclasses import dataclass

NO_ECHO_M = 4.0


@dataclass(frozen=True, slots=True)
class Senses:
    """As a board told it last.

    Attributes:
        distance_m: of the nearest echo ahead; `NO_ECHO_M` is none. Soft and slanted things and thin
            legs give none.
        floor: whether either infrared pair sees a light floor, by its number; dark is none.
        at_edge: the board lets no wheel turn forward, for want of floor.
        at_obstacle: the board does not go forward, for something ahead.
        supply_v: of the board's processor; None: not measured yet.

    """

    distance_m: float
    floor: tuple[bool, bool]
    at_edge: bool
    at_obstacle: bool
    supply_v: float | None = None

    @property
    def over_an_edge(self) -> bool:
        """Whether the board holds back now because there is no floor: not only until it has backed
        off from where there was none.
        """
        return self.at_edge and not all(self.floor)

    @property
    def words(self) -> str:
        """In a line for people."""
        seen = " and ".join("floor" if floor else "no floor" for floor in self.floor)
        ahead = "no echo" if self.distance_m >= NO_ECHO_M else f"{self.distance_m:.2f} m"
        supply = f", supply {self.supply_v:.1f} V" if self.supply_v is not None else ""
        return f"infrared pairs see {seen}, ahead {ahead}{supply}"
