"""The simulated field: sky, beds and truth, as a pure function of time and seed.

``scene`` is the whole; ``sky`` what comes from above, ``facets`` the beds, ``heat`` how warm
they get, ``series`` all of it computed once on fine times, ``camera_picture`` what a thermal
camera adds of its own, ``faults`` trouble, ``sand_slopes`` the scene of the demo.

Truth does not share the estimator's simplifications: light of sky and ground, long wave,
wind and stored heat count, and light meter and camera have errors of their own. Instruments
and their bytes are not here (`fieldkit.drivers.simulated`).
"""

from fieldkit.simulation.camera_frame import Correction
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.faults import Fault, FaultKind, LightStep
from fieldkit.simulation.scene import Scene, sand_slopes
from fieldkit.simulation.scene_series import Exchange, SceneState
from fieldkit.simulation.sky import ClearSky, MeasuredSky, Sky

__all__ = [
    "ClearSky",
    "Correction",
    "Exchange",
    "Facet",
    "Fault",
    "FaultKind",
    "LightStep",
    "MeasuredSky",
    "Scene",
    "SceneState",
    "Sky",
    "sand_slopes",
]
