#!/bin/bash
# boot.sh TREE WORK WHEEL - systemd as PID 1 of namespaces of its own (process, mount, cgroup, network, host name, IPC),
# on a throw-away layer over TREE, with the program installed from WHEEL and laid out as the README says. Killing this
# process kills everything in it. WORK is an empty folder; WORK/cgroup names the control group, to be removed afterwards.
set -euo pipefail
TREE=$1 WORK=$2 WHEEL=$3

# Version 2 of control groups, wherever the host has it.
groups=$(awk '$3 == "cgroup2" { print $2; exit }' /proc/mounts)
[ -n "$groups" ] || { echo "no cgroup2 is mounted here"; exit 3; }
group=$groups/reprobe-test.$$
mkdir "$group"
echo "$group" >"$WORK/cgroup"
echo $$ >"$group/cgroup.procs"

exec unshare --pid --fork --mount --cgroup --uts --ipc --net --kill-child=SIGKILL --propagation private bash -euo pipefail -c '
TREE=$1 WORK=$2 WHEEL=$3
mkdir "$WORK/layer" "$WORK/root"
mount -t tmpfs -o mode=755 layer "$WORK/layer"
mkdir "$WORK/layer/upper" "$WORK/layer/work"
ROOT=$WORK/root
mount -t overlay -o "lowerdir=$TREE,upperdir=$WORK/layer/upper,workdir=$WORK/layer/work" root "$ROOT"

mount -t proc proc "$ROOT/proc"
# Read-only: there is no udev here, and systemd then does not wait for devices.
mount -t sysfs -o ro sysfs "$ROOT/sys"
mount -t cgroup2 cgroup2 "$ROOT/sys/fs/cgroup"
mount -t tmpfs -o mode=755 run "$ROOT/run"
mount -t tmpfs tmp "$ROOT/tmp"
mount -t tmpfs -o mode=755 dev "$ROOT/dev"
for d in null zero full random urandom tty; do touch "$ROOT/dev/$d"; mount --bind "/dev/$d" "$ROOT/dev/$d"; done
mknod "$ROOT/dev/kmsg" c 1 11
mkdir "$ROOT/dev/pts" "$ROOT/dev/shm"
mount -t devpts -o newinstance,ptmxmode=0666,mode=620 devpts "$ROOT/dev/pts"
mount -t tmpfs shm "$ROOT/dev/shm"
ln -s pts/ptmx "$ROOT/dev/ptmx"
ln -s /proc/self/fd "$ROOT/dev/fd"

cp "$WHEEL" "$ROOT/tmp/"
env -i PATH=/usr/sbin:/usr/bin:/bin chroot "$ROOT" /opt/reprobe/bin/pip install -q --disable-pip-version-check --no-index --no-deps "/tmp/$(basename "$WHEEL")"
chroot "$ROOT" /opt/reprobe/bin/reprobe install --root / --bench
chroot "$ROOT" systemctl mask --quiet getty.target console-getty.service systemd-logind.service systemd-networkd.service \
    systemd-resolved.service systemd-timesyncd.service apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer \
    e2scrub_all.timer fstrim.timer

ip link set lo up
ip address add 192.0.2.1/32 dev lo
cd "$ROOT"
mkdir -p .old
pivot_root . .old
umount -l /.old
# Or the folders of credentials that systemd makes stay empty.
mount --make-rshared /
exec env -i container=other PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd --log-target=journal --show-status=0 \
    systemd.unified_cgroup_hierarchy=1
' boot "$TREE" "$WORK" "$WHEEL"
