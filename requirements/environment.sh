#!/bin/sh
# Make .venv, or mend it: what stands in the way is said with the one command to type, and nothing half made is left.
# What is to be typed stands alone in its line, and is pasted as it is: remarks go into the sentence above it.
# usage: environment.sh VENV; PYTHON names another interpreter.
set -u
venv=${1:?"usage: environment.sh VENV"}
again="then the same make again"
fits='import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))'

stop() {
    printf '\nmake: %s\n  -> type: %s\n     %s\n' "$1" "$2" "$again" >&2
    exit 1
}

apt() { # what root types
    if [ "$(id -u)" = 0 ]; then as=; else as='sudo '; fi
    echo "${as}apt-get update && ${as}apt-get install -y $1"
}

python=
for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
    if "$candidate" -c "$fits" 2>/dev/null; then
        python=$candidate
        break
    fi
done
if [ -z "$python" ]; then
    found=$(${PYTHON:-python3} --version 2>/dev/null || echo "no Python")
    case $found in # a computer without any gets its system's own: Debian 12 and 13 have one that fits
    "no Python") packages=python3-venv ;;
    *" 3.1"[4-9]*) packages="python3.13 python3.13-venv" ;;
    *) packages="python3.11 python3.11-venv" ;;
    esac
    stop "needs Python 3.11 to 3.13; found is $found" "$(apt "$packages")"
fi

# One whose Python is gone, too old or too new, or that was left half made, is made again.
if [ -e "$venv" ] && ! { "$venv/bin/python" -c "$fits" && "$venv/bin/python" -m pip --version; } >/dev/null 2>&1; then
    echo "make: $venv is broken or of another Python; it is made anew"
    rm -rf "$venv"
fi
if [ ! -e "$venv" ]; then
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        case $python in
        python3) package=python3-venv ;; # of the system's own Python
        *) package=python$version-venv ;;
        esac
        stop "$python $version has no ensurepip, which Debian keeps in a package of its own" "$(apt "$package")"
    fi
    echo "make: making $venv with $("$python" --version)"
    if ! "$python" -m venv "$venv"; then
        rm -rf "$venv"
        stop "$venv could not be made: see above" "df -h . && ls -ld ."
    fi
fi
