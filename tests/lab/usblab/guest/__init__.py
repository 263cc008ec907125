"""The guest: a Debian kernel, udev, Python and the program under test, booted in QEMU."""
