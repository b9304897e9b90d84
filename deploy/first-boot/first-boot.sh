#!/bin/sh
# On a card's boot partition, where `workstation setup-card` has put it: lets systemd set mbot-agent
# up from this folder at the next boot, or with "now" at once. What Raspberry Pi Imager has written
# calls it, or the kernel's command line.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
units=${MBOT_UNITS:-/etc/systemd/system}

mkdir -p "$units/multi-user.target.wants"
sed "s|@HERE@|$here|g" "$here/mbot-set-up.service" >"$units/mbot-set-up.service"
ln -sf ../mbot-set-up.service "$units/multi-user.target.wants/mbot-set-up.service"

# Only once by the command line.
words='systemd.run_success_action=reboot systemd.unit=kernel-command-line.target'
sed -i "s| systemd.run=[^ ]*/mbot/first-boot.sh $words||" "${here%/*}/cmdline.txt"

if [ "${1:-}" = now ]; then
    systemctl daemon-reload
    systemctl --no-block start mbot-set-up.service
fi
