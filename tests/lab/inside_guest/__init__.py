"""What fieldkit's tests call inside the guest, by ``lab.guest.call("inside_guest.module:name")``."""
