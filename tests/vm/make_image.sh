#!/bin/bash
# make_image.sh CACHE PYTHON REQUIREMENTS - a disk for qemu: the tree of tests/system with Debian's own kernel, udev and
# v4l2loopback. Everything is done in a chroot at full speed. Kept in CACHE by what went into it; prints its folder, in
# which are disk.img, vmlinuz and initrd. A few minutes once, then nothing. With -n first: only tell whether it is there.
set -euo pipefail
LOOK=; [ "$1" = -n ] && { LOOK=1; shift; }
CACHE=$1
HERE=$(cd "$(dirname "$0")" && pwd)
MAKE_TREE=$HERE/../system/make_tree.sh
# The agent is how the host runs commands in there; v4l-utils presses vivid's buttons.
PACKAGES="linux-image-amd64 initramfs-tools udev kmod dbus qemu-guest-agent v4l-utils"
TOOLCHAIN="linux-headers-amd64 v4l2loopback-dkms"

kind=$(cat "$HERE/make_image.sh" "$MAKE_TREE" "$3" | sha256sum | cut -c1-16)
image=$CACHE/vm-$kind
[ -e "$image/disk.img" ] && { echo "$image"; exit; }
[ -z "$LOOK" ] || exit 1
tree=$("$MAKE_TREE" "$@")
# One builder at a time; the folder is only its name's once it is whole.
exec 9>"$CACHE/vm-lock"
flock 9
[ -e "$image/disk.img" ] && { echo "$image"; exit; }
discard() { umount "$1"/{build,root}/{proc,dev} 2>/dev/null || true; rm -rf --one-file-system "$1"; }
for old in "$CACHE"/vm-????????????????; do [ ! -d "$old" ] || discard "$old"; done
for left in "$CACHE"/vm-new-*; do [ ! -d "$left" ] || discard "$left"; done
work=$(mktemp -d "$CACHE/vm-new-XXXXXX")
root=$work/root log=$work/log
trap 'status=$?; [ $status = 0 ] || tail -n 40 "$log" >&2; discard "$work"' EXIT
say() { echo "$SECONDS s: $*" >&2; }

within() { # FOLDER COMMAND... - run a command in a chroot, with what packages' scripts need
    local folder=$1 status=0; shift
    mount -t proc proc "$folder/proc"
    mount --bind /dev "$folder/dev"
    chroot "$folder" /usr/bin/env DEBIAN_FRONTEND=noninteractive "$@" >>"$log" 2>&1 || status=$?
    umount "$folder/dev" "$folder/proc"
    return $status
}

cp -a --reflink=auto "$tree" "$root"
rm -f "$root/.whole"
cp -L /etc/resolv.conf "$root/etc/resolv.conf"
# A small initrd: only what leads to the disk.
mkdir -p "$root/etc/initramfs-tools/conf.d"
echo MODULES=list >"$root/etc/initramfs-tools/conf.d/small"
printf '%s\n' virtio_pci virtio_blk ext4 >"$root/etc/initramfs-tools/modules"
say "tree copied"
within "$root" apt-get -qq update
within "$root" apt-get -qq -y -o Dpkg::Use-Pty=0 --no-install-recommends install $PACKAGES
say "kernel and agent installed"

# The module is built in a copy, so that the compiler stays out of the disk.
cp -a --reflink=auto "$root" "$work/build"
within "$work/build" apt-get -qq -y -o Dpkg::Use-Pty=0 --no-install-recommends install $TOOLCHAIN
kernel=$(basename "$(ls -d "$root"/lib/modules/*)")
module=$(find "$work/build/lib/modules/$kernel/updates" -name 'v4l2loopback.ko*')
install -D -m644 -t "$root/lib/modules/$kernel/updates" "$module"
within "$root" depmod "$kernel"
say "v4l2loopback built for $kernel"

cp -L "$root/boot/vmlinuz-$kernel" "$work/vmlinuz"
cp -L "$root/boot/initrd.img-$kernel" "$work/initrd"
rm -rf "$root"/boot/* "$root"/var/lib/apt/lists/* "$root"/var/cache/apt/*
echo "/dev/vda / ext4 rw,noatime 0 0" >"$root/etc/fstab"
echo station >"$root/etc/hostname"
# Beside what the tests are about, nothing runs: emulated seconds are dear.
within "$root" systemctl mask --quiet getty.target serial-getty@ttyS0.service systemd-logind.service \
    systemd-networkd.service systemd-resolved.service systemd-timesyncd.service apt-daily.timer \
    apt-daily-upgrade.timer dpkg-db-backup.timer e2scrub_all.timer e2scrub_reap.service fstrim.timer
mke2fs -q -t ext4 -O ^has_journal -d "$root" "$work/disk.part" 4G
rm -rf --one-file-system "$root" "$work/build"
mv "$work/disk.part" "$work/disk.img"
say "disk made"
rm -f "$log"
chmod 755 "$work"
mv "$work" "$image"
trap - EXIT
echo "$image"
