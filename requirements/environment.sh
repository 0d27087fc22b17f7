#!/bin/sh
# Make .venv, or mend it: what stands in the way is said with the one command to type, and nothing half made is left.
# usage: environment.sh VENV; PYTHON names another interpreter.
set -u
venv=${1:?"usage: environment.sh VENV"}
again="then the same make again"
new_enough='import sys; sys.exit(sys.version_info < (3, 11))'

stop() {
    printf '\nmake: %s\n  -> type: %s\n     %s\n' "$1" "$2" "$again" >&2
    exit 1
}

apt() { # what root types
    if [ "$(id -u)" = 0 ]; then echo "apt-get install -y $1"; else echo "sudo apt-get install -y $1"; fi
}

python=
for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
    if "$candidate" -c "$new_enough" 2>/dev/null; then
        python=$candidate
        break
    fi
done
if [ -z "$python" ]; then
    found=$(${PYTHON:-python3} --version 2>/dev/null || echo "no Python")
    stop "needs Python 3.11 or newer; found is $found" "$(apt 'python3.11 python3.11-venv')  (Debian 12 and newer have it)"
fi

# One whose Python is gone or too old, or that was left half made, is made anew.
if [ -e "$venv" ] && ! { "$venv/bin/python" -c "$new_enough" && "$venv/bin/python" -m pip --version; } >/dev/null 2>&1; then
    echo "make: $venv is broken or of another Python; it is made anew"
    rm -rf "$venv"
fi
if [ ! -e "$venv" ]; then
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        stop "$python $version has no ensurepip, which Debian keeps in a package of its own" "$(apt "python$version-venv")"
    fi
    echo "make: making $venv with $("$python" --version)"
    if ! "$python" -m venv "$venv"; then
        rm -rf "$venv"
        stop "$venv could not be made: see above" "df -h . && ls -ld ."
    fi
fi
