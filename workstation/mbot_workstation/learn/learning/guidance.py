"""Learning from the guide for a while: what it would have done, beside what was tried.

PPO tries the student's own actions, so the guide is asked about the student's situations, not its
own; its weight falls to nothing, and from there on PPO alone improves on it.
"""

import torch

GUIDE_REMEMBERS = 6
"""Decisions, 2.4 s: a policy with memory learns to go back to an object that it has just lost."""


UNDECIDED = 0.3
"""Distance, in shares of full speed, from which on it counts by itself and not by its square.

Advice of an object seen differs from that of a search by 1 and more. By its square alone a policy
that can't tell which it is does neither but the mean of both, and drives on at half speed to where
nothing is; so it takes the likelier one. Within, where turns differ a little, the mean is right.
"""


def advice_loss(wheels: torch.Tensor, advice: torch.Tensor) -> torch.Tensor:
    """How far from the advice, where there is any, summed over samples. Shape ().

    The square of the distance for small ones, linear for large ones (pseudo-Huber).

    Args:
        wheels: as asked for, shape (n, 2).
        advice: likewise, NaN where there is none.

    """
    known = torch.isfinite(advice).all(dim=1, keepdim=True)
    apart = torch.where(known, wheels - torch.nan_to_num(advice), 0.0) / UNDECIDED
    return (2 * UNDECIDED**2) * ((1 + apart.square().sum(dim=1)).sqrt() - 1).sum()


def guide_weight(decisions: int, guided_decisions: int) -> float:
    """The advice's weight in the loss: 1 at the first decision, linearly to 0."""
    if guided_decisions <= 0:
        return 0.0
    return max(0.0, 1.0 - decisions / guided_decisions)
