"""The foil that shows what a surface mirrors: its own emissivity."""

FOIL_EMISSIVITY, FOIL_EMISSIVITY_SD = 0.04, 0.02
"""Aluminium foil at 10 micrometres and 27 °C in the emissivity tables of thermal camera manuals; dust and
folds add, and its own temperature is only known as the surface's it lies on."""
