"""Records a SteamVR tracker through the `openvr` package, which only some machines have."""

import importlib
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from scipy.spatial.transform import Rotation

from mbot_protocol.errors import ConfigurationError, UnreachableError
from mbot_workstation.measure.tracks.raw_track import to_our_frame
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.measure.tracks.track_file import TrackFile
from mbot_workstation.pacer import Pacer


class PoseSource(Protocol):
    """Something that knows where the tracker is."""

    def pose(self) -> tuple[Array, Array] | None:
        """Position (3,) and attitude (4,), z up; None while lost."""
        ...


@dataclass(frozen=True, slots=True)
class Progress:
    """How it goes.

    Attributes:
        recorded, lost: poses so far; lost ones are left out of the file.
        lost_for_s: how long the tracker has been lost now; 0: it is seen.

    """

    recorded: int
    lost: int
    lost_for_s: float


def record_poses(
    source: PoseSource, file: TrackFile, rate_hz: float, stop: threading.Event
) -> Iterator[Progress]:
    """Record until stopped; yields after every pose. Times are this machine's monotonic clock."""
    pacer = Pacer(1 / rate_hz, 1)
    lost = 0
    seen_s = time.monotonic()
    while pacer.wait(stop) > 0:
        now_s = time.monotonic()
        pose = source.pose()
        if pose is None:
            lost += 1
        else:
            seen_s = now_s
            file.add(now_s, *pose)
        yield Progress(file.poses, lost, now_s - seen_s)


UP = "y"
"""OpenVR is right-handed: x right, y up, -z forward."""

ORTHOGONAL = 0.01
"""The rotation's columns are unit and at right angles within this; float32 gives 1e-6."""


def load_openvr() -> Any:
    """The package.

    Raises:
        ConfigurationError: it is not installed.

    """
    try:
        return importlib.import_module("openvr")
    except ImportError:
        raise ConfigurationError(
            "SteamVR tracking needs the openvr package: pip install -c constraints.txt -e "
            "'.[measure,tracking]' in the checkout, on the machine SteamVR runs on"
        ) from None


class OpenVrTracker:
    """One tracker; a context manager that holds the connection to SteamVR.

    Attributes:
        serial: its serial number, known once entered.

    """

    def __init__(self, openvr: Any, serial: str | None = None) -> None:
        """Prepare.

        Args:
            openvr: the package.
            serial: which tracker; None: the only one.

        """
        self.serial = serial or ""
        self._openvr = openvr
        self._system: Any = None
        self._index = -1

    def __enter__(self) -> Self:
        """Connect and choose the tracker.

        Raises:
            UnreachableError: SteamVR does not run.
            ConfigurationError: no such tracker, or several.

        """
        try:
            self._system = self._openvr.init(self._openvr.VRApplication_Other)
        except self._openvr.OpenVRError as error:
            raise UnreachableError(
                f"SteamVR does not answer ({type(error).__name__}): start it, here, and let it see "
                "the tracker"
            ) from None
        try:
            self._index, self.serial = self._choose()
        except BaseException:
            self._openvr.shutdown()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._openvr.shutdown()

    def pose(self) -> tuple[Array, Array] | None:
        """Where it is now, z up: position (3,) in m and attitude (4,), w first; None while lost."""
        seen = self._poses()[self._index]
        good = seen.eTrackingResult == self._openvr.TrackingResult_Running_OK
        if not (seen.bPoseIsValid and seen.bDeviceIsConnected and good):
            return None
        table = np.array([list(row) for row in seen.mDeviceToAbsoluteTracking.m], dtype=np.float64)
        quaternion = quaternion_of(table[:, :3])
        if quaternion is None or not np.isfinite(table).all():
            return None
        position, turned = to_our_frame(table[None, :, 3], quaternion[None], UP, "right")
        return position[0], turned[0]

    def _poses(self) -> Any:
        openvr = self._openvr
        return self._system.getDeviceToAbsoluteTrackingPose(
            openvr.TrackingUniverseStanding,
            0.0,
            (openvr.TrackedDevicePose_t * openvr.k_unMaxTrackedDeviceCount)(),
        )

    def _choose(self) -> tuple[int, str]:
        openvr = self._openvr
        found: dict[int, str] = {}
        others: list[str] = []
        for index, pose in enumerate(self._poses()):
            if not pose.bDeviceIsConnected:
                continue
            serial = self._system.getStringTrackedDeviceProperty(
                index, openvr.Prop_SerialNumber_String
            )
            kind = self._system.getTrackedDeviceClass(index)
            if kind == openvr.TrackedDeviceClass_GenericTracker or serial == self.serial:
                found[index] = serial
            else:
                others.append(serial)
        if self.serial:
            found = {index: serial for index, serial in found.items() if serial == self.serial}
        if len(found) == 1:
            return next(iter(found.items()))
        if found:
            raise ConfigurationError(
                f"SteamVR sees {len(found)} trackers: {', '.join(found.values())}; choose one by "
                "--serial"
            )
        wanted = f"no device {self.serial}" if self.serial else "no tracker"
        there = f", only {', '.join(others)}" if others else ""
        raise ConfigurationError(f"SteamVR sees {wanted}{there}; is it switched on and paired?")


def quaternion_of(matrix: Array) -> Array | None:
    """The rotation's quaternion, w first, shape (4,); None if the (3, 3) matrix is not one."""
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=ORTHOGONAL):
        return None
    if np.linalg.det(matrix) < 0:
        return None
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)
