"""By what the simulated measurements of a run change: see `run_view` for what they are."""

import numpy as np

from mbot_workstation.identification.flat_track import Plane
from mbot_workstation.identification.run_terms import MOMENT, Residual, Slopes
from mbot_workstation.identification.run_view import RunView, steps_at, tracker_place
from mbot_workstation.identification.twist import Twists, along
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.timestep import TIMESTEP_S


def slopes(
    view: RunView,
    path: Array,
    twists: Twists,
    residual: Residual,
    setting: Array,
    pose: Array,
    deviation: Array,
) -> Slopes:
    """How they change, averaged as the residual was.

    Args:
        view: the run.
        path: simulated, shape (steps + 1, 3).
        twists: by the motors' strengths (2), then by n parameters.
        residual: found there.
        setting, pose, deviation: where, shapes (5,), (3,), (deviations,).

    """
    moments = view.moments(setting, deviation[MOMENT])
    index, share = steps_at(path, moments)
    x, yaw = view.simulated_at(path, moments)
    ahead, arm = np.exp(1j * pose[2]), np.exp(1j * (pose[2] + yaw))
    tracker = tracker_place(setting, deviation)

    def seen(moved: Plane, turned: Array) -> tuple[Plane, Array]:
        moved = moved[..., index] * (1 - share) + moved[..., index + 1] * share
        turned = turned[..., index] * (1 - share) + turned[..., index + 1] * share
        return ahead * moved + 1j * arm * tracker * turned, turned

    place, heading = seen(*along(path, twists.rows(range(2, len(twists.turn)))))
    driven, steered = seen(*along(path, _in_pieces(view, twists.rows((0, 1)))))
    speed, rate = seen(
        np.gradient(path[:, 0] + 1j * path[:, 1], TIMESTEP_S), np.gradient(path[:, 2], TIMESTEP_S)
    )
    one, none = np.ones_like(yaw), np.zeros_like(yaw)
    late, shift = view.since_middle_s, np.stack([arm, 1j * arm])
    start = 1j * ahead * (x + np.exp(1j * yaw) * tracker)
    return Slopes(
        common=view.averaged(
            residual,
            np.vstack([place, -speed, -speed * late, shift, none]),
            np.vstack([heading, -rate, -rate * late, none, none, one]),
        ),
        pose=view.averaged(
            residual, np.vstack([one, 1j * one, start]), np.vstack([none, none, one])
        ),
        own=view.averaged(
            residual,
            np.vstack([driven[:2].sum(axis=0), driven[:2], -speed, shift, driven[2:]]),
            np.vstack([steered[:2].sum(axis=0), steered[:2], -rate, none, none, steered[2:]]),
        ),
    )


def _in_pieces(view: RunView, strengths: Twists) -> Twists:
    """Of each motor over the whole run (2), then in each piece only (2 x pieces)."""
    during = np.arange(view.pieces)[:, None] == view.piece
    way, turn = strengths.way[:, : view.steps], strengths.turn[:, : view.steps]
    return Twists(
        np.vstack([way, way[0] * during, way[1] * during]),
        np.vstack([turn, turn[0] * during, turn[1] * during]),
    )
