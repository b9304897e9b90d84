"""Which parameters the recordings can tell, and why not the others.

Every parameter's effect on the runs is scaled by its spread among real robots and by how much runs
scatter. Then one after the other is taken in, as long as the smallest singular value of those
taken stays large: the data must know every combination of them three times better than what is
known about any mBot. What is not taken in keeps the value it has, unless the runs have moved it
away from there by more than chance: a robot far from the usual one is no usual one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.identification.linearisation import Linearisation
from mbot_workstation.identification.parameters import BY_NAME
from mbot_workstation.recordings.track import Array

LEAST_SINGULAR = 3.0
"""Standard deviation at most a third of the spread, in every direction."""

LEAST_OWN_SHARE = 0.2
"""Of a parameter's effect, what no combination of the others makes as well. Less is what details
make that are not modelled."""

CLEARLY_MOVED = 2.5
"""Standard deviations from the value it had: such a parameter is taken in, wide as its interval is,
since putting it back would make the others wrong."""


@dataclass(frozen=True, slots=True)
class Selection:
    """What can be told.

    Attributes:
        names: parameters to fit.
        singular_values: of the scaled Jacobian of `names`, largest first.
        undetermined: the others, and why.

    """

    names: tuple[str, ...]
    singular_values: tuple[float, ...]
    undetermined: dict[str, str]


def select(
    everything: Linearisation, wanted: Sequence[str], moved: Mapping[str, float] | None = None
) -> Selection:
    """Choose among the parameters of a linearisation.

    Args:
        everything: with all of `wanted` in it.
        wanted: in the order of preference.
        moved: where a fit has been made, by how much it has moved them, in the model's units.

    """
    rows = [everything.names.index(name) for name in wanted]
    spreads = np.array([BY_NAME[name].spread for name in wanted])
    information = everything.of_parameters()[np.ix_(rows, rows)]
    scaled = information * np.outer(spreads, spreads)
    chosen: list[int] = []
    undetermined: dict[str, str] = {}
    for index, name in enumerate(wanted):
        own = _own(scaled, chosen, index)
        alone = max(float(scaled[index, index]), 1e-12)
        smallest = _singular_values(scaled, [*chosen, index])[-1]
        if smallest >= LEAST_SINGULAR and own / alone >= LEAST_OWN_SHARE**2:
            chosen.append(index)
        else:
            undetermined[name] = _reason(scaled, chosen, index, wanted)
    for name in list(undetermined):
        index = wanted.index(name)
        own = _own(scaled, chosen, index)
        share = own / max(float(scaled[index, index]), 1e-12)
        spreads_moved = (moved or {}).get(name, 0.0) / BY_NAME[name].spread
        if own * spreads_moved**2 >= CLEARLY_MOVED**2 and share >= LEAST_OWN_SHARE**2:
            chosen.append(index)
            del undetermined[name]
    return Selection(
        tuple(wanted[index] for index in chosen),
        tuple(float(size) for size in _singular_values(scaled, chosen)),
        undetermined,
    )


def _own(scaled: Array, chosen: Sequence[int], index: int) -> float:
    """What remains of a parameter's information when the chosen ones are unknown too."""
    if not chosen:
        return float(scaled[index, index])
    shared = scaled[chosen, index]
    inner = scaled[np.ix_(chosen, chosen)]
    return float(scaled[index, index] - shared @ np.linalg.solve(inner, shared))


def _singular_values(scaled: Array, chosen: Sequence[int]) -> Array:
    squares = np.linalg.eigvalsh(scaled[np.ix_(chosen, chosen)])
    return np.sqrt(squares.clip(0))[::-1]


def _reason(scaled: Array, chosen: Sequence[int], index: int, names: Sequence[str]) -> str:
    size = float(np.sqrt(scaled[index, index]))
    if size < 0.01:
        return "it changes nothing in these runs"
    if size < LEAST_SINGULAR:
        parameter = BY_NAME[names[index]]
        return (
            f"it changes too little in these runs: they would know it to +-"
            f"{1.96 * parameter.factor * parameter.spread / size:.2g} only"
        )
    share = np.sqrt(max(_own(scaled, chosen, index), 0) / scaled[index, index])
    inner = scaled[np.ix_(chosen, chosen)]
    amounts = np.linalg.solve(inner, scaled[chosen, index])
    parts = np.abs(amounts) * np.sqrt(np.diag(inner)) / size
    largest: list[int] = np.argsort(-parts).tolist()
    others = [names[chosen[i]] for i in largest if parts[i] > 0.3 * parts.max()]
    words = " and ".join(plain(name) for name in others[:3])
    return f"{100 * (1 - share):.0f} % of what it changes, {words} change alike"


def plain(name: str) -> str:
    """A parameter's name without its unit, as in "left motor gain"."""
    return BY_NAME[name].words.split(" [")[0]
