#!/usr/bin/env bash
# Run by test.sh as root in a new Debian: install, use, remove, purge.
set -euo pipefail
step() { printf '%s\n' "-- $*"; }
files() { find / -xdev \( -path /proc -o -path /run -o -path /dev -o -path /tmp -o -path /root -o -path /var/log \) -prune -o -print | LC_ALL=C sort; }
check() { "$@" || { echo "FAILED: $*" >&2; exit 1; }; }
as_fieldkit=(setpriv --reuid=fieldkit --regid=fieldkit --init-groups env HOME=/var/lib/fieldkit)

unit=/usr/lib/systemd/system/fieldkit.service
files >/tmp/before
getent passwd >/tmp/passwd; getent group | cut -d: -f1 >/tmp/group

step install
dpkg --install /root/fieldkit.deb
fieldkit --version
fieldkit --version | check grep --quiet 'Debian package'

step user, rules, unit, man pages, completion
check [ "$(id --groups --name fieldkit | tr ' ' '\n' | sort | xargs)" = "dialout fieldkit plugdev video" ]
check [ "$(stat --format '%U %a' /var/lib/fieldkit)" = "fieldkit 750" ]
check [ -s /usr/lib/udev/rules.d/70-fieldkit.rules ]
check [ -z "$(systemd-analyze verify $unit 2>&1 | tee /dev/stderr)" ]
check [ "$(systemctl is-enabled fieldkit.service)" = disabled ]
man --where fieldkit-record
check [ -s /usr/share/bash-completion/completions/fieldkit ]

step "record as the unit's user, under simulated instruments"
campaign=/var/lib/fieldkit/campaign
"${as_fieldkit[@]}" fieldkit init --simulated $campaign
"${as_fieldkit[@]}" fieldkit record -C $campaign --for 2m --set simulation.speed=max --name first
session=$(echo $campaign/recordings/*first.h5)
"${as_fieldkit[@]}" fieldkit check "$session"

step "the unit's commands serve the page"
read -ra recover <<<"$(sed -n 's/^ExecStartPre=-//p' $unit)"
read -ra serve <<<"$(sed -n 's/^ExecStart=//p' $unit)"
cd $campaign
"${as_fieldkit[@]}" "${recover[@]}"
"${as_fieldkit[@]}" "${serve[@]}" >/tmp/page.log 2>&1 &
page=$!
touch /tmp/page.log
for _ in $(seq 60); do grep --quiet 'http://' /tmp/page.log && break; sleep 1; done
url=$(grep --only-matching --max-count=1 'http://[^ ]*' /tmp/page.log)
python3 -c 'import sys, urllib.request; print(urllib.request.urlopen(sys.argv[1]).status, sys.argv[1])' "$url"
kill -TERM $page
wait $page || true
cd /
running() { find /proc -maxdepth 1 -user fieldkit -exec sh -c 'tr "\0" " " <"$1/cmdline"' - {} \; 2>/dev/null; }
for _ in $(seq 20); do [ -n "$(running)" ] || break; sleep 1; done
check [ -z "$(running | tee /dev/stderr)" ]

step install again over itself
dpkg --install /root/fieldkit.deb

step enable, remove
systemctl enable fieldkit.service
dpkg --remove fieldkit
check [ ! -e /etc/systemd/system/multi-user.target.wants/fieldkit.service ]
check [ ! -e /usr/lib/fieldkit ]
check [ -e $campaign/fieldkit.toml ]

step purge
dpkg --purge fieldkit
files >/tmp/after
left=$(comm -13 /tmp/before /tmp/after | grep -v '^/var/cache/man\|^/var/lib/dpkg/')
printf 'left:\n%s\n' "$left"
expected=$(printf '%s\n' /var/lib/fieldkit $campaign $campaign/recordings "$session")
check [ "$left" = "$expected" ]
check cmp /tmp/passwd <(getent passwd)
check cmp /tmp/group <(getent group | cut -d: -f1)
step passed
