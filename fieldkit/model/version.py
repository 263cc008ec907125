"""Version of this software; the build reads it here."""

__version__ = "0.3.0"
