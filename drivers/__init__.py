"""Instruments: finding, opening, decoding and reading them; one file per family.

A sample enters as bytes on a cable and leaves as a `Frame` or `Reading` (`cameras`, `meters`). `registry` is
the table of drivers, `discovery` lists what is connected, `instrument.open_device` opens one by hand. See
README.md for the files and docs/how-to/add-a-driver.md for adding one.
"""
