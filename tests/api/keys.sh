#!/bin/bash
# Keys: who is served at all, who sees what, what a key may hold, and reading the key file again.
. "$(dirname "$0")/lib.sh"

# ---- making keys
# make_key NAME: leaves the key in $work/NAME.key and its entry in $work/NAME.entry.
make_key() {
    "$DRAPED" --make-key "$1" >"$work/$1.out" || return
    sed -n 1p "$work/$1.out" >"$work/$1.key"
    sed -n 2p "$work/$1.out" >"$work/$1.entry"
}
# key_file [FILTER]: a file of the entries of shop and other, passed through a jq filter.
key_file() { jq -s "{keys: .} | ${1:-.}" "$work/shop.entry" "$work/other.entry" >"$work/keys.json.new" &&
    mv "$work/keys.json.new" "$work/keys.json"; }
# as NAME METHOD PATH [CURL-ARGUMENT...]: a request with that key.
as() {
    local name=$1
    shift
    request "$@" -H @<(printf 'Authorization: Bearer %s\n' "$(<"$work/$name.key")")
}
post_as() { as "$1" POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$2"; id=$(jq -r '.id // empty' "$body"); }
log_has() { for ((i = 0; i < 200; i++)); do grep -q "$1" "$log" && return; sleep 0.02; done; false; }
reload() { local n; n=$(grep -c "event=keys.$1" "$log"); kill -HUP "$pid"
    for ((i = 0; i < 200; i++)); do (($(grep -c "event=keys.$1" "$log") > n)) && return; sleep 0.02; done; false; }

umask 077
check 'a key is made' make_key shop
check 'and another' make_key other
like 'it has 256 bits' "$(<"$work/shop.key")" '^[0-9a-f]{64}$'
is 'its entry holds its SHA-256' "$(jq -r .sha256 "$work/shop.entry")" "$(printf %s "$(<"$work/shop.key")" | sha256sum | cut -d' ' -f1)"
is 'and its name' "$(jq -r .name "$work/shop.entry")" shop
is 'a name that is none is refused' "$("$DRAPED" --make-key 'a b' >/dev/null 2>&1; echo $?)" 64

# ---- without keys, this machine only
is 'without keys no other address is bound' \
    "$("$DRAPED" --listen 0.0.0.0:0 --data "$data" 2>"$work/said"; echo "$? $(grep -c 'not a loopback' "$work/said")")" '64 1'

# ---- who is served
key_file
start_daemon --workers 1 --keys "$work/keys.json" --listen 0.0.0.0:0
url=http://127.0.0.1:${url##*:}
ok 'with keys any address is bound'
square 4 '.solver.max_iterations = 1' >"$work/job"
submit "$work/job"; problem 'without a key' 401 unauthorized
is 'it is told which scheme' "$(header www-authenticate)" Bearer
request GET /v1/jobs -H 'Authorization: Bearer 0000'; problem 'with a wrong key' 401 unauthorized
is 'it is told that' "$(header www-authenticate)" 'Bearer error="invalid_token"'
request GET /v1/jobs -H @<(printf 'Authorization: Basic %s\n' "$(<"$work/shop.key")"); problem 'with another scheme' 401 unauthorized
for path in /v1/info /v1/materials /v1/meshes/0 /nothing; do
    request GET $path; problem "no key, $path" 401 unauthorized
done
for path in / /openapi.json "$admin/livez" "$admin/readyz" "$admin/metrics"; do
    request GET "$path"; is "no key is needed for $path" "$code" 200
done
request OPTIONS /v1/jobs; is 'nor for a preflight' "$([[ $code != 401 ]] && echo served)" served
as shop GET /v1/info; is 'with a key' "$code" 200
post_as shop "$work/job"; is 'a job is taken' "$code" 202

# ---- the client
export DRAPED_URL=$url
is 'the client without a key is refused' "$("$DRAPE" list >/dev/null 2>"$work/said"; echo "$? $(grep -c DRAPED_KEY_FILE "$work/said")")" '2 1'
check 'the client takes a key file' "$DRAPE" list --key-file "$work/shop.key"
DRAPED_KEY_FILE=$work/shop.key check 'of the environment, too' "$DRAPE" list
DRAPED_KEY=$(<"$work/shop.key") check 'or the key itself' "$DRAPE" list
: >"$work/empty"
is 'an empty key file is named' "$("$DRAPE" list --key-file "$work/empty" 2>"$work/said"; echo "$? $(grep -c "$work/empty" "$work/said")")" '1 1'

# ---- reading the file again
make_key late
jq -s '{keys: .}' "$work"/{shop,other,late}.entry >"$work/keys.json"
as late GET /v1/info; is 'a key that is not read yet is none' "$code" 401
check 'SIGHUP reads the file' reload loaded
as late GET /v1/info; is 'then it counts' "$code" 200
echo '{"keys": [{"name": "shop"}]}' >"$work/keys.json"
check 'a broken file is told of in the log' reload refused
check 'by the place' log_has 'keys.refused why="/keys/0/sha256'
as late GET /v1/info; is 'and the old keys stay' "$code" 200
key_file 'del(.keys[0])'
check 'a key is taken away' reload loaded
as shop GET /v1/info; is 'and is none' "$code" 401
as other GET /v1/info; is 'the others stay' "$code" 200
chmod 644 "$work/keys.json"
check 'a file that everybody may read' reload loaded
check 'is warned of' log_has keys.readable
stop_daemon; is 'the daemon stops with status 0' "$status" 0

# ---- quotas, at each and one past it; and nobody sees another's
key_file '.keys[0] += {queued: 2, running: 1, mesh_bytes: 100}'
start_daemon --workers 2 --keys "$work/keys.json"
endless >"$work/endless"
jq -c '.solver.time_limit_s = 3' "$work/endless" >"$work/seconds"
wait_as() { for ((i = 0; i < 500; i++)); do as "$1" GET "/v1/jobs/$2"; [[ $(jq -r .status "$body") == "$3" ]] && return; sleep 0.02; done; false; }
post_as shop "$work/seconds"; check 'a job runs for three seconds' wait_as shop "$id" succeeded
post_as shop "$work/endless"; first=$id
check 'a job runs' wait_as shop "$first" running
for n in 1 2; do post_as shop "$work/endless"; is "job $n of two queued" "$code" 202; done
waiting=$id
is 'they wait beside an idle worker' "$(jq -r .status "$body")" queued
post_as shop "$work/endless"; problem 'the third is refused' 429 quota-queued
like 'with a time to try again: half of three seconds and more, for there are two workers' "$(header retry-after)" '^[2-9]$'
is 'the client says so' "$("$DRAPE" submit "$work/endless" --url "$url" --key-file "$work/shop.key" 2>&1 | grep -c quota-queued)" 1
post_as other "$work/job"; is 'another key is not concerned' "$code" 202
check 'and has a worker at once' wait_as other "$id" succeeded
for path in "" /events /result /trace; do
    as other GET "/v1/jobs/$first$path"; problem "another's job is not there, $path" 404 not-found
done
as other DELETE "/v1/jobs/$first"; problem 'nor can it be cancelled' 404 not-found
as other GET /v1/jobs; json 'the list is of its own' "[.jobs[].id] == [\"$id\"]"
as shop GET "/v1/jobs?status=queued"; json 'as is the other' '.jobs | length == 2'
square 4 '.solver.max_iterations = 1 | .priority = "high"' >"$work/high"
as shop DELETE "/v1/jobs/$waiting"; is 'a queued job is cancelled' "$code" 202
post_as shop "$work/high"; json 'a job of high priority goes before' '.queue_position == 1 and .priority == "high"'

mesh() { { printf 'v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n'; head -c $(($1 - 32)) /dev/zero | tr '\0' '\n'; } >"$work/mesh"; }
post_mesh() { as "$1" POST /v1/meshes -H 'Content-Type: model/obj' --data-binary "@$work/mesh"; }
mesh 100; post_mesh shop; is 'as many bytes of meshes as allowed' "$code" 201
sha=$(jq -r .sha256 "$body")
post_mesh shop; is 'one that is there costs nothing' "$code" 200
mesh 33; post_mesh shop; problem 'more are refused' 429 quota-meshes
is 'for long' "$(header retry-after)" 60
as other GET "/v1/meshes/$sha"; problem "another's mesh is not there" 404 not-found
mesh 101; post_mesh other; is 'another key is not concerned' "$code" 201
key_file 'del(.keys[0])'
check 'the key is taken away' reload loaded
as shop DELETE "/v1/jobs/$first"; problem 'nobody asks in its name any more' 401 unauthorized
like 'its jobs run on' "$(curl -s "$admin/metrics" | grep '^draped_jobs{*.*running')" ' [12]$'
stop_daemon; is 'the daemon stops with status 0' "$status" 0
key_file '.keys[0] += {mesh_bytes: 99}'
data=$work/data2 start_daemon --workers 1 --keys "$work/keys.json"
mesh 100; post_mesh shop; problem 'a byte past the quota' 429 quota-meshes
mesh 99; post_mesh shop; is 'and at it' "$code" 201
stop_daemon

# ---- never in the logs
secrets=$(cat "$work"/*.key | grep -cFf - "$log")
is 'no key is in the log' "$secrets" 0
rm "$work/keys.json"
is 'no start without the file' "$("$DRAPED" --data "$data" --keys "$work/keys.json" 2>/dev/null; echo $?)" 1

# ---- as a credential of systemd
key_file
mkdir "$work/credentials" && cp "$work/keys.json" "$work/credentials/keys"
CREDENTIALS_DIRECTORY=$work/credentials start_daemon --workers 1
request GET /v1/info; is "the service's credential is the key file" "$code" 401
as shop GET /v1/info; is 'with its keys' "$code" 200
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
