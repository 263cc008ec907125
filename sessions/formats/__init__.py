"""Formats of other programs: readers of loggers, stations, cameras; writers of tables, netCDF, MCAP, images.

A reader returns an `ImportedRecording`, which `write_imported` (imported) makes a session of and `merge` (merged)
adds to one; a writer exports an open session into a folder.
"""
