#!/usr/bin/env bash
# make deb: dist/fieldkit_VERSION_ARCHITECTURE.deb from the wheel in dist, for the Debian release that this runs on.
# fieldkit and its libraries lie below /usr/lib/fieldkit, where Debian's Python runs them.
set -euo pipefail
cd "$(dirname "$0")/../.."
here=packaging/debian
root=build/deb
home=usr/lib/fieldkit
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct 2>/dev/null || echo 1700000000) # as make dist
export SOURCE_DATE_EPOCH

rm -rf "$root"
/usr/bin/python3 -m venv --without-pip "$root/$home"
.venv/bin/python -m pip --python "$root/$home/bin/python3" install --quiet --no-compile --constraint constraints.txt \
    "$(echo dist/fieldkit_slope-*.whl)[page,alarms]"

# Of the virtual environment the interpreter and fieldkit stay; nothing names the folder it was built in.
find "$root/$home/bin" -type f -not -name fieldkit -delete
sed -i "1s|.*|#!/$home/bin/python3|" "$root/$home/bin/fieldkit"
sed -i '/^command = /d' "$root/$home/pyvenv.cfg"
for record in "$root/$home"/lib/python3*/site-packages/*.dist-info; do
    rm -f "$record/RECORD" "$record/REQUESTED" "$record/direct_url.json"
    echo dpkg >"$record/INSTALLER"
done

# What Debian looks for in other places.
share="$root/usr/share"
mkdir -p "$root/usr/bin" "$share/man" "$share/zsh" "$share/doc/fieldkit"
ln -s "../lib/fieldkit/bin/fieldkit" "$root/usr/bin/fieldkit"
mv "$root/$home/share/man/man1" "$share/man/"
gzip -9 --no-name "$share"/man/man1/*
mv "$root/$home/share/bash-completion" "$share/"
mv "$root/$home/share/zsh/site-functions" "$share/zsh/vendor-completions"
mv "$root/$home/share/fish" "$share/"
rm -r "$root/$home/share"
install -m 644 LICENSE "$share/doc/fieldkit/copyright"
gzip -9 --no-name <CHANGELOG.md >"$share/doc/fieldkit/changelog.gz"
install -m 644 -D udev/70-fieldkit.rules -t "$root/usr/lib/udev/rules.d"
install -m 644 -D "$here/sysusers.conf" "$root/usr/lib/sysusers.d/fieldkit.conf"
mkdir -p "$root/usr/lib/systemd/system"
"$root/$home/bin/python3" -B -m fieldkit.recording.service >"$root/usr/lib/systemd/system/fieldkit.service"

# Names, sizes and checksums.
version=$("$root/$home/bin/python3" -B -c 'import fieldkit; print(fieldkit.__version__)')
python=$(/usr/bin/python3 -c 'import sys; print(sys.version_info.minor)')
architecture=$(dpkg --print-architecture)
find "$root" -type d -name __pycache__ -prune -exec rm -r {} +
chmod -R u=rwX,go=rX "$root"
mkdir -p "$root/DEBIAN"
install -m 755 "$here"/{postinst,prerm,postrm} "$root/DEBIAN/"
sed "s/@VERSION@/$version/; s/@ARCHITECTURE@/$architecture/; s/@PYTHON@/3.$python/; s/@NEXT_PYTHON@/3.$((python + 1))/
    s/@SIZE@/$(du --summarize --apparent-size "$root/usr" | cut -f1)/" "$here/control" >"$root/DEBIAN/control"
(cd "$root" && find usr -type f -print0 | LC_ALL=C sort -z | xargs -0 md5sum) >"$root/DEBIAN/md5sums"
dpkg-deb -Zzstd --root-owner-group --build "$root" "dist/fieldkit_${version}_$architecture.deb"
