#!/usr/bin/env bash
# make test-deb: install the package in a new Debian, use it, remove it, and look at what is left. Needs root and debootstrap.
set -euo pipefail
cd "$(dirname "$0")/../.."
deb=$(realpath "${1:-$(echo dist/fieldkit_*.deb)}")
base=${DEBIAN_BASE:-build/debian-base}
suite=${DEBIAN_SUITE:-$(. /etc/os-release && echo "$VERSION_CODENAME")} # of which the package is made

if [ ! -e "$base/etc/debian_version" ]; then
    packages=systemd,udev,libusb-1.0-0,python3,man-db,adduser
    debootstrap --variant=minbase --include="$packages" "$suite" "$base"
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp -a "$base" "$work/root"
cp "$deb" "$work/root/root/fieldkit.deb"
install -m 755 packaging/debian/test_inside.sh "$work/root/root/"
# A namespace of its own: what is mounted in it is gone when its last process is.
# shellcheck disable=SC2016 # the inner shell expands $1
unshare --mount --pid --fork sh -c '
    mount -t proc proc "$1/proc"
    mount --rbind /dev "$1/dev" # simulated instruments answer on pseudo-terminals
    exec chroot "$1" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 /root/test_inside.sh' - "$work/root"
