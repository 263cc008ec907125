"""Code that runs inside the guest: the command loop and the small programs it calls."""
