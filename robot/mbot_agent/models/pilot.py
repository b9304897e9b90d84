"""The model in use, and how it does: the control loop asks, the trial counts."""

import logging
import time
from collections import deque

from mbot_agent.faults import Fault
from mbot_agent.models.trial import Trial
from mbot_agent.tick import Action
from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy import Answer, Policy, PolicyError
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView, Memory

log = logging.getLogger(__name__)


class Pilot:
    """Answers for the model in use. Any thread may call `use`, only the loop's the rest."""

    def __init__(self) -> None:
        self._policy: Policy | None = None
        self._memory: Memory | None = None  # None: zeros
        self._answer: Answer | None = None
        self._trial: Trial  # of the policy, and with it
        self._given_up: Fault | None = None
        self._is_a_burden: bool  # beside a hand; likewise
        self._incoming: deque[tuple[Policy, Trial]] = deque()

    def use(self, policy: Policy, trial: Trial | None = None) -> None:
        """Switch to this model before the next decision; the trial counts how it does.

        A model on trial is asked even while the robot stands, and its answer goes nowhere: so it
        proves itself, or crashes the daemon, before anything moves by it.
        """
        self._incoming.append((policy, trial or Trial(policy.sha256, 0, lambda _: None)))

    def change_over(self) -> None:
        """Take up what `use` has left; between two decisions."""
        while self._incoming:
            self._policy, self._trial = self._incoming[0]
            self._given_up = None
            self._is_a_burden = False
            self.forget()
            self._incoming.popleft()

    @property
    def has_given_up(self) -> bool:
        """It has failed so often that it is not asked any more; the loop's thread only."""
        return self._given_up is not None

    @property
    def policy(self) -> Policy | None:
        """The model in use."""
        return self._policy

    @property
    def sha256(self) -> str:
        """Its digest; empty without one."""
        return self._policy.sha256 if self._policy is not None else ""

    @property
    def view(self) -> FieldOfView:
        """What it wants to see."""
        return self._policy.metadata.view if self._policy is not None else FULL_VIEW

    @property
    def fault(self) -> Fault | None:
        """Why it cannot drive, if so; any thread may ask."""
        if self._incoming:
            return None
        if self._policy is None:
            return Fault("no-model", "no model yet: `workstation push-model` sends one")
        return self._given_up

    @property
    def memory(self) -> Memory | None:
        """What it will go on with; None: it starts over. The loop's thread only."""
        return self._memory

    def decide(self, observation: Picture, due_ns: int) -> Action | Fault:
        """Ask it, with what it remembers; it remembers this once `drove` says what came of it.

        Args:
            observation: shape (64, 64, 3), uint8, RGB.
            due_ns: an answer that comes later, monotonic, proves nothing.

        Returns:
            Its answer, or what is wrong with it.

        """
        assert self._policy is not None  # no-model is a fault, and with a fault nothing drives
        self._is_a_burden = False
        try:
            answer = self._policy.decide(observation, self._memory or self._policy.blank)
        except PolicyError as error:
            return self._failed(error)
        self._answer = answer
        if time.monotonic_ns() <= due_ns:
            self._trial.clean()
        else:
            self._trial.idle()
        return Action(answer.left, answer.right)

    def drove(self, left: float, right: float) -> None:
        """Its last answer has moved the robot: what the wheels were really told, in [-1, 1]."""
        if self._answer is not None:
            self._memory = Memory(self._answer.state, (left, right))

    def forget(self) -> None:
        """Start over: what it remembers has nothing to do with what comes next."""
        self._memory = self._answer = None

    def rehearse(self, observation: Picture | None, due_ns: int) -> None:
        """Ask a model on trial though nobody needs its answer; None: it is not to be asked now."""
        if self._policy is None or not self._trial.is_open:
            return
        if observation is None or self._given_up is not None:
            self._trial.idle()
        else:
            self.decide(observation, due_ns)

    def would_do(self, observation: Picture, due_ns: int) -> Action | None:
        """What it would do while a person drives: for the recording, and for nothing else.

        A model on trial is not asked: it might take the daemon along. One that fails or answers
        late is not asked again until it has driven, and nothing is held against it.
        """
        if self._policy is None or self._trial.is_open or self._given_up or self._is_a_burden:
            return None
        try:
            answer = self._policy.decide(observation, self._memory or self._policy.blank)
        except PolicyError:
            self._is_a_burden = True
            return None
        self._is_a_burden = time.monotonic_ns() > due_ns
        self._answer = answer
        return Action(answer.left, answer.right)

    def _failed(self, error: PolicyError) -> Fault:
        fault = Fault("model-failed", f"{error}; push another one or `workstation rollback`")
        self._trial.failed(str(error))
        if self._trial.is_broken:
            log.error("%s", fault.detail)
            self._given_up = fault
        return fault
