#!/usr/bin/env bash
# Everything that a test asks of the distribution, and the packages named as arguments: the virtual USB lab, aravis'
# fake camera, other programs that read what fieldkit writes, what builds C, a broker, the libraries of WeasyPrint and
# a browser. Installs nothing where it is already there.
set -euo pipefail

packages=(qemu-system-x86 squashfs-tools liblzo2-2 libusb-1.0-0 libkmod2 libblkid1 libacl1 libcap2 libselinux1
    aravis-tools gir1.2-aravis-0.8 libgirepository1.0-dev libcairo2-dev pkg-config gcc g++
    libc6-dev linux-libc-dev hdf5-tools netcdf-bin gdal-bin poppler-utils mandoc man-db systemd mosquitto
    libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0 chromium "$@")

missing=()
for package in "${packages[@]}"; do
    dpkg-query --show --showformat '${db:Status-Abbrev}' "$package" 2>/dev/null | grep -q '^ii' || missing+=("$package")
done

as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }

# The guest's kernel comes from the package lists too, and old lists name packages that are gone.
as_root apt-get -qq update || echo "the package lists could not be refreshed; going on with those that are here"
if [ "${#missing[@]}" -gt 0 ]; then
    echo "installing: ${missing[*]}"
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=600 \
        install --no-install-recommends "${missing[@]}" >/dev/null
fi
