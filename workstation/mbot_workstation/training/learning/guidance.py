"""Learning from the guide for a while: what it would have done, beside what was tried.

PPO tries the student's own actions, so the guide is asked about the student's situations, not its
own; its weight falls to nothing, and from there on PPO alone improves on it.
"""

import torch

GUIDE_REMEMBERS = 6
"""Decisions, 2.4 s: a policy with memory learns to go back to an object that it has just lost."""


def advice_loss(wheels: torch.Tensor, advice: torch.Tensor) -> torch.Tensor:
    """Sum over samples of the squared distance to the advice, where there is any. Shape ()."""
    known = torch.isfinite(advice).all(dim=1, keepdim=True)
    return torch.where(known, wheels - torch.nan_to_num(advice), 0.0).square().sum()


def guide_weight(decisions: int, guided_decisions: int) -> float:
    """The advice's weight in the loss: 1 at the first decision, linearly to 0."""
    if guided_decisions <= 0:
        return 0.0
    return max(0.0, 1.0 - decisions / guided_decisions)
