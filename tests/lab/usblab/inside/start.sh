# Second program of the guest, still process 1: start udev, then the command loop, then power off.
/usr/bin/busybox --install -s /usr/bin
export PATH=/opt/venv/bin:/usr/bin:/usr/sbin
mkdir -p /dev/pts /dev/shm /home/observer /home/stranger
mount -t devpts devpts /dev/pts
mount -t tmpfs tmpfs /dev/shm
mount -t tmpfs tmpfs /run
chmod 1777 /tmp /dev/shm
chown 1000:1000 /home/observer
chown 1001:1001 /home/stranger
ldconfig
/usr/lib/udev/systemd-udevd --daemon
# The default action is "change", which would leave nodes root:root 0600.
udevadm trigger --action=add
udevadm settle --timeout=30
# Not exec: the kernel panics when process 1 ends before the power is off.
python /lab/usblab/inside/agent.py
poweroff -f
