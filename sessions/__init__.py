"""The session file: how it is laid out, written, read, finished after a crash, checked and exchanged."""
