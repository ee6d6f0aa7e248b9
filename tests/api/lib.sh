# lib.sh - what the API tests share: a daemon with a fresh data folder, requests, checks printed as TAP.
# Sourced by the scripts beside it, which run from the root of the tree.
# After `request`, $code holds the status, $body and $headers the files of the answer.

set -u
cd "$(dirname "${BASH_SOURCE[0]}")/../.." || exit 1
DRAPED=${DRAPED:-build/draped}
DRAPE=${DRAPE:-build/drape}
work=$(mktemp -d "${TMPDIR:-/tmp}/draped-test.XXXXXX")
data=$work/data
body=$work/body
headers=$work/headers
log=$work/log
export CONFIGURATION_DIRECTORY=$work # not the settings of the machine
pid='' url='' admin='' code=''
tests=0 kept=0

# ---- TAP ---------------------------------------------------------------------------------------

ok() { tests=$((tests + 1)); echo "ok $tests - $1"; }
not_ok() {
    tests=$((tests + 1))
    echo "not ok $tests - $1"
    shift
    (($#)) && printf '# %s\n' "$@"
}
skip() { tests=$((tests + 1)); echo "ok $tests - # SKIP $1"; }

# check NAME COMMAND...: holds when the command succeeds; its output explains a failure.
check() {
    local name=$1 said
    shift
    if said=$("$@" 2>&1); then ok "$name"; else not_ok "$name" "$*: status $?" "${said:0:600}"; fi
}
is() { if [[ $2 == "$3" ]]; then ok "$1"; else not_ok "$1" "got    ${2:0:600}" "wanted ${3:0:600}"; fi; }
like() { if [[ $2 =~ $3 ]]; then ok "$1"; else not_ok "$1" "got     ${2:0:600}" "pattern $3"; fi; }
# json NAME FILTER [FILE]: holds when the jq filter gives true for the last body (or FILE).
json() {
    if jq -e "$2" "${3:-$body}" >"$work/jq" 2>&1; then ok "$1"; else
        not_ok "$1" "filter $2 gave $(head -c 200 "$work/jq")" "body $(head -c 600 "${3:-$body}")"
    fi
}
finish() {
    local said
    if ((kept)); then
        if said=$(tests/api/contract.py answers "$work/answers"); then ok 'every answer is as the OpenAPI document says'; else
            not_ok 'every answer is as the OpenAPI document says' "$said"
        fi
        echo "# ${said##*$'\n'}"
    fi
    echo "1..$tests"
}

# ---- the daemon ----------------------------------------------------------------------------------

# start_daemon [FLAG...]: on ports the kernel picks; sets pid, url and admin.
start_daemon() {
    rm -f "$work/url"
    "$DRAPED" --listen 127.0.0.1:0 --admin 127.0.0.1:0 --data "$data" --url-file "$work/url" \
        --drain-timeout 1 "$@" \
        2>>"$log" &
    pid=$!
    for ((i = 0; i < 3000; i++)); do
        if [[ -s $work/url ]] && { read -r url && read -r admin; } <"$work/url"; then return 0; fi
        kill -0 "$pid" 2>/dev/null || break
        sleep 0.01
    done
    echo "Bail out! the daemon did not start: $(tail -n 5 "$log")"
    exit 1
}
# hear_notices FILE: what is sent to NOTIFY_SOCKET=$work/notify is written to FILE; sets ear, to be killed.
hear_notices() {
    build/release/tests/api/notified "$work/notify" >"$1" &
    ear=$!
    until [[ -S $work/notify ]]; do
        kill -0 "$ear" 2>/dev/null || { echo 'Bail out! notified does not run: is it built?'; exit 1; }
        sleep 0.01
    done
}
# stop_daemon: SIGTERM, then its exit status in $status.
stop_daemon() {
    kill -TERM "$pid"
    wait "$pid"
    status=$?
    pid=''
}
# Under tests/cover.sh: what a daemon that is about to be killed has counted.
flush_counts() {
    [[ -n ${FLUSHED-} ]] || return 0
    rm -f "$FLUSHED"
    kill -USR1 "$pid"
    for ((i = 0; i < 500; i++)); do [[ -e $FLUSHED ]] && return 0; sleep 0.01; done
}
kill_daemon() {
    flush_counts
    kill -KILL "$pid"
    wait "$pid" 2>/dev/null
    pid=''
}
leave() {
    [[ -n $pid ]] && flush_counts && kill -KILL "$pid" 2>/dev/null && wait "$pid" 2>/dev/null
    # What the daemon said helps to understand a failure, and a sanitizer's report is one.
    if [[ -s $log ]] && grep -qE 'Sanitizer|runtime error' "$log"; then
        echo "not ok $((tests + 1)) - a sanitizer reported"
    fi
    [[ -s $log ]] && sed 's/^/# draped: /' "$log" | tail -n 60
    rm -rf "$work"
}
trap leave EXIT
trap 'exit 1' INT TERM

# ---- requests --------------------------------------------------------------------------------------

# request METHOD PATH [CURL-ARGUMENT...]: status 000 when there was no answer.
request() {
    local method=$1 path=$2
    shift 2
    [[ $path == /* ]] && path=$url$path
    [[ $method == HEAD ]] && set -- --head "$@"
    : >"$body"
    code=$(curl -s --max-time 60 -X "$method" -o "$body" -D "$headers" -w '%{http_code}' "$@" "$path")
    keep_answer "$method" "$path"
}
# keep_answer METHOD URL: for `finish`, which holds every answer against the OpenAPI document.
keep_answer() {
    local stem=$work/answers/$((kept += 1))
    mkdir -p "$work/answers"
    local listener=api
    [[ $2 == "$admin"/* ]] && listener=admin
    printf '%s\n' "$1" "$2" "$code" "$listener" >"$stem.meta"
    cp "$headers" "$stem.headers"
    cp "$body" "$stem.body"
}
header() { sed -n "s/^$1: *//Ip" "$headers" | tr -d '\r' | head -n 1; }

# raw TEXT [SECONDS]: sends bytes as they are (printf escapes) on a new connection; prints the answer.
raw() {
    local address=${url#http://}
    # dd sends all in one piece: the answer must not race against the rest of the request.
    timeout "${2:-5}" bash -c 'exec 3<>"/dev/tcp/$0/$1" && printf "$2" | dd bs=1M iflag=fullblock >&3 && cat <&3' \
        "${address%:*}" "${address##*:}" "$1" 2>/dev/null | tr -d '\0'
}

# problem NAME STATUS CODE [POINTER]: the last answer is that refusal, with every member the contract names.
problem() {
    local name=$1 want=$2 want_code=$3 pointer=${4-}
    local filter='(.type | type == "string") and (.title | type == "string") and (.detail | type == "string")
        and (.instance | type == "string") and (.request_id | type == "string" and length > 0)
        and (.retryable | type == "boolean") and (.errors == null or (.errors | type == "array"))
        and .status == $status and .code == $code
        and ($pointer == "" or ([.errors[].pointer] | index($pointer) != null))'
    if [[ $code != "$want" ]]; then
        not_ok "$name" "status $code, wanted $want" "body $(head -c 600 "$body")"
    elif [[ $(header content-type) != application/problem+json* ]]; then
        not_ok "$name" "content type $(header content-type)" "body $(head -c 600 "$body")"
    elif ! jq -e --argjson status "$want" --arg code "$want_code" --arg pointer "$pointer" "$filter" \
        "$body" >/dev/null; then
        not_ok "$name" "wanted status $want code $want_code pointer '$pointer'" "body $(head -c 600 "$body")"
    else
        ok "$name"
    fi
}

# ---- jobs --------------------------------------------------------------------------------------------

# square N [FILTER]: a job of 2 N^2 triangles, a square of 0.2 m held along one edge, passed through
# a jq filter. Small squares come to rest within a second.
square() {
    awk -v n="$1" 'BEGIN {
        m = n + 1; h = 0.2 / n
        for (i = 0; i < m; i++) for (j = 0; j < m; j++) {
            x = x sep i * h ",0," j * h; p = p sep i * h "," j * h; sep = ","
        }
        for (i = 0; i < n; i++) for (j = 0; j < n; j++) {
            a = i * m + j; b = a + m
            t = t (t == "" ? "" : ",") a "," a + 1 "," b + 1 "," a "," b + 1 "," b
        }
        for (k = 0; k < 2 * m; k++) pins = pins (k ? "," : "") k
        printf "{\"cloth\":{\"mesh\":{\"positions\":[%s],\"triangles\":[%s],\"pattern\":[%s]},", x, t, p
        printf "\"pins\":[%s],\"materials\":[{\"density\":0.15,\"stretch\":{\"weft\":400,\"warp\":400,", pins
        printf "\"shear\":150},\"poisson\":0.2,\"bend\":{\"weft\":1e-5,\"warp\":1e-5,\"twist\":5e-6}}]},"
        printf "\"solver\":{\"time_step\":0.02,\"tolerance\":0.01,\"max_iterations\":400}}\n"
    }' | jq -c "${2:-.}"
}
# A job that never comes to rest by itself: undamped dynamics for as long as the limits allow.
endless() { square "${1:-24}" '.solver.method = "dynamic" | .solver.tolerance = 1e-99 | .solver.max_iterations = 100000'"${2:-}"; }

# submit FILE: posts it; sets id, or leaves it empty.
submit() {
    request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$1"
    id=$(jq -r '.id // empty' "$body" 2>/dev/null)
}
# status_of ID
status_of() { curl -s --max-time 10 "$url/v1/jobs/$1" | jq -r .status; }
# wait_for ID PATTERN [SECONDS]: until its status matches; the job is left in $body.
wait_for() {
    local deadline=$((SECONDS + ${3:-60}))
    while request GET "/v1/jobs/$1"; do
        [[ $(jq -r .status "$body") =~ ^($2)$ ]] && return 0
        ((SECONDS < deadline)) || return 1
        sleep 0.03
    done
    return 1
}
