"""Names of the models of a light meter's reading: the configuration offers them, `irradiance` has them."""

from typing import Literal

ConfiguredKind = Literal["eq10", "efficacy", "perez", "calibrated", "pyrheliometer", "file"]
Kind = Literal[ConfiguredKind, "pyranometer"]
Mounting = Literal["horizontal", "sun-pointing", "in-plane"]
Diffuse = Literal["none", "fraction", "erbs"]
"""Models of the diffuse share; each is a row of `DIFFUSE_MODELS` in `physics.irradiance`."""
OF_DAYLIGHT = ("eq10", "perez", "erbs")
"""Those that are fitted to the light under the Earth's air."""
