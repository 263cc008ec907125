#!/busybox sh
# First program of the guest: load the modules, put a writable layer over the root image, switch to it.
/busybox mkdir -p /proc /sys /dev /lower /writable /root
/busybox mount -t proc proc /proc
/busybox mount -t sysfs sysfs /sys
/busybox mount -t devtmpfs devtmpfs /dev
for module in $(/busybox cat /modules/order); do
    /busybox insmod "/modules/$module" || /busybox echo "insmod $module failed"
done
/busybox mount -t squashfs -o ro /dev/vda /lower
/busybox mount -t tmpfs tmpfs /writable
/busybox mkdir /writable/upper /writable/work
/busybox mount -t overlay -o lowerdir=/lower,upperdir=/writable/upper,workdir=/writable/work overlay /root
/busybox cp -a /layer/. /root/
for folder in proc sys dev; do /busybox mount --move "/$folder" "/root/$folder"; done
# switch_root, not chroot: udevadm does nothing in a chroot.
exec /busybox switch_root /root /usr/bin/busybox sh /lab/start.sh
