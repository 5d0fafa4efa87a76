#!/bin/busybox sh
# The guest's first program: it loads the modules, mounts the host's root, which is read-only, with a folder of the host's
# in /opt, and hands over to systemd. What is found goes to /run/results, a folder of the host's.
b=/bin/busybox
nine=trans=virtio,version=9p2000.L,msize=512000
$b mount -t devtmpfs dev /dev
$b mount -t proc proc /proc
$b mount -t sysfs sys /sys
for module in $($b cat /modules/order); do
    $b insmod "/modules/$module" || echo "guest: $module does not load"
done
$b mount -t 9p -o $nine,ro,cache=loose host /host || echo "guest: no root"
$b mount -t devtmpfs dev /host/dev
$b mount -t proc proc /host/proc
$b mount -t sysfs sys /host/sys
$b mount -t tmpfs -o mode=755 run /host/run
$b mkdir -p /host/dev/pts /host/dev/shm /host/run/results /host/run/tmp
$b chmod 1777 /host/run/tmp
$b mount -t devpts -o ptmxmode=666 pts /host/dev/pts
$b mount -t tmpfs shm /host/dev/shm
$b mount -t configfs configfs /host/sys/kernel/config || echo "guest: no configfs"
$b mount -t 9p -o $nine results /host/run/results || echo "guest: no results"
$b ifconfig lo 127.0.0.1 up
# A machine of its own: nothing of the host's configuration, state or users' folders is in it.
$b mount -t 9p -o $nine,ro,cache=loose opt /host/opt || echo "guest: no /opt"
for folder in etc home root var; do
    $b mount -t tmpfs -o mode=755 $folder /host/$folder
done
$b cp -a /host/opt/etc/. /host/etc
$b mkdir -p /host/var/lib /host/var/log /host/var/tmp
$b chmod 1777 /host/var/tmp
$b ln -s /run /host/var/run
$b mount -t tmpfs -o mode=1777 tmp /host/tmp
$b umount /dev /proc /sys
# Empty: this is no container, whatever the host is. Of the distribution's units those in /opt, and no generators.
export container= SYSTEMD_UNIT_PATH=/etc/systemd/system:/opt/units SYSTEMD_GENERATOR_PATH=/opt/generators
exec $b switch_root -c dev/console /host /lib/systemd/systemd
