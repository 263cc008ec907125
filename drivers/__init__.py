"""One file per family of instruments; see README.md for how to add one."""
