#!/bin/sh
# Installs mbot-agent on Raspberry Pi OS, 64-bit, Bookworm or Trixie: from this checkout, or from a
# release's archive. Each is built in a folder of its own; a link says which one runs.
# docs/install-on-a-pi.md shows what it prints.
set -eu
umask 022

# For tests of this script: a directory that stands for /, and the system's Python.
# Everything else is called by name, so a test puts stand-ins first on PATH.
root=${MBOT_INSTALL_ROOT:-}
python=${MBOT_INSTALL_PYTHON:-/usr/bin/python3}

user=mbot-agent
service=mbot-agent.service
application=$root/opt/mbot-agent
updater=$application/updater
current=$application/current
configuration=$root/etc/mbot-agent
state=$root/var/lib/mbot-agent
units=$root/etc/systemd/system
unit=$units/$service
# Root's part of updates. Files, where the daemon's own unit is a link into the release that runs.
updater_units="mbot-agent-update.path mbot-agent-update.service mbot-agent-recover.service \
mbot-agent-rollback.service"
rules=$root/etc/udev/rules.d/60-mbot.rules
brltty_rules=$root/etc/udev/rules.d/95-mbot-brltty.rules
modules=$root/etc/modules-load.d/mbot-agent.conf
sysusers=$root/etc/sysusers.d/mbot-agent.conf
command_link=$root/usr/local/bin/mbot-agent

usage() {
    cat <<'USAGE'
usage: sudo deploy/install.sh [--dry-run] [--without-picamera2] [--camera SOURCE | --config FILE]
                              [RELEASE.tar]
       sudo deploy/install.sh --uninstall [--purge] [--dry-run]

Installs mbot-agent from this checkout, or from a release that `make dist` has made, or updates it;
running it again is safe. A configuration that exists is left alone. A daemon that runs goes on
until the new release is built, is restarted with it, and gets the old one back if it runs worse;
one that does not run is not started.

  --dry-run            print what would be done, change nothing (needs no root)
  --without-picamera2  for a camera that is not the Pi's own; also accepts a PC (amd64)
  --camera SOURCE      source of [camera] to begin with: /dev/video0, http://ADDRESS,
                       ffmpeg:ADDRESS; asked for if it is not given with --without-picamera2
  --config FILE        a configuration to begin with; one that exists is left alone
  --uninstall          remove the program; keep configuration, models and user
  --purge              with --uninstall: remove those too, and what `systemctl edit` has made
  --help               this text
USAGE
}

fail() {
    echo "install.sh: error: $1" >&2
    exit "${2:-1}"
}

step() { echo "==> $*"; }

note() { echo "    $*"; }

run() {
    if [ -n "$dry_run" ]; then
        echo "would run: $*"
    else
        "$@"
    fi
}

# What becomes a string in the configuration, by sed.
check_camera() {
    # Without quotes, backslash and what can't be seen. Compared, for $() drops newlines at an end.
    plain=$(printf '%s' "$camera" | LC_ALL=C tr -cd ' !#-&(-[]-~')
    [ "$plain" = "$camera" ] ||
        fail "a camera's source may have no quotes, backslashes, newlines or letters beyond ASCII" 2
    case $camera in
        -*) fail "--camera wants a source, such as /dev/video0, not '$camera'" 2 ;;
        picamera2)
            [ -n "$picamera2" ] || fail "--camera picamera2 contradicts --without-picamera2" 2
            ;;
        http://* | ffmpeg:*) ;;
        *://*) fail "FFmpeg opens addresses that are not http://, by --camera ffmpeg:ADDRESS" 2 ;;
    esac
}

# What follows may fail without harm: say so and go on.
try() {
    run "$@" || note "warning: '$*' failed"
}

checkout=$(cd "$(dirname "$0")/.." && pwd)
dry_run=
uninstall=
purge=
archive=
first_configuration=
camera=
picamera2=1

while [ $# -gt 0 ]; do
    case $1 in
        --dry-run) dry_run=1 ;;
        --without-picamera2) picamera2= ;;
        --uninstall) uninstall=1 ;;
        --purge) purge=1 ;;
        --config)
            [ -f "${2:-}" ] || fail "there is no configuration '${2:-}'" 2
            first_configuration=$2
            shift
            ;;
        --camera)
            camera=${2:-}
            [ -n "$camera" ] || fail "--camera wants a source, such as /dev/video0" 2
            shift
            ;;
        --help | -h) usage && exit 0 ;;
        -*) fail "unknown option '$1', see --help" 2 ;;
        *)
            [ -z "$archive" ] || fail "one release at a time, see --help" 2
            [ -f "$1" ] || fail "there is no release '$1'" 2
            archive=$1
            ;;
    esac
    shift
done
[ -z "$purge" ] || [ -n "$uninstall" ] || fail "--purge goes with --uninstall only" 2
[ -z "$camera" ] || check_camera
[ -z "$camera" ] || [ -z "$first_configuration" ] ||
    fail "--camera or --config: a configuration has its own camera" 2

require_root() {
    [ -n "$dry_run" ] || [ "$(id -u)" = 0 ] || fail "root is needed: run it with sudo"
}

# The processor alone tells nothing: 32-bit Raspberry Pi OS runs a 64-bit kernel on a Pi 4.
require_machine() {
    command -v dpkg >/dev/null || fail "no dpkg here: Raspberry Pi OS (64-bit) is needed"
    case $(dpkg --print-architecture) in
        arm64) ;;
        amd64)
            [ -z "$picamera2" ] ||
                fail "this is a PC, not a Raspberry Pi: with another camera, --without-picamera2"
            ;;
        arm*)
            [ "$(uname -m)" != armv6l ] ||
                fail "this Pi is ARMv6 (Pi 1, Zero, Zero W), 32-bit only: a Zero 2 W or Pi 3, 4, 5 is needed"
            fail "this is a 32-bit system: install the 64-bit Raspberry Pi OS"
            ;;
        *) fail "this processor is not supported: arm64 is needed" ;;
    esac
}

require_release() {
    release=$(sed -n 's/^VERSION_CODENAME=//p' "$root/etc/os-release" 2>/dev/null | tr -d '"') || :
    case $release in
        bookworm | trixie) ;;
        *) fail "release is '${release:-unknown}', expected Raspberry Pi OS bookworm or trixie" ;;
    esac
}

is_installed() {
    [ "$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]
}

install_packages() {
    # An archive's wheels are unpacked without pip.
    packages=
    [ -n "$archive" ] || packages=python3-venv
    [ -z "$picamera2" ] || packages="$packages python3-picamera2"
    missing=
    for package in $packages; do
        is_installed "$package" || missing="$missing $package"
    done
    if [ -z "$missing" ]; then
        [ -z "$packages" ] || step "Packages: $packages are installed"
        return
    fi
    step "Packages:$missing"
    # Without the recommended ones, which are a desktop's: Qt, OpenCV.
    run apt-get update
    # shellcheck disable=SC2086  # a list of names
    run env DEBIAN_FRONTEND=noninteractive \
        apt-get install --yes --no-install-recommends $missing || failed_packages
}

failed_packages() {
    case $missing in
        *picamera2*) other="; for a camera that is not the Pi's own: --without-picamera2" ;;
        *) other= ;;
    esac
    fail "apt-get could not install$missing$other"
}

# Before anything is done, while somebody looks.
ask_for_camera() {
    [ -z "$picamera2$camera$first_configuration$dry_run" ] && [ -t 0 ] || return 0
    [ ! -e "$configuration/config.toml" ] || return 0
    printf '%s' "Camera's source, such as /dev/video0 or http://ADDRESS (empty: later): "
    read -r camera || echo
    [ -z "$camera" ] || check_camera
}

# Whatever runs goes on while this script works.
look_at_service() {
    was_running=
    ! systemctl is-active --quiet "$service" 2>/dev/null || was_running=1
}

# What there was before releases becomes one, and goes when a release has shown itself in its place.
take_over() {
    [ -d "$application/venv" ] && [ ! -L "$unit" ] || return 0
    step "Taking over the installation in $application/venv"
    update take-over || fail "nothing has changed, see above"
}

make_user() {
    step "User $user, in the groups dialout and video"
    run install -D -m 0644 "$checkout/deploy/sysusers.d/mbot-agent.conf" "$sysusers"
    run systemd-sysusers "$sysusers"
    run install -d -m 0700 "$state"
    run chown "$user:$user" "$state"
}

update() {
    run "$python" -I -B "$updater" --root "${root:-/}" "$@"
}

install_updater() {
    step "Updater in $updater"
    run rm -rf "$updater.new"
    run install -d -m 0755 "$application" "$application/releases" "$updater.new"
    if [ -d "$checkout/updater" ]; then # a release that was unpacked
        run cp -R "$checkout/updater/." "$updater.new"
    else
        run install -d "$updater.new/mbot_update" "$updater.new/mbot_protocol"
        for name in "$checkout"/robot/mbot_update/*.py; do
            run install -m 0644 "$name" "$updater.new/mbot_update"
        done
        run mv "$updater.new/mbot_update/__main__.py" "$updater.new"
        while read -r name; do
            run install -D -m 0644 "$checkout/shared/protocol/mbot_protocol/$name.py" \
                "$updater.new/mbot_protocol/$name.py"
        done <"$checkout/deploy/updater-modules.txt"
    fi
    run rm -rf "$updater"
    run mv "$updater.new" "$updater"
    for name in $updater_units; do
        run install -D -m 0644 "$checkout/deploy/systemd/$name" "$units/$name"
    done
}

# The same content is the same release, and is not built twice.
checkout_version() {
    digest=$(cd "$checkout" && find pyproject.toml deploy robot shared workstation -type f \
        ! -name '*.pyc' -exec sha256sum {} + | LC_ALL=C sort -k 2 | sha256sum | cut -c 1-8)
    number=$(sed -n 's/^version = "\(.*\)"/\1/p' "$checkout/pyproject.toml" | head -n 1)
    echo "$number+checkout.$digest.$release"
}

install_release() {
    if [ -n "$archive" ]; then
        step "Release $archive"
        update install "$archive" || failed_update
        return
    fi
    version=$(checkout_version)
    folder=$application/releases/$version
    step "Release $version in $folder"
    if [ ! -f "$folder/whole" ]; then
        build_checkout || failed_update
    fi
    update adopt "$version" || failed_update
}

failed_update() {
    [ -z "$was_running" ] || fail "the update failed, see above; mbot-agent runs on as it was"
    fail "the release could not be installed, see above"
}

# What root runs of others' is pinned by digest, as in a release; hatchling, that builds ours, as well.
build_checkout() {
    run rm -rf "$folder"
    run "$python" -m venv --system-site-packages "$folder/venv" || return 1
    pins=$checkout/deploy/requirements
    if ! install_pinned --compile -r "$pins/$release-$(dpkg --print-architecture).txt" ||
        ! install_pinned --target "$folder/build" -r "$pins/build.txt" ||
        ! run env TMPDIR="$root/var/tmp" PYTHONPATH="$folder/build" \
            "$folder/venv/bin/python" -m pip install --no-cache-dir --no-index --no-deps \
            --no-build-isolation --compile "$checkout"; then
        run rm -rf "$folder"
        return 1
    fi
    run rm -rf "$folder/build"
    run install -D -m 0644 "$checkout/deploy/systemd/$service" "$folder/deploy/systemd/$service"
}

# --only-binary: a Pi Zero 2 W would compile numpy for hours and then run out of memory.
# --compile: the service may not write .pyc files. TMPDIR: Trixie's /tmp lies in memory.
install_pinned() {
    run env TMPDIR="$root/var/tmp" "$folder/venv/bin/python" -m pip install --no-cache-dir \
        --no-deps --require-hashes --only-binary=:all: "$@"
}

# 1 to 32 of a-z, 0-9, '-' and '_', beginning with a letter or digit.
robot_id() {
    id=$(head -n 1 "$root/etc/hostname" 2>/dev/null | cut -d . -f 1 | tr '[:upper:]' '[:lower:]' |
        tr -cd 'a-z0-9_-' | sed 's/^[-_]*//' | cut -c 1-32) || :
    echo "${id:-mbot-1}"
}

# Not for everybody: a camera's address may hold a password.
put_configuration() {
    run install -D -m 0640 "$1" "$configuration/config.toml"
    run chown "root:$user" "$configuration/config.toml"
}

# In [camera] of the configuration that was put there just now.
put_camera() {
    if [ -n "$camera" ]; then
        escaped=$(printf '%s' "$camera" | sed 's/[&|]/\\&/g')
        run sed -i "/^\[camera]/,/^\[/ s|^source = .*|source = \"$escaped\"|" \
            "$configuration/config.toml"
    elif [ -z "$picamera2" ]; then
        note "for a camera that is not the Pi's own, in [camera] there: source = \"/dev/video0\""
    fi
}

# The existing configuration is a person's.
show_camera_line() {
    [ -n "$camera" ] || return 0
    line="source = \"$camera\""
    grep -qxF "$line" "$configuration/config.toml" 2>/dev/null ||
        note "--camera changes nothing there; in [camera], change to: $line"
}

install_configuration() {
    if [ -e "$configuration/config.toml" ]; then
        step "Configuration: $configuration/config.toml is kept"
        show_camera_line
    elif [ -n "$first_configuration" ]; then
        step "Configuration: $configuration/config.toml is $first_configuration"
        put_configuration "$first_configuration"
    else
        step "Configuration: $configuration/config.toml for the robot '$(robot_id)'"
        put_configuration "$checkout/deploy/config.toml"
        run sed -i "s/^robot_id = .*/robot_id = \"$(robot_id)\"/" "$configuration/config.toml"
        put_camera
        [ "$(robot_id)" != raspberrypi ] ||
            note "that is every Pi's name: with a second robot, change robot_id there"
    fi
    # For `calibration = "calibration"` in config.toml. Nothing in it is secret.
    run install -d -m 0755 "$configuration/calibration"
    # For the TLS key: the service may read it, nobody else.
    run install -d -m 0750 "$configuration/tls"
    run chown "root:$user" "$configuration/tls"
}

install_service() {
    step "Serial port: udev rules and kernel modules"
    run install -D -m 0644 "$checkout/deploy/udev/60-mbot.rules" "$rules"
    run install -D -m 0644 "$checkout/deploy/udev/95-mbot-brltty.rules" "$brltty_rules"
    run install -D -m 0644 "$checkout/deploy/modules-load.d/mbot-agent.conf" "$modules"
    try modprobe --all usbserial ch341 cdc_acm
    try udevadm control --reload
    try udevadm trigger --subsystem-match=usb --subsystem-match=tty

    step "Service $service, started at boot from now on"
    run install -d "$units"
    run ln -sfn "$current/deploy/systemd/$service" "$unit"
    run install -d -m 0755 "$(dirname "$command_link")"
    run ln -sfn "$current/venv/bin/mbot-agent" "$command_link"
    run systemctl daemon-reload
    run systemctl enable "$service" mbot-agent-recover.service
    run systemctl enable --now mbot-agent-update.path
}

check_brltty() {
    is_installed brltty || return 0
    version=$(dpkg-query -W -f='${Version}' brltty)
    if dpkg --compare-versions "$version" lt 6.5; then
        note "warning: brltty $version takes the board's serial port for a Braille display;"
        note "95-mbot-brltty.rules keeps it off. If /dev/mbot still vanishes: apt remove brltty"
    fi
}

show_check() {
    [ -z "$was_running" ] || return 0 # it has camera and board
    step "mbot-agent check, as $user"
    run runuser -u "$user" -- env HOME="$state" "$current/venv/bin/mbot-agent" check ||
        note "something is missing, see above: mend it before the start"
}

trusts_a_key() {
    grep -hv '^ *#' "$configuration/config.toml" "$configuration/trusted-keys.toml" 2>/dev/null |
        grep -q 'ed25519:'
}

show_next_steps() {
    cat <<NEXT

Next:
  sudoedit /etc/mbot-agent/config.toml     name, camera, board
  sudo -u mbot-agent mbot-agent check      until it is content
  sudo systemctl start mbot-agent          wheels off the ground the first time
  journalctl -u mbot-agent -f              what it says
NEXT
    trusts_a_key || cat <<KEYS

It takes models only from keys that it trusts. On the workstation:
  workstation keys new                     makes a key and says how the robot learns of it
KEYS
    [ -z "$was_running" ] || echo "mbot-agent was running and runs again, with what was installed."
}

remove_all() {
    step "Removing mbot-agent"
    if [ -L "$unit" ] || [ -e "$unit" ]; then
        # shellcheck disable=SC2086  # a list of names
        try systemctl disable --now "$service" $updater_units
    fi
    for name in "$service" $updater_units; do
        run rm -f "$units/$name"
        # What `systemctl edit` has made.
        [ -z "$purge" ] || run rm -rf "$units/$name.d"
    done
    run rm -f "$rules" "$brltty_rules" "$modules" "$sysusers" "$command_link"
    # Debian has no such folder before the first file of ours.
    [ ! -d "${sysusers%/*}" ] || run rmdir --ignore-fail-on-non-empty "${sysusers%/*}"
    run rm -rf "$application"
    run systemctl daemon-reload
    try udevadm control --reload
    if [ -n "$purge" ]; then
        step "Removing configuration, models and user"
        run rm -rf "$configuration" "$state"
        if getent passwd "$user" >/dev/null; then
            try userdel "$user"
        fi
    else
        note "kept: $configuration, $state and the user $user (--purge removes them)"
    fi
    note "packages of apt-get stay: python3-venv, python3-picamera2"
}

if [ -n "$uninstall" ]; then
    require_root
    remove_all
    exit 0
fi

[ -n "$archive" ] || [ -f "$checkout/pyproject.toml" ] ||
    fail "$checkout is not a checkout of mbot-agent: which release?"
require_machine
require_release
require_root
ask_for_camera
install_packages
look_at_service
make_user
install_configuration
install_updater
take_over
install_release
install_service
check_brltty
show_check
show_next_steps
