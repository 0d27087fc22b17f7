#!/bin/sh
# Install hashed requirements into an environment; trouble is said in words, and now and then that it still goes on.
# usage: install.sh PYTHON ARGUMENTS_OF_PIP...; EVERY_S: seconds between two such lines.
set -u
python=$1
shift
said=$(mktemp)
began=$(date +%s)
while sleep "${EVERY_S:-20}" >/dev/null 2>&1 && kill -0 $$ 2>/dev/null; do # it outlives nobody
    printf 'make: pip goes on, %s s: %s\n' "$(($(date +%s) - began))" "$(tail -n 1 "$said" | cut -c 1-80)"
done &
telling=$!
"$python" -m pip install --disable-pip-version-check --retries 2 --timeout 20 "$@" >"$said" 2>&1 &
pip=$!
trap 'kill "$telling" "$pip" 2>/dev/null; rm -f "$said"' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP
if wait "$pip"; then # not in the foreground: told to end, this one ends pip as well
    grep '^Successfully' "$said" | cut -c 1-100
    exit 0
fi
tail -n 15 "$said" >&2
if grep -qi 'CERTIFICATE_VERIFY_FAILED' "$said"; then
    printf '\nmake: the package index shows a certificate that is not trusted here; a proxy of your network may stand between: name the file of its certificates\n  -> type: %s\n     then the same make again\n' \
        "export PIP_CERT=/path/to/its/certificates.pem" >&2
elif grep -qiE 'name resolution|NewConnectionError|ConnectTimeout|Network is unreachable|Max retries|ProxyError|Connection refused' "$said"; then
    printf '\nmake: no network: the package index cannot be reached; look at cable, name server and proxy first (a mirror of the index is named by pip config set global.index-url)\n  -> type: %s\n     then the same make again\n' \
        "cat /etc/resolv.conf; env | grep -i proxy; $python -m pip config list" >&2
elif grep -qi 'No space left' "$said"; then
    printf '\nmake: the disk is full\n  -> type: df -h .\n     make room, then the same make again\n' >&2
else
    printf '\nmake: pip could not install: see above\n  -> type: make clean\n     then the same make again\n' >&2
fi
exit 1
