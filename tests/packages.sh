#!/bin/bash
# Installs the Debian packages that a build lacks, saying which and why; silent when none is missing.
# usage: tests/packages.sh build|check|upkeep|deb|bench
set -euo pipefail

build='
gcc                   the C compiler
libc6-dev             the C library headers
pkg-config            finds the flags of the libraries below
libmicrohttpd-dev     draped: HTTP
libjansson-dev        draped and drape: JSON
libsuitesparse-dev    the solver: CHOLMOD
libopenblas-dev       the solver: the BLAS under CHOLMOD
libsqlite3-dev        draped: the job store
libsodium-dev         draped: SHA-256 and random ids
libsystemd-dev        draped: readiness and watchdog notices
libinih-dev           draped: its file of settings
zlib1g-dev            draped: gzip
libzstd-dev           draped: zstd
libplplot-dev         draped and drape: plots of traces
libcurl4-openssl-dev  drape: HTTP
libosmesa6-dev        drape: the picture, drawn in memory
libglu1-mesa-dev      drape: the camera of the picture
libpng-dev            drape: the picture as a file
curl                  the demo and the tests speak HTTP with it
jq                    the demo and the tests read JSON with it'

check='
libcmocka-dev         the unit tests
sqlite3               the tests: whether the store is whole, seen from outside
python3-jsonschema    the answers, held against the OpenAPI document
systemd               the units: systemd-analyze, systemd-socket-activate
lintian               the Debian package
libfaketime           the tests: a clock that jumps
util-linux            the tests: prlimit, mount
zstd                  the API tests: bodies and answers in zstd
valgrind              the counts: instructions by function (callgrind)
clang                 the fuzzers: libFuzzer
libclang-rt-14-dev    the fuzzers: the sanitizer runtimes of clang
libomp-14-dev         the fuzzers: the omp.h of clang'

upkeep='
clang-format          make format
clang-tidy            make lint
cppcheck              make lint
jq                    make compile_commands.json'

bench='
wrk                   make bench-load: requests as fast as they are answered'

deb='
dpkg-dev              make deb: the packages that the programs need'

case ${1-} in
build) list=$build ;;
check) list=$build$check$deb ;;
upkeep) list=$upkeep ;;
deb) list=$build$deb ;;
bench) list=$build$bench ;;
*) echo "usage: $0 build|check|upkeep|deb|bench" >&2; exit 2 ;;
esac

if ! command -v dpkg-query >/dev/null; then
    echo "packages: not a Debian system; see tests/packages.sh for what is needed" >&2
    exit 0
fi

# dpkg-query complains about names it has never heard of; those are simply missing.
have=$(dpkg-query -W -f '${Package} ${db:Status-Status}\n' 2>/dev/null | sed -n 's/ installed$//p')
missing=()
while read -r package reason; do
    [[ -z $package ]] && continue
    grep -qxF "$package" <<<"$have" && continue
    (( ${#missing[@]} )) || echo "packages: missing"
    printf '  %-21s %s\n' "$package" "$reason"
    missing+=("$package")
done <<<"$list"
(( ${#missing[@]} )) || exit 0

root=()
if (( EUID != 0 )); then
    command -v sudo >/dev/null || {
        echo "packages: install them as root: apt-get install ${missing[*]}" >&2
        exit 1
    }
    root=(sudo)
fi
echo "packages: apt-get install ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
trap 'rm -f "$log"' EXIT
apt() { "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Dpkg::Use-Pty=0 "$@" >>"$log" 2>&1; }
# The package lists of a fresh machine may be absent or stale: fetch them once if the first try fails.
apt install -y --no-install-recommends "${missing[@]}" ||
    { apt update && apt install -y --no-install-recommends "${missing[@]}"; } ||
    { cat "$log" >&2; echo "packages: apt-get failed" >&2; exit 1; }
