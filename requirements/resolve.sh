#!/bin/sh
# Resolve every requirements file for each Python and processor that is promised, from wheels alone and by its hashes:
# so nothing is built on a station, and no compiler is needed. Nothing is installed. Needs a package index.
# usage: resolve.sh UV [FILE...]; exit code 1 names what cannot be had.
set -u
uv=${1:?"usage: resolve.sh UV [FILE...]"}
shift
here=$(dirname "$0")
[ $# -gt 0 ] || set -- "$here"/*.txt
empty=$(mktemp -d) && said=$(mktemp) || exit 1
trap 'rm -rf "$empty" "$said"' EXIT
wrong=0

for file in "$@"; do
    for python in 3.11 3.12 3.13; do
        for machine in x86_64 aarch64; do
            # manylinux_2_31 is Debian 11's C library; Debian 12 has 2.36
            if "$uv" pip install -q --dry-run --no-config --target "$empty" --require-hashes --only-binary :all: \
                --python-version $python --python-platform $machine-manylinux_2_31 -r "$file" >"$said" 2>&1; then
                echo "$(basename "$file"): Python $python on $machine: good"
            else
                wrong=1
                echo "$(basename "$file"): Python $python on $machine: cannot be had" >&2
                sed 's/^/    /' "$said" >&2
            fi
        done
    done
done
exit $wrong
