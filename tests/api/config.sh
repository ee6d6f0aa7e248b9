#!/bin/bash
# Settings from flags, environment and file: what is in force is told, what is wrong ends with its own status.
. "$(dirname "$0")/lib.sh"
conf=$work/draped.conf # where the daemon looks by itself: lib.sh
configured() { said=$("$DRAPED" "$@" --check-config 2>&1); status=$?; }

configured
is 'the defaults are fine' "$status" 0
printf '# of a shop\nmax-queued = 7\nworkers = 3\nlog-level = error\n' >"$conf"
DRAPED_WORKERS=4 DRAPED_LOG_LEVEL=info configured --log-level debug
is 'a file, the environment and a flag together are' "$status" 0
like 'the file is found in the folder that systemd names' "$said" "max-queued = 7  ; $conf:2: max-queued"
like 'the environment wins over it' "$said" 'workers = 4  ; DRAPED_WORKERS'
like 'and a flag over both' "$said" 'log-level = debug  ; --log-level'
"$DRAPED" --check-config 2>/dev/null >"$work/printed.conf"
configured --config "$work/printed.conf"
is 'what it prints is a file of settings' "$status" 0
like 'with the same ones' "$said" "max-queued = 7  ; $work/printed.conf"

configured --workers 0
is 'a bad flag is EX_USAGE' "$status" 64
like 'and named' "$said" '^draped: --workers: "0" is not a number from 1 to 256'
DRAPED_WORKERS=0 configured
is 'so is a bad variable' "$status" 64
like 'also named' "$said" '^draped: DRAPED_WORKERS: '
configured --no-such-flag
is 'and an unknown flag' "$status" 64
printf 'max-queued = 7\nmax-queue = 8\n' >"$conf"
configured
is 'a bad file is EX_CONFIG' "$status" 78
like 'with its line' "$said" "^draped: $conf:2: there is no setting \"max-queue\""
configured --config "$work/absent"
is 'so is one that is not there' "$status" 78

printf 'max-queued = 7\nmax-body = 2048\n' >"$conf"
start_daemon
request GET /v1/info
json 'the daemon goes by its file' '.limits.queued_jobs == 7 and .limits.body_bytes == 2048'
json "and says what it computes with" '(.blas | length) > 0 and (.kernels | IN("AVX-512", "AVX2", "none"))'
stop_daemon
is 'and stops with status 0' "$status" 0
finish
