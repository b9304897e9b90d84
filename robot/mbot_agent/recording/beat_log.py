"""Lines of a recording for people: what has changed from one beat to the next."""

from collections.abc import Iterator

from foxglove_schemas_protobuf.Log_pb2 import Log

from mbot_agent.arming import State
from mbot_agent.tick import Tick


class BeatLog:
    """Compares each beat with the one before."""

    def __init__(self) -> None:
        self._before: Tick | None = None

    def changes(self, tick: Tick) -> Iterator[tuple["Log.Level.ValueType", str]]:
        """Level, one of foxglove.Log's, and words, for whatever is new in this beat."""
        before, self._before = self._before, tick
        if before is None or before.model_sha256 != tick.model_sha256:
            yield Log.INFO, f"model {tick.model_sha256[:12] or 'none'}"
        if before is None or before.state is not tick.state:
            level = Log.WARNING if tick.state is State.FAULT else Log.INFO
            why = ": the hand has let go" if tick.hand_let_go else ""
            yield level, f"now {tick.state.value}{why}"
        for fault in tick.faults:
            if before is None or fault not in before.faults:
                yield Log.ERROR, f"{fault.kind}: {fault.detail}"
        if before is not None and before.stop_count != tick.stop_count:
            stop = tick.orders.stop
            yield Log.WARNING, f"stopped: {stop.why}" if stop.why else f"stopped by {stop.by}"
        if before is not None and before.missed_ticks != tick.missed_ticks:
            yield Log.WARNING, f"{tick.missed_ticks - before.missed_ticks} beats missed"
