"""Cameras: one module per family."""
