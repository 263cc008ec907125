"""What the estimator may be told; every default is the paper's or stated in the decisions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.slab import Slab

Method = Literal["unit-norm", "contours", "posterior"]
Model = Literal["paper", "full"]

PAPER_SCALE_SD = 0.20
"""Sky light, long wave of the ground and stored heat act on slopes like a scale error of this size."""


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """How slopes are worked out of minutes.

    `window_s` None means since the last change of weather: as far back as one slope explains
    the minutes. `measures` are components of radiation by stream, where the streams do not declare them
    (`fieldkit.model.radiation`); `light_stream` names the stream to take the light from, "" for the best.
    `noise_k` is the standard
    deviation of one region's minute mean that does not repeat. `scale` is the calibrated
    kappa (measured over true ``delta S / S``) and `scale_sd` its standard uncertainty
    (irradiance, albedo), `exchange_sd` the relative one of the exchange with the air;
    `offsets_k` are calibrated offsets of regions (measured minus true against the
    reference), `offset_sd_k` theirs and `drift_sd_k_per_h` how steady they are. `emissivity_sd` is the
    standard uncertainty of the surface's emissivity in the camera's band, `own_emissivity_sd` those of
    regions with one of their own, `factor_sd` the relative one of a calibrated light meter's factor. All this
    goes into the likelihood region, and with the paper's model so does `PAPER_SCALE_SD` for
    what that model leaves out. The fields after them belong to the full model: the slab
    under the surface and the relative uncertainty of its conductivity and heat capacity,
    the sky's model, what lies around the beds, and what stands in for instruments that are
    not there.
    """

    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    irradiance: IrradianceModel = field(default_factory=IrradianceModel)
    light_stream: str = ""
    measures: Mapping[str, str] = field(default_factory=dict)
    method: Method = "unit-norm"
    model: Model = "paper"
    window_s: float | None = None
    azimuth: Literal["free", "known"] = "free"
    tilt_limit_deg: float = 45.0
    refraction: bool = False
    reflected_temperature_k: float = 233.15
    noise_k: float = 0.05
    low_sun_deg: float = 8.0
    settle_s: float = 600.0
    min_minutes: int = 5
    contour_tolerance_w_m2: float | None = None
    contour_threshold: float = 0.5
    scale: float = 1.0
    scale_sd: float = 0.08
    exchange_sd: float = 0.15
    offsets_k: Mapping[str, float] = field(default_factory=dict)
    offset_sd_k: float = 0.25
    emissivity_sd: float = 0.0
    own_emissivity_sd: Mapping[str, float] = field(default_factory=dict)
    factor_sd: float = 0.0
    drift_sd_k_per_h: float = 0.10
    slab: Slab = field(default_factory=Slab)
    conductivity_sd: float = 0.20
    capacity_sd: float = 0.10
    sky: Literal["isotropic", "hay-davies"] = "hay-davies"
    ground_albedo: float = 0.20
    longwave_down_w_m2: float = 300.0
    diffuse_fraction: float = 0.15
