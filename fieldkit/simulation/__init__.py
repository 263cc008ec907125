"""The simulated field: sky, beds and truth as a pure function of time and seed.

`Scene` is the whole; a sample leaves it as brightness temperatures (`Scene.frame`), lux or probe readings,
which `fieldkit.drivers.simulated` packs into bytes. Truth does not share the estimator's simplifications:
skylight, longwave, wind and stored heat count, and light meter and camera have errors of their own.
"""

from fieldkit.simulation.camera_frame import Correction
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.faults import Fault, LightStep
from fieldkit.simulation.scene import Scene, sand_slopes
from fieldkit.simulation.scene_series import Exchange, SceneState
from fieldkit.simulation.sky import ClearSky, MeasuredSky, Sky

__all__ = [
    "ClearSky",
    "Correction",
    "Exchange",
    "Facet",
    "Fault",
    "LightStep",
    "MeasuredSky",
    "Scene",
    "SceneState",
    "Sky",
    "sand_slopes",
]
