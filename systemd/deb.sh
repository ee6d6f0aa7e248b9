#!/bin/bash
# Makes a Debian package of what `make install` installs: build/draped_VERSION_ARCH.deb.
# $MAKE is the make command. What dpkg wants beside the files is written here, in build/deb.
set -euo pipefail
cd "$(dirname "$0")/.."
umask 022
root=build/deb/root
version=$(build/draped --version | sed 's/^draped //')
arch=$(dpkg --print-architecture)
# DEBFULLNAME and DEBEMAIL as elsewhere in Debian; else who made the last change.
maintainer="${DEBFULLNAME:-$(git log -1 --format=%an)} <${DEBEMAIL:-$(git log -1 --format=%ae)}>"
date=$(git log -1 --format=%cD)
rm -rf build/deb
mkdir -p "$root/DEBIAN" build/deb/debian

${MAKE:-make} install DESTDIR="$PWD/$root" PREFIX=/usr UNITDIR=/lib/systemd/system >/dev/null
strip --strip-unneeded --remove-section=.comment --remove-section=.note "$root"/usr/bin/*
printf 'draped (%s) unstable; urgency=medium\n\n  * See README.md.\n\n -- %s  %s\n' "$version" "$maintainer" "$date" |
    gzip -9n >"$root/usr/share/doc/draped/changelog.gz"
# In its place comes the form that Debian has for it.
rm "$root/usr/share/doc/draped/LICENSE"
{
    printf 'Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n\nFiles: *\n'
    sed -n 's/^Copyright (c) /Copyright: /p' LICENSE
    printf 'License: Expat\n'
    sed -n '/^Permission is/,$ { s/^$/./; s/^/ /; p }' LICENSE
} >"$root/usr/share/doc/draped/copyright"

# What the programs are linked to, as packages.
printf 'Source: draped\n\nPackage: draped\nArchitecture: any\n' >build/deb/debian/control
depends=$(cd build/deb && dpkg-shlibdeps -O root/usr/bin/draped root/usr/bin/drape | sed -n 's/^shlibs:Depends=//p')
cat >"$root/DEBIAN/control" <<CONTROL
Package: draped
Version: $version
Architecture: $arch
Maintainer: $maintainer
Installed-Size: $(du -sk --exclude=DEBIAN "$root" | cut -f1)
Depends: $depends
Recommends: systemd
Section: science
Priority: optional
Description: finds how garments hang at rest, over HTTP
 A pattern, its seams and a body go in as JSON, the draped garment comes out
 as GLB, OBJ, PLY or JSON, with an account of how far it is from rest.
 .
 This package holds the daemon, draped, with its systemd units, and its
 command line client, drape.
CONTROL
cat >"$root/DEBIAN/postinst" <<'POSTINST'
#!/bin/sh
set -e
# The admin decides when to serve: systemctl enable --now draped.socket draped-admin.socket
if [ -d /run/systemd/system ]; then
    systemctl --system daemon-reload >/dev/null || true
    systemctl try-restart draped.service >/dev/null || true
fi
POSTINST
cat >"$root/DEBIAN/prerm" <<'PRERM'
#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl disable --now draped.socket draped-admin.socket draped.service >/dev/null 2>&1 || true
fi
PRERM
chmod 755 "$root/DEBIAN/postinst" "$root/DEBIAN/prerm"
(cd "$root" && find usr lib -type f -print0 | sort -z | xargs -0 md5sum) >"$root/DEBIAN/md5sums"
dpkg-deb --build --root-owner-group "$root" "build/draped_${version}_$arch.deb"
