"""The nouns every room uses: samples, devices, sites, regions, slopes, clocks and errors.

Nothing here opens a file or computes physics. A sample enters the program as a `Frame`, `Reading` or `Event`
(`fieldkit.model.samples`) of a stream that its device declared (`StreamInfo`, `fieldkit.model.device`).
"""
