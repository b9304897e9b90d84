"""A computer of its own: an emulated PC that boots a disk with Debian's kernel.

Where a container only looks like a robot, this one has drivers: the kernel's virtual camera
(vivid), a USB serial port that can be pulled out, limits on memory, devices and addresses that
hold, and a disk that loses what was not written when the power goes. It is some ten times slower
than the computer it runs on.
"""

import contextlib
import json
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Self

PACKAGES = "linux-image-amd64,kmod,socat,python3-libcamera,python3-prctl,libarchive13t64"
EMULATOR = "qemu-system-x86_64"
MEMORY_MB = 1024
DISK_MB = 3000
BOOT_S = 240.0
GUEST = Path(__file__).parent / "guest"

FILES = {
    "etc/modules-load.d/vivid.conf": "vivid\n",
    "etc/modprobe.d/vivid.conf": "options vivid n_devs=1\n",
    "etc/systemd/network/all.network": "[Match]\nName=e*\n[Network]\nDHCP=yes\n",
    # picamera2 looks for the name that a Raspberry Pi gives its heap.
    "etc/udev/rules.d/61-heap.rules": (
        'SUBSYSTEM=="dma_heap", GROUP="video", MODE="0660", SYMLINK+="dma_heap/vidbuf_cached"\n'
    ),
    "etc/systemd/system/answer.service": (
        "[Service]\nExecStart=/usr/bin/python3 /opt/guest/answer.py\nRestart=always\n"
        "[Install]\nWantedBy=multi-user.target\n"
    ),
    # Ten times slower than a Raspberry Pi, and busy with its boot meanwhile.
    "etc/systemd/system/mbot-agent.service.d/slow.conf": "[Service]\nTimeoutStartSec=180\n",
    # The daemon listens to its own computer only; the emulated network brings others to here.
    "etc/systemd/system/relay.service": (
        "[Unit]\nStartLimitIntervalSec=0\n[Service]\nRestart=always\nRestartSec=1\n"
        "ExecStart=/usr/bin/socat TCP-LISTEN:{port},bind=10.0.2.15,reuseaddr,fork "
        "TCP:127.0.0.1:{port}\n[Install]\nWantedBy=multi-user.target\n"
    ),
}
STARTED = ("answer.service", "relay.service", "systemd-networkd.service")


def make_disk(root: Path, disk: Path, port: int) -> None:
    """A disk with a root's files, and what the machine needs to be spoken to.

    Args:
        root: files of an installed system; changed.
        disk: the file to make.
        port: of the daemon there, and of the way to it from here.

    """
    for name, text in FILES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text.replace("{port}", str(port)))
    shutil.copytree(GUEST, root / "opt/guest")
    subprocess.run(
        ["systemctl", "-q", f"--root={root}", "enable", *STARTED], check=True, capture_output=True
    )
    subprocess.run(
        ["mke2fs", "-q", "-t", "ext4", "-d", str(root), str(disk), f"{DISK_MB}M"], check=True
    )


class VirtualMachine:
    """One boot of a disk; a context manager, at the end of which the power goes."""

    def __init__(self, root: Path, disk: Path, board: str, port: int) -> None:
        """Prepare.

        Args:
            root: where the kernel is.
            disk: what `make_disk` has made.
            board: the serial port here that is at the other end of its USB serial port.
            port: of the daemon.

        """
        self._directory = disk.parent
        self._console = self._directory / "console"
        (kernel,) = (root / "boot").glob("vmlinuz-*")
        (initrd,) = (root / "boot").glob("initrd.img-*")
        self._command = [
            *(EMULATOR, "-machine", "q35", "-accel", "tcg,thread=multi", "-cpu", "max"),
            *("-smp", "2", "-m", str(MEMORY_MB), "-display", "none", "-no-reboot"),
            *("-serial", f"file:{self._console}"),
            *("-kernel", str(kernel), "-initrd", str(initrd)),
            *("-append", "root=/dev/vda rw console=ttyS0 quiet"),
            *("-drive", f"file={disk},format=raw,if=virtio"),
            *("-nic", f"user,model=virtio,hostfwd=tcp:127.0.0.1:{port}-10.0.2.15:{port}"),
            *("-device", "qemu-xhci", "-chardev", f"serial,id=board,path={board}"),
            *("-device", "usb-serial,chardev=board,id=board,always-plugged=on"),
            *("-device", "virtio-serial", "-device", "virtserialport,chardev=orders,name=orders"),
            *("-chardev", f"socket,id=orders,path={self._path('orders')},server=on,wait=off"),
            *("-monitor", f"unix:{self._path('monitor')},server=on,wait=off"),
        ]

    def __enter__(self) -> Self:
        began_s = time.monotonic()
        self._emulator = subprocess.Popen(
            self._command, stdin=subprocess.DEVNULL, start_new_session=True
        )
        try:
            self._orders = self._connected("orders")
            self._orders.settimeout(BOOT_S)
            self.says("true")
        except BaseException:
            self.cut_power()
            raise
        self.boot_s = time.monotonic() - began_s
        return self

    def __exit__(self, *_: object) -> None:
        self.cut_power()

    def cut_power(self) -> None:
        """What its kernel has not written to the disk is lost."""
        self._emulator.kill()
        self._emulator.wait()

    def run(self, *command: str, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
        """A command as root in it; its exit status is the caller's to look at."""
        self._orders.settimeout(max(timeout_s, self._orders.gettimeout() or 0))
        with self._orders.makefile("rwb") as lines:
            lines.write(json.dumps(command).encode() + b"\n")
            lines.flush()
            answer = lines.readline()
        self._orders.settimeout(None)
        assert answer, self._console.read_text(errors="replace")
        status, output, errors = json.loads(answer)
        return subprocess.CompletedProcess(command, status, output, errors)

    def says(self, *command: str) -> str:
        """What a command prints that must succeed."""
        done = self.run(*command)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout.strip()

    def pull_out_board(self) -> None:
        """Its USB plug."""
        self._tell_emulator("device_del board")

    def plug_in_board(self) -> None:
        """Again."""
        self._tell_emulator("device_add usb-serial,chardev=board,id=board,always-plugged=on")

    def _tell_emulator(self, order: str) -> None:
        with self._connected("monitor") as monitor:
            monitor.sendall(order.encode() + b"\n")
            time.sleep(0.5)

    def _connected(self, name: str) -> socket.socket:
        link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        deadline_s = time.monotonic() + 10
        while True:
            with contextlib.suppress(OSError):
                link.connect(self._path(name))
                return link
            assert self._emulator.poll() is None, "the emulator has ended"
            assert time.monotonic() < deadline_s, f"the emulator has no {name}"
            time.sleep(0.1)

    def _path(self, name: str) -> str:
        return str(self._directory / f"{name}.socket")


def add_picamera2(root: Path) -> None:
    """The real picamera2 for Trixie's Python, and stand-ins for what only a Pi can compile."""
    stand_ins = root / "opt/stand-ins"
    (stand_ins / "pidng").mkdir(parents=True)
    (stand_ins / "pidng/__init__.py").touch()
    (stand_ins / "pidng/core.py").write_text("PICAM2DNG = object\n")
    (stand_ins / "pidng/camdefs.py").write_text("Picamera2Camera = object\n")
    (stand_ins / "pykms.py").write_text(
        "class Names(type):\n    __getattr__ = lambda self, name: name\n\n\n"
        "class PixelFormat(metaclass=Names): ...\n"
    )
    (root / "usr/share/libcamera/pipeline/virtual").mkdir(parents=True)
    (root / "usr/share/libcamera/pipeline/virtual/virtual.yaml").write_text(
        '%YAML 1.1\n---\n"Virtual0":\n  test_pattern: "bars"\n  supported_formats:\n'
        "  - width: 320\n    height: 240\n    frame_rates:\n    - 30\n    - 30\n"
    )
    target = root / "opt/picamera2"
    _fetch(target, "--no-deps", "picamera2", "videodev2")
    _fetch(
        target,
        "av",
        "simplejpeg",
        "OpenEXR",
        "piexif",
        "pillow",
        "jsonschema",
        "libarchive-c",
        "tqdm",
    )


def _fetch(target: Path, *packages: str) -> None:
    platforms = [f"manylinux_2_{minor}_x86_64" for minor in range(17, 37)] + ["any"]
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "install", "-q", "--only-binary=:all:"),
            *(word for name in platforms for word in ("--platform", name)),
            *("--python-version", "3.13", "--implementation", "cp", "--abi", "cp313"),
            *("--abi", "abi3", "--abi", "none", "--target", str(target), *packages),
        ],
        check=True,
        capture_output=True,
    )
