"""Keeps the robot supplied with a working model: loads, activates, and goes back when one fails.

Pushes and the control loop's verdicts come from different threads, which take turns; nothing is
logged meanwhile.
The loop itself never waits here: its verdicts are carried out by a thread of their own.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

from mbot_agent.faults import Notice
from mbot_agent.models.activation import Activation
from mbot_agent.models.model_directory import Label, ModelDirectory
from mbot_agent.models.trial import Finding, Trial, Verdict
from mbot_agent.models.trust import Admission, Trust
from mbot_agent.models.turn import Turn
from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.policy.policy import Policy

log = logging.getLogger(__name__)

END_WAIT_S = 1.0
"""What a change of models may hold up the daemon's end; the motors stand already."""

Use = Callable[[Policy, Trial], None]
"""Hands a policy to the control loop, which switches between two decisions."""

Changes = Callable[[str], None]
"""Hears why another model is about to be used: that must never set a standing robot in motion."""


@dataclass(frozen=True, slots=True)
class InUse:
    """The model the robot decides with.

    Attributes:
        policy: itself.
        signer: the name of the key that signed it; empty: nobody has.
        stored_unix_time_ns: when it was pushed.
        proven: it has decided well for a while.

    """

    policy: Policy
    signer: str
    stored_unix_time_ns: int
    proven: bool


class ModelKeeper:
    """Decides which model is in use. A context manager: inside it, verdicts are carried out.

    Attributes:
        notices: what a person should know of the models now; any thread may ask.

    """

    def __init__(
        self,
        store: ModelDirectory,
        trust: Trust,
        clean_decisions: int,
        use: Use,
        changes: Changes,
    ) -> None:
        """`clean_decisions` in a row prove a model; `changes` hears before another one is used."""
        self._store = store
        self._trust = trust
        self._clean_decisions = clean_decisions
        self._use = use
        self._changes = changes
        self._turn = Turn()
        store.say = self._turn.say
        self._in_use: InUse | None = None
        self._unusable = ""
        self.notices: tuple[Notice, ...] = ()
        self._verdicts: queue.SimpleQueue[Verdict | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="model keeper", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._verdicts.put(None)
        self._thread.join(timeout=END_WAIT_S)
        if kind is None and self._turn.taken_within(END_WAIT_S):
            self._change("end", Activation.survived)  # an orderly end is not a crash

    @property
    def in_use(self) -> InUse | None:
        """The model in use; any thread may ask."""
        return self._in_use

    @property
    def active_sha256(self) -> str:
        """Its digest; empty without one."""
        return self._in_use.policy.sha256 if self._in_use is not None else ""

    def load_active(self) -> None:
        """At start: use the active model. If it can't be used, or has crashed the daemon at its
        last starts, use the one to go back to.
        """
        with self._turn:
            self._store.sweep()
            self._end_crash_loop()
            for notice in self._notices():
                self._turn.say(logging.WARNING, "%s", notice.detail)
            activation = self._store.activation
            for sha256 in (activation.active, *self._store.successors(activation.active)):
                unproven = sha256 not in activation.proven
                if not sha256 or (unproven and activation.crashes(sha256, time.time())):
                    continue
                try:
                    data, signer = self._read(sha256)
                    # On disk before the model can do any harm.
                    self._change("start", lambda a, one=sha256: a.started(one, time.time()))
                    self._adopt(Policy(data), signer)
                    return
                except MbotError as error:
                    self._turn.say(logging.ERROR, "model %s cannot be used: %s", sha256[:12], error)
                    if sha256 == activation.active:
                        self._unusable = str(error)
            self.notices = self._notices()
            self._turn.say(
                logging.WARNING, "no model to drive with: `workstation push-model` sends one"
            )

    def install(self, data: bytes, expected_active: str, admission: Admission) -> Policy:
        """Store a model that has passed its dry run and make it active.

        Raises:
            RefusedError: another one has become active meanwhile, or the disk refuses; the old
                one stays.
            ContractError, NewerSchemaError: it can't be loaded.

        """
        policy = Policy(data)
        signed = admission.signed.to_text() if admission.signed is not None else ""
        label = Label(policy.metadata.name, policy.metadata.decision_rate_hz, signed)
        with self._turn:
            self.check_active(expected_active)
            self._store.add(policy.sha256, data, label)
            self._trust.note(admission)
            self._store.activate(policy.sha256, self.active_sha256)
            self._changes("another model was pushed")
            self._adopt(policy, admission.signer)
        return policy

    def find(self, prefix: str) -> str:
        """The digest of the stored model that begins so; of the previous one, if empty.

        Raises:
            RefusedError: there is no such model, or several.

        """
        sha256 = self._store.find(prefix) if prefix else self._store.activation.previous
        if not sha256:
            raise RefusedError("there is no previous model to roll back to")
        return sha256

    def activate(self, sha256: str, admission: Admission) -> None:
        """Make a stored model active.

        Raises:
            RefusedError: it can't be used, or the disk refuses.

        """
        with self._turn:
            try:
                policy, signer = self._load(sha256)
            except MbotError as error:
                raise RefusedError(f"the model {sha256[:12]} cannot be used: {error}") from None
            self._trust.note(admission)
            self._store.activate(sha256, self.active_sha256)
            self._changes("another model was made active")
            self._adopt(policy, signer)

    def carry_out(self, verdict: Verdict) -> None:
        """Do what follows from a verdict on the model in use; an outdated one changes nothing."""
        sha256 = verdict.sha256
        with self._turn:
            in_use = self._in_use
            if in_use is None or sha256 != in_use.policy.sha256:
                return  # a person was faster
            if verdict.finding is Finding.BROKEN:
                self._go_back(sha256, verdict.reason)
            elif verdict.finding is Finding.SURVIVED:
                self._change("survival", Activation.survived)
            elif self._change("proof", lambda a: a.proved(sha256)):
                self._in_use = replace(in_use, proven=True)
                self._turn.say(logging.INFO, "model %s has proven itself", sha256[:12])

    def check_active(self, expected_sha256: str) -> None:
        """Compare and swap: nobody undoes what he has not seen.

        Raises:
            RefusedError: another model is active.

        """
        active = self.active_sha256
        if active != expected_sha256:
            raise RefusedError(
                f"another model ({active[:12] or 'none'}) has become active meanwhile: look at "
                "`workstation models` and push again"
            )

    def _load(self, sha256: str) -> tuple[Policy, str]:
        data, signer = self._read(sha256)
        return Policy(data), signer

    def _read(self, sha256: str) -> tuple[bytes, str]:
        """A stored model and its signer; signature first, then digest, and nothing parsed."""
        signer = self._trust.signer_of(sha256, self._store.label(sha256))
        return self._store.read(sha256), signer

    def _adopt(self, policy: Policy, signer: str) -> None:
        """Use a model from the next decision on. It is the active one on disk already."""
        proven = policy.sha256 in self._store.activation.proven
        needed = 0 if proven else self._clean_decisions
        stored_ns = self._store.stored_unix_time_ns(policy.sha256)
        self._in_use = InUse(policy, signer, stored_ns, proven)
        self._use(policy, Trial(policy.sha256, needed, self._verdicts.put))
        self.notices = self._notices()
        self._turn.say(
            logging.INFO,
            "model %s (%s, %s) is active%s",
            policy.sha256[:12],
            policy.metadata.name,
            f"signed by {signer}" if signer else "not signed",
            "" if proven else ", on trial",
        )

    def _end_crash_loop(self) -> None:
        """Give the active model up if the daemon has crashed with it. Written before anything is
        loaded: the next start must not begin this again.
        """
        activation = self._store.activation
        sha256 = activation.active
        if not (why := activation.crashes(sha256, time.time())):
            return
        successors = self._store.successors(sha256)
        if not successors:
            self._turn.say(logging.ERROR, "model %s: %s, and there is no other", sha256[:12], why)
            return
        self._turn.say(logging.ERROR, "model %s is rolled back: %s", sha256[:12], why)
        self._change("roll-back", lambda a: a.rolled_back(sha256, successors[0], why))

    def _run(self) -> None:
        while (verdict := self._verdicts.get()) is not None:
            try:
                self.carry_out(verdict)
            except Exception:
                log.exception("a verdict on model %s was not carried out", verdict.sha256[:12])

    def _go_back(self, sha256: str, reason: str) -> None:
        """Replace a model that fails by the best other one that loads."""
        loaded = self._first_usable(self._store.successors(sha256))
        if loaded is None:
            self._turn.say(
                logging.ERROR, "model %s fails and there is no other: %s", sha256[:12], reason
            )
            return
        policy, signer = loaded
        self._turn.say(logging.ERROR, "model %s is rolled back: %s", sha256[:12], reason)
        self._change("roll-back", lambda a: a.rolled_back(sha256, policy.sha256, reason))
        self._changes("the model failed and was rolled back")
        self._adopt(policy, signer)

    def _first_usable(self, digests: Sequence[str]) -> tuple[Policy, str] | None:
        for sha256 in digests:
            try:
                return self._load(sha256)
            except MbotError as error:
                self._turn.say(logging.ERROR, "model %s cannot be used: %s", sha256[:12], error)
        return None

    def _change(self, what: str, step: Callable[[Activation], Activation]) -> bool:
        """Note something on disk; a disk that refuses must not keep the robot from going on."""
        try:
            self._store.change(step)
        except RefusedError as error:
            self._turn.say(logging.WARNING, "the model's %s was not noted: %s", what, error)
            return False
        return True

    def _notices(self) -> tuple[Notice, ...]:
        of_models = self._store.activation.notice(
            lambda sha256: self._store.label(sha256).name,
            time.time(),
            has_model=self._in_use is not None,
            unusable=self._unusable,
        )
        return tuple(filter(None, (self._trust.notice, of_models)))
