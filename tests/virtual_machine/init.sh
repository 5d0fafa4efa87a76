#!/bin/busybox sh
# The guest's first program: it loads the modules, enters the host's root, which is read-only, and runs there what the
# kernel's command line names: the kernel hands words it does not know to init, as variables. What the program finds
# goes to /run/results, a folder of the host's.
b=/bin/busybox
$b mount -t devtmpfs dev /dev
$b mount -t proc proc /proc
$b mount -t sysfs sys /sys
for module in $($b cat /modules/order); do
    $b insmod "/modules/$module" || echo "guest: $module does not load"
done
$b mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,ro,cache=loose host /host || echo "guest: no root"
$b mount -t devtmpfs dev /host/dev
$b mount -t proc proc /host/proc
$b mount -t sysfs sys /host/sys
$b mount -t tmpfs -o mode=755 run /host/run
$b mkdir -p /host/dev/pts /host/dev/shm /host/run/results /host/run/tmp
$b chmod 1777 /host/run/tmp
$b mount -t devpts -o ptmxmode=666 pts /host/dev/pts
$b mount -t tmpfs shm /host/dev/shm
$b mount -t configfs configfs /host/sys/kernel/config || echo "guest: no configfs"
$b mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000 results /host/run/results || echo "guest: no results"
$b ifconfig lo 127.0.0.1 up
export HOME=/run TMPDIR=/run/tmp PATH=/usr/bin:/bin:/usr/sbin:/sbin LANG=C.UTF-8
export PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1 OPENBLAS_NUM_THREADS=1
$b chroot /host "$GUEST_PYTHON" "$GUEST_PROGRAM"
echo "guest: the program ended with $?"
$b sync
$b poweroff -f
