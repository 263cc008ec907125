"""What fieldkit adds to the virtual USB lab: its simulated field, instruments, recordings in the guest.

`usblab` is the lab itself and contains nothing of fieldkit; ``inside_guest`` is called in the guest.
A sample enters in `field`, which every emulated instrument reads.
"""
