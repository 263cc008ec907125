"""Sessions: one recording, one HDF5 file, and the journal beside it while it is recorded.

A sample enters at `SessionWriter.append` (writer): a row of the journal first, then the session file
(session_file). `open_session` (reader) reads it back; recovery finishes what a crash interrupted; check
verifies all of it. formats reads and writes the recordings of other programs.
"""
