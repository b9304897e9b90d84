"""A Debian machine that has booted: systemd, apt and Python as on a robot's card, no hardware.

A container of systemd-nspawn whose root is made once by mmdebstrap and copied for each machine. It
shares the network with this computer, so that a workstation here reaches a robot there, and the
kernel's clock, so that times compare. It does not enforce limits on memory, devices and addresses.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Self

CHECKOUT = Path(__file__).parents[2]
ROOTS = Path(os.environ.get("MBOT_PI_ROOTS", CHECKOUT / "out" / "pi-roots"))
"""Where roots are kept from run to run, 300 MB each."""

PACKAGES = "systemd-sysv,dbus,udev,python3,python3-venv,ca-certificates"
INSIDE = Path("/checkout")
"""Where the machine finds this checkout."""

CERTIFICATES = Path("/etc/ssl/certs")


def base_root(release: str, also: str = "", architecture: str = "amd64") -> Path:
    """A Debian release's files, made now if they are not there: a minute or two.

    Args:
        release: its name.
        also: packages beside `PACKAGES`, with commas between them.
        architecture: Debian's name of it.

    """
    root = ROOTS / "-".join(filter(None, (release, architecture, also.replace(",", "-"))))
    if not root.is_dir():
        unfinished = ROOTS / f"{root.name}.unfinished"
        shutil.rmtree(unfinished, ignore_errors=True)
        ROOTS.mkdir(parents=True, exist_ok=True)
        include = f"--include={PACKAGES}{',' if also else ''}{also}"
        subprocess.run(
            [
                *("mmdebstrap", "--variant=minbase", f"--arch={architecture}", include),
                *(release, str(unfinished)),
            ],
            check=True,
            capture_output=True,
        )
        unfinished.rename(root)
    return root


class Machine:
    """One machine, booted; a context manager.

    Attributes:
        root: its disk, seen from here.
        devpts: where its serial ports are made, seen from here.

    """

    boot_timeout_s = 60.0

    def __init__(
        self, release: str, directory: Path, also: str = "", architecture: str = "amd64"
    ) -> None:
        self.release = release
        self.root = directory / release
        self._log = directory / f"{release}.console"
        base = base_root(release, also, architecture)
        subprocess.run(["cp", "-a", "--reflink=auto", str(base), str(self.root)], check=True)

    def __enter__(self) -> Self:
        bound = [f"--bind-ro={CHECKOUT}:{INSIDE}", f"--bind-ro={CERTIFICATES}"]
        pip = Path("/etc/pip.conf")
        if pip.is_file():
            bound.append(f"--bind-ro={pip}")
        with self._log.open("wb") as console:
            self._nspawn = subprocess.Popen(
                [
                    *("systemd-nspawn", "-q", "-D", str(self.root), "--boot", "--register=no"),
                    *("--keep-unit", "--system-call-filter=@memlock", "--console=pipe"),
                    *("--resolv-conf=copy-host", "--hostname=mbot-pi", *bound),
                    "systemd.show_status=0",
                ],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        deadline_s = time.monotonic() + self.boot_timeout_s
        while not self._is_up():
            assert self._nspawn.poll() is None, self._log.read_text(errors="replace")
            assert time.monotonic() < deadline_s, "the machine does not boot"
            time.sleep(0.1)
        self.devpts = Path(f"/proc/{self._init}/root/dev/pts")
        return self

    def __exit__(self, *_: object) -> None:
        self.cut_power()

    def cut_power(self) -> None:
        """Everything in it dies at once, with its first process."""
        with contextlib.suppress(OSError, IndexError):
            os.kill(self._init, signal.SIGKILL)
        try:
            self._nspawn.wait(20)
        finally:
            self._nspawn.kill()

    def run(self, *command: str, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
        """A command as root in it; its exit status is the caller's to look at."""
        pip = [f"{name}={value}" for name, value in os.environ.items() if name.startswith("PIP_")]
        return subprocess.run(
            ["nsenter", "-t", str(self._init), "-a", "env", *pip, *command],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=timeout_s,
            check=False,
        )

    def says(self, *command: str) -> str:
        """What a command prints that must succeed."""
        done = self.run(*command)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout.strip()

    def write(self, path: str, text: str) -> None:
        """Replace a file's content; owner and mode stay."""
        (self.root / path.lstrip("/")).write_text(text)

    def read(self, path: str) -> str:
        """A file's content."""
        return (self.root / path.lstrip("/")).read_text()

    def files(self) -> set[str]:
        """Everything on its disk but this checkout, logs, caches and systemd's own."""
        aside = ("/var/log", "/var/cache", "/var/lib/systemd", "/tmp", "/var/tmp", str(INSIDE))
        pruned = [word for path in aside for word in ("-path", path, "-prune", "-o")]
        return set(self.says("find", "/", "-xdev", *pruned, "-print").splitlines())

    @property
    def _init(self) -> int:
        children = Path(f"/proc/{self._nspawn.pid}/task/{self._nspawn.pid}/children").read_text()
        return int(children.split()[-1])

    def _is_up(self) -> bool:
        try:
            state = self.run("systemctl", "is-system-running")
        except (OSError, ValueError, IndexError):
            return False
        return state.stdout.strip() in ("running", "degraded")
