"""Formats of other programs: readers of loggers, stations and cameras; writers of tables, netCDF and images.

A reader returns an `ImportedRecording`: `write_imported` (imported) makes a session of it, `merge` (merged)
adds to one; a writer exports an open session into a folder: tables_out (CSV, Parquet, netCDF), mcap_out,
images_out. xarray_backend lets xarray open a session as it is.
"""
