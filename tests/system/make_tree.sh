#!/bin/bash
# make_tree.sh CACHE PYTHON REQUIREMENTS - a Debian 12 tree with systemd and, in /opt/reprobe, all that reprobe needs but
# reprobe itself. Kept in CACHE by what went into it; prints where it is. A minute or two once, then nothing.
# With -n first: only tell whether it is there.
set -euo pipefail
LOOK=; [ "$1" = -n ] && { LOOK=1; shift; }
CACHE=$1 PYTHON=$2 REQUIREMENTS=$3
HERE=$(cd "$(dirname "$0")" && pwd)
PACKAGES=systemd,systemd-sysv,python3,python3-venv,iproute2

kind=$(cat "$HERE/make_tree.sh" <(echo "$PACKAGES") | sha256sum | cut -c1-12)
tree=$CACHE/tree-$kind-$(sha256sum <"$REQUIREMENTS" | cut -c1-12)
[ -e "$tree/.whole" ] && { echo "$tree"; exit; }
[ -z "$LOOK" ] || exit 1
mkdir -p "$CACHE"
# One builder at a time; the tree is only its name's once it is whole.
exec 9>"$CACHE/lock"
flock 9
[ -e "$tree/.whole" ] && { echo "$tree"; exit; }
rm -rf "$CACHE"/tree-*
work=$(mktemp -d "$CACHE/new-XXXXXX")
trap 'rm -rf "$work"' EXIT

base=$CACHE/base-$kind.tar
if ! [ -e "$base" ]; then
    rm -f "$CACHE"/base-*.tar
    # The host's own package sources, whatever they are called.
    sources=$(ls /etc/apt/sources.list.d/debian.sources /etc/apt/sources.list 2>/dev/null | head -n 1 || true)
    mmdebstrap --quiet --variant=minbase --mode=root --include=$PACKAGES --aptopt='Acquire::Languages "none"' \
        --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
        --dpkgopt='path-exclude=/usr/share/locale/*' bookworm "$work/base.tar" "$sources" >&2
    mv "$work/base.tar" "$base"
fi
mkdir "$work/tree"
tar -C "$work/tree" -xf "$base"

# The host's pip knows where packages come from; the tree's pip then installs them without any network.
"$PYTHON" -m pip download -q --disable-pip-version-check --only-binary :all: --require-hashes \
    -r "$REQUIREMENTS" -d "$work/tree/tmp/wheels" >&2
cp "$REQUIREMENTS" "$work/tree/tmp/requirements.txt"
chroot "$work/tree" /usr/bin/python3 -m venv /opt/reprobe
env -i PATH=/usr/sbin:/usr/bin:/bin chroot "$work/tree" /opt/reprobe/bin/pip install -q --disable-pip-version-check --no-index --find-links /tmp/wheels \
    --require-hashes -r /tmp/requirements.txt >&2
rm -rf "$work/tree/tmp/wheels"
touch "$work/tree/.whole"
mv "$work/tree" "$tree"
echo "$tree"
