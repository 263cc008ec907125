"""Formats of other programs: readers of loggers, stations and cameras; writers of tables, netCDF and images.

A reader returns an `ImportedRecording`: `write_imported` (imported) makes a session of it, `merge` (merged)
adds to one; a writer exports an open session into a folder, and `EXPORTS` (exports) names all of them.
"""
