#!/bin/sh
# Installs the release that lies beside it, with the configuration and certificates that
# `workstation setup-card` has put there, and starts the daemon, which keeps still until somebody says
# `workstation run`. Cut off at any moment it starts over at the next boot. What it says is in
# mbot-set-up.log on the boot partition, to be read on another computer.
set -eu
umask 022

here=$(cd "$(dirname "$0")" && pwd)
unpacked=/var/tmp/mbot-set-up
units=/etc/systemd/system

exec >"${here%/*}/mbot-set-up.log" 2>&1

if [ -f "$here/release.tar" ]; then
    rm -rf "$unpacked"
    mkdir -p "$unpacked"
    tar -xf "$here/release.tar" -C "$unpacked" deploy updater
    # shellcheck disable=SC2046  # a list of options
    sh "$unpacked/deploy/install.sh" $(cat "$here/install-options") \
        --config "$here/config.toml" "$here/release.tar"
    [ ! -f "$here/enrolment.tar" ] || tar -xf "$here/enrolment.tar" -C / -p
    rm -rf "$unpacked"
    sync
fi

# A robot's key shall not stay where any computer reads it. After a cut in here the next boot goes
# on here.
rm -f "$here/enrolment.tar"
rm -f "$here/release.tar"
rm -f "$here/config.toml"
rm -rf "$here"
rm -f "$units/multi-user.target.wants/mbot-set-up.service" "$units/mbot-set-up.service"
systemctl daemon-reload
systemctl --no-block restart mbot-agent.service
echo "mbot-agent is set up."
sync
