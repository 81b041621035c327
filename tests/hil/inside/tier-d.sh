# The unit that ships, under a systemd of its own in a process namespace: user, groups, devices, sandbox, watchdog.
. /lib.sh
serial_on || exit 1
vivid_on || exit 1
root=/tmp/root
mkdir -p $root
mount -t tmpfs root $root
tar -C $root -xf /work/systemd.tar || exit 1
mkdir -p $root/bin $root/sbin $root/tmp $root/run $root/proc $root/sys $root/dev $root/out $root/root $root/home $root/usr/bin \
  $root/var/lib/hydroline $root/var/tmp $root/etc/hydroline $root/etc/systemd/system
# systemd looks for its own libraries under /usr/lib.
ln -s ../lib $root/usr/lib
cp /bin/busybox $root/bin/busybox
for a in sh date cat; do ln -sf busybox $root/bin/$a; done
cp -a /lib/x86_64-linux-gnu/. $root/lib/x86_64-linux-gnu/
cp /lib64/ld-linux-x86-64.so.2 $root/lib64/
cp /bin/hydroline $root/usr/bin/hydroline
for t in sysinit basic shutdown umount final exit local-fs multi-user; do
  printf '[Unit]\nDescription=%s\n' $t >$root/etc/systemd/system/$t.target
done
cp /work/hydroline.service $root/etc/systemd/system/
mkdir -p $root/etc/systemd/system/hydroline.service.d
cp /work/hil.conf $root/etc/systemd/system/hydroline.service.d/
cp -r /work/rigs/. $root/etc/hydroline/
cp $root/etc/hydroline/d.toml $root/etc/hydroline/rig.toml
# The guest has no udevd, and systemd starts with the one unit: what the guide's commands do is done by hand.
# systemd-sysusers: the user and its groups.
cp /work/passwd /work/group $root/etc/
cp /work/environment $root/etc/hydroline/environment
echo 0123456789abcdef0123456789abcdef >$root/etc/machine-id
# udevadm control --reload; udevadm trigger: what udev does by the rules that ship.
chgrp 44 /dev/video0; chgrp 20 /dev/ttyUSB0; chmod 660 /dev/video0 /dev/ttyUSB0
chown 990:990 $root/var/lib/hydroline
mount --bind /out $root/out
mount --rbind /dev $root/dev
mount -t sysfs sys $root/sys
mount -t cgroup2 cgroup2 $root/sys/fs/cgroup || exit 1
mount --make-rshared /
# systemctl daemon-reload; systemctl start hydroline; journalctl: systemd reads the unit, starts it and logs to the console.
say "systemd"
unshare -m -p -f chroot $root /bin/busybox env -i container=hil PATH=/usr/bin:/bin SYSTEMD_LOG_TARGET=console \
  /lib/systemd/systemd --unit=hydroline.service --log-level=info --show-status=no </dev/null >/out/systemd.txt 2>&1 &
wait_for 20 pidof hydroline || { ps; exit 1; }
wait_for 30 sh -c "ls $root/var/lib/hydroline/*.mcap"
sleep 2
pid=$(pidof hydroline | cut -d' ' -f1)
cp /proc/$pid/status /out/status.txt
for t in /proc/$pid/task/*; do echo "$(cat $t/comm) $(cut -d' ' -f40,41 $t/stat)"; done >/out/threads.txt
wait_for 60 test -e /out/service.result || exit 1
cat /out/service.result
cut -d' ' -f3 /out/service.result >/out/d.rc
for f in $root/var/lib/hydroline/*.mcap; do dd if="$f" of="/out/d.mcap" bs=256k 2>/dev/null; done
ls -ln $root/var/lib/hydroline >/out/state.txt
exit 0
