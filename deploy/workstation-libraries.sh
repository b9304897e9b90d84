#!/bin/sh
# System libraries a workstation needs, checked before anything is installed with pip.
# As root on Debian or Ubuntu what is missing is installed; anybody else is told the command.
# The argument "firmware" looks only at what compiles the board's firmware, "emulator" only at what
# compiles the board's emulator, "test" at both and the tests' own needs as well, "machines" at what
# boots the robot's systems in containers, "kernel" at what boots them on an emulated PC besides.
set -eu

python=${PYTHON:-python3}
missing=

need() { # PACKAGE TEST...: the package is missing if the test fails
    package=$1
    shift
    "$@" >/dev/null 2>&1 || missing="$missing $package"
}

library() { # is a shared library known to the loader?
    ldconfig -p 2>/dev/null | grep -q "$1" || /sbin/ldconfig -p | grep -q "$1"
}

if [ "$(uname -s)" = Linux ]; then
    case ${1:-} in "" | test)
        need python3-venv "$python" -c 'import ensurepip, venv'
        need libegl1 library libEGL.so.1
        need libgl1-mesa-dri library libEGL_mesa.so.0
        need libgl1 library libGL.so.1
        ;;
    esac
    if [ "${1:-}" = machines ] || [ "${1:-}" = kernel ]; then
        need mmdebstrap command -v mmdebstrap
        need systemd-container command -v systemd-nspawn
        need qemu-user-static command -v qemu-aarch64-static
        need arch-test command -v arch-test
        need gcc-arm-linux-gnueabi command -v arm-linux-gnueabi-gcc
        need libc6-dev-armel-cross test -e /usr/arm-linux-gnueabi/include/stdio.h
    fi
    if [ "${1:-}" = kernel ]; then
        need qemu-system-x86 command -v qemu-system-x86_64
        need qemu-system-arm command -v qemu-system-aarch64
        need cpio command -v cpio
        need e2fsprogs command -v mke2fs
    fi
    if [ "${1:-}" = test ]; then
        need systemd command -v systemd-analyze
        need git command -v git
        need strace command -v strace
    fi
    if [ "${1:-}" = emulator ] || [ "${1:-}" = test ]; then
        need gcc command -v gcc
        need libc6-dev test -e /usr/include/stdio.h
        need libsimavr-dev test -e /usr/include/simavr/sim_avr.h
        need libelf-dev test -e /usr/include/libelf.h
    fi
    if [ "${1:-}" = firmware ] || [ "${1:-}" = test ]; then
        need gcc-avr command -v avr-gcc
        need binutils-avr command -v avr-objcopy
        need avr-libc test -e /usr/lib/avr/include/avr/io.h
    fi
fi

if [ -n "$missing" ]; then
    # libEGL_mesa comes with libegl-mesa0, which libgl1-mesa-dri does not bring by itself.
    case $missing in *libgl1-mesa-dri*) missing="$missing libegl-mesa0" ;; esac
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "installing$missing"
        apt-get update -qq
        # shellcheck disable=SC2086 # a list of words
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing \
            >/dev/null
    else
        echo "missing system libraries: sudo apt-get install$missing" >&2
        exit 1
    fi
fi

"$python" - <<'PYTHON' || exit 1
import sys
if sys.version_info < (3, 11):
    sys.exit(f"Python {sys.version.split()[0]} is too old, 3.11 or newer is needed: make PYTHON=python3.12 ...")
PYTHON
