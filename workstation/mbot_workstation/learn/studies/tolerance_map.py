"""How much two deviations between simulation and reality a policy bears together."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.evaluation.evaluation_report import Line
from mbot_workstation.learn.studies.study_plans import DEVIATIONS, deviating
from mbot_workstation.learn.studies.study_run import Condition
from mbot_workstation.learn.studies.tolerance_file import (
    HomeMistakes,
    MapAxis,
    RewardMap,
    Tolerances,
)
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.effects.presets import NOMINAL

TOLERATED_SHARE = 0.95
"""A deviation is tolerated while this share of the nominal reward is left."""


@dataclass(frozen=True, slots=True)
class ToleranceMap:
    """A grid over two deviations.

    Attributes:
        across, up: their names.
        across_values, up_values: ascending, shapes (n,).

    """

    across: str
    up: str
    across_values: tuple[float, ...]
    up_values: tuple[float, ...]

    @classmethod
    def of(cls, across: str, up: str, cells: int) -> "ToleranceMap":
        """A square grid over the usual ranges.

        Raises:
            ConfigurationError: there is no such deviation.

        """
        for name in (across, up):
            if name not in DEVIATIONS:
                raise ConfigurationError(
                    f"no deviation {name!r}, expected one of {', '.join(DEVIATIONS)}"
                )
        return cls(across, up, _steps(across, cells), _steps(up, cells))

    def conditions(self, nominal: EffectRanges = NOMINAL) -> tuple[Condition, ...]:
        """A condition a cell, row by row from the lowest; the robot may be a calibrated one."""
        return tuple(
            Condition(
                f"{self.across} {across:g}, {self.up} {up:g}",
                deviating({self.across: across, self.up: up}, nominal),
            )
            for up in self.up_values
            for across in self.across_values
        )

    def rewards(self, lines: Sequence[Line]) -> NDArray[np.float64]:
        """Mean rewards of one contestant's lines. Shape (rows, columns), lowest row first."""
        means = [line.score.reward.mean for line in lines]
        return np.array(means).reshape(len(self.up_values), len(self.across_values))


def as_file(
    maps: Sequence[tuple[ToleranceMap, NDArray[np.float64]]],
    contestant: str,
    nominal_reward: float,
    how: str,
    mistakes: tuple[HomeMistakes, ...] = (),
) -> Tolerances:
    """The maps, each with its rewards of shape (up, across), as tolerance.json holds them."""
    return Tolerances(
        contestant=contestant,
        nominal_reward=nominal_reward,
        tolerated_share=TOLERATED_SHARE,
        how=how,
        maps=tuple(
            RewardMap(
                across=_axis(one.across, one.across_values),
                up=_axis(one.up, one.up_values),
                rewards=tuple(tuple(float(reward) for reward in row) for row in rewards),
            )
            for one, rewards in maps
        ),
        mistakes=mistakes,
    )


def _axis(name: str, values: tuple[float, ...]) -> MapAxis:
    deviation = DEVIATIONS[name]
    return MapAxis(name=name, unit=deviation.unit, nominal=deviation.nominal, values=values)


def _steps(name: str, cells: int) -> tuple[float, ...]:
    deviation = DEVIATIONS[name]
    values = np.linspace(deviation.low, deviation.high, cells)
    return tuple(round(float(value), 4) for value in values)


def draw_maps(
    maps: Sequence[tuple[ToleranceMap, NDArray[np.float64]]],
    path: Path,
    *,
    nominal_reward: float,
    largest: float,
) -> None:
    """Write the maps side by side, with the border of what is tolerated.

    Args:
        maps: grids with their rewards, shape (up, across) each.
        path: a file matplotlib can write, such as a PNG.
        nominal_reward: of the policy without any deviation.
        largest: reward there is.

    Raises:
        ConfigurationError: it can't be written.

    """
    columns = min(2, len(maps))
    rows = -(-len(maps) // columns)
    figure = Figure(figsize=(5.2 * columns + 0.8, 4.3 * rows), layout="constrained")
    grid: Any = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(maps) :]:
        axes.set_visible(False)
    picture: Any = None
    for axes, (one, rewards) in zip(grid.flat, maps, strict=False):
        picture = axes.pcolormesh(
            one.across_values, one.up_values, rewards, cmap="viridis", vmin=-1, vmax=largest
        )
        tolerated = TOLERATED_SHARE * nominal_reward
        if rewards.min() < tolerated < rewards.max():
            axes.contour(
                one.across_values, one.up_values, rewards, levels=[tolerated], colors="black"
            )
        axes.plot(DEVIATIONS[one.across].nominal, DEVIATIONS[one.up].nominal, "k+", markersize=12)
        axes.set_xlim(one.across_values[0], one.across_values[-1])
        axes.set_ylim(one.up_values[0], one.up_values[-1])
        axes.set_xlabel(DEVIATIONS[one.across].title)
        axes.set_ylabel(DEVIATIONS[one.up].title)
    figure.colorbar(picture, ax=grid, label="mean reward", shrink=0.8)
    figure.suptitle(
        f"+ nominal; black line: {100 * TOLERATED_SHARE:.0f} % of the nominal reward "
        f"{nominal_reward:.1f}"
    )
    save_figure(figure, path)


def map_page(
    maps: Sequence[tuple[ToleranceMap, NDArray[np.float64]]],
    contestant: str,
    nominal_reward: float,
    how: str,
    picture: str,
    mistakes: Sequence[HomeMistakes] = (),
) -> str:
    """The maps, each with its rewards of shape (up, across), as a Markdown page of numbers."""
    parts = [
        "# Tolerance of deviations between simulation and reality",
        "The paper asks how much deviation a task tolerates, and which measurements matter. "
        f"{contestant} has a mean reward of {nominal_reward:.2f} on the nominal robot; a deviation "
        f"is tolerated while {100 * TOLERATED_SHARE:.0f} % of it is left.",
        *(f"In homes: {one.words} ({one.episodes} episodes)." for one in mistakes),
        how,
        f"![tolerance maps]({picture})",
    ]
    for one, rewards in maps:
        header = "| | " + " | ".join(f"{value:g}" for value in one.across_values) + " |"
        rows = [
            f"| **{up:g}** | " + " | ".join(f"{reward:.1f}" for reward in row) + " |"
            for up, row in zip(reversed(one.up_values), rewards[::-1], strict=True)
        ]
        across, up = DEVIATIONS[one.across], DEVIATIONS[one.up]
        parts.append(
            f"## {across.words.capitalize()} and {up.words}\n\n"
            f"Mean reward; across {across.title}, `{one.across}`; up {up.title}, `{one.up}`.\n\n"
            + "\n".join([header, "|---" * (len(one.across_values) + 1) + "|", *rows])
        )
    return "\n\n".join(parts) + "\n"
