"""The guest: a Debian kernel, udev, Python and the installed fieldkit, booted in QEMU."""
