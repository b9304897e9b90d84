"""A trial's confinement on a kernel for arm64, emulated: qemu-user has no seccomp.

Debian's kernel and userland as an initial RAM disk. It tries the policy that ships, then all that a
confined process must not do, and says on its console what came of it. Wants root, 4 minutes.
"""

import json
import shutil
import subprocess

import pytest

from ..protocol.confined_attempts import FORBIDDEN, HARMLESS
from .booted import CHECKOUT, ROOTS
from .test_aarch64 import MODEL, PACKAGES, SITE, install_libraries, put_checkout

EMULATOR = ("qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72", "-m", "3G", "-nographic")
CONSOLE = "console=ttyAMA0 rdinit=/init quiet panic=1"
ROOT = ROOTS / "bookworm-arm64-kernel"

INIT = f"""#!/bin/sh
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
export PYTHONPATH=/checkout:/checkout/robot:/checkout/shared/protocol:/{SITE}
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev
python3 -B -m mbot_protocol.policy.dry_run 2.5 600 < /checkout/{MODEL} | sed 's/^/TRIED /'
echo
python3 -B -c '
import json
from tests.protocol.confined_attempts import FORBIDDEN, HARMLESS, outcome
said = {{what: outcome(body) for what, body in (FORBIDDEN | HARMLESS).items()}}
print("SAID " + json.dumps(said))'
echo o > /proc/sysrq-trigger; sleep 10
"""


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """What the machine says from its boot to its end."""
    if not (ROOT / "whole").exists():
        shutil.rmtree(ROOT, ignore_errors=True)
        ROOTS.mkdir(parents=True, exist_ok=True)
        make = ("mmdebstrap", "--mode=root", "--variant=extract", "--arch=arm64")
        packages = f"--include={PACKAGES},coreutils,dash,sed,mount,linux-image-arm64"
        subprocess.run([*make, packages, "bookworm", str(ROOT)], check=True, capture_output=True)
        shutil.rmtree(ROOT / "lib/modules")
        install_libraries(ROOT, "bookworm")
        (ROOT / "whole").touch()
    put_checkout(ROOT)
    attempts = ROOT / "checkout/tests/protocol/confined_attempts.py"
    attempts.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(CHECKOUT / "tests/protocol/confined_attempts.py", attempts)
    (ROOT / "init").write_text(INIT)
    (ROOT / "init").chmod(0o755)
    disk = tmp_path_factory.mktemp("arm64") / "disk.cpio"
    pack = f"find . -path ./boot -prune -o -print | cpio -o -H newc --quiet > {disk}"
    subprocess.run(["sh", "-ec", pack], cwd=ROOT, check=True)
    (kernel,) = (ROOT / "boot").glob("vmlinuz-*")
    boot = ("-net", "none", "-no-reboot", "-kernel", str(kernel), "-initrd", str(disk))
    done = subprocess.run(
        [*EMULATOR, *boot, "-append", CONSOLE],
        capture_output=True,
        text=True,
        timeout=500,
        check=True,
    )
    return done.stdout.splitlines()


def said(console: list[str], word: str) -> object:
    (line,) = (line for line in console if line.startswith(f"{word} "))
    return json.loads(line.removeprefix(f"{word} ").lstrip("!"))


def test_the_policy_that_ships_passes_its_trial_confined(console: list[str]) -> None:
    report = said(console, "TRIED")
    assert isinstance(report, dict)
    assert (report["golden_frames"], report["confined"]) == (80, True)


def test_it_is_refused_everything_but_computing_there_too(console: list[str]) -> None:
    wanted = dict.fromkeys(FORBIDDEN, "refused") | dict.fromkeys(HARMLESS, "done")
    assert said(console, "SAID") == wanted
