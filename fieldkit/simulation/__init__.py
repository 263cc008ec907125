"""The simulated field: sky, beds and truth as a pure function of time and seed.

`Scene` is the whole; a sample leaves it as brightness temperatures (`Scene.frame`), lux or probe readings,
which `fieldkit.drivers.simulated` packs into bytes. Truth does not share the estimator's simplifications:
skylight, longwave, wind and stored heat count, and light meter and camera have errors of their own.
"""

from fieldkit.simulation.camera_frame import Correction as Correction
from fieldkit.simulation.facets import Facet as Facet
from fieldkit.simulation.faults import Fault as Fault
from fieldkit.simulation.faults import LightStep as LightStep
from fieldkit.simulation.scene import Scene as Scene
from fieldkit.simulation.scene import sand_slopes as sand_slopes
from fieldkit.simulation.scene_series import Exchange as Exchange
from fieldkit.simulation.sky import ClearSky as ClearSky
from fieldkit.simulation.sky import MeasuredSky as MeasuredSky
from fieldkit.simulation.sky import Sky as Sky
