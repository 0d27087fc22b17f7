#!/bin/sh
# Install hashed requirements into an environment; trouble is said in words.
# usage: install.sh PYTHON ARGUMENTS_OF_PIP...
set -u
python=$1
shift
said=$(mktemp)
trap 'rm -f "$said"' EXIT
if "$python" -m pip install --disable-pip-version-check --retries 2 --timeout 20 "$@" >"$said" 2>&1; then
    grep '^Successfully' "$said" | cut -c 1-100
    exit 0
fi
tail -n 15 "$said" >&2
if grep -qi 'CERTIFICATE_VERIFY_FAILED' "$said"; then
    printf '\nmake: the package index shows a certificate that is not trusted here; a proxy of your network may stand between\n  -> type: %s\n     then the same make again\n' \
        "export PIP_CERT=/path/to/its/certificates.pem" >&2
elif grep -qiE 'name resolution|NewConnectionError|ConnectTimeout|Network is unreachable|Max retries|ProxyError|Connection refused' "$said"; then
    printf '\nmake: no network: the package index cannot be reached\n  -> type: %s\n     then the same make again\n' \
        "$python -m pip config list   (a mirror: pip config set global.index-url https://...)" >&2
elif grep -qi 'No space left' "$said"; then
    printf '\nmake: the disk is full\n  -> type: df -h .\n     make room, then the same make again\n' >&2
else
    printf '\nmake: pip could not install: see above\n  -> type: make clean\n     then the same make again\n' >&2
fi
exit 1
