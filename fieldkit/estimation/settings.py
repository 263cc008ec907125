"""Settings of the estimator; every default is stated in the decision records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from fieldkit.estimation.prior import Prior
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.horizon import Horizon
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.slab import Slab
from fieldkit.physics.trajectory import CameraPath

Method = Literal["unit-norm", "contours", "posterior"]
Model = Literal["paper", "full", "learned"]

PAPER_SCALE_SD = 0.20
"""Scale error equivalent to sky light, longwave of the ground and stored heat, which that model neglects."""


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """How slopes are estimated from minute bins.

    All uncertainties enter the likelihood region; with the paper's model so does `PAPER_SCALE_SD`. The fields
    from `slab` on are used by the full and the learned model only.

    Attributes
    ----------
    surface, irradiance
        Parameters of the surface's energy balance; how DNI is derived from the light meter.
    light_stream
        Stream to derive DNI from; "" for the best one.
    measures
        Components of radiation by stream, where the streams do not declare them (`fieldkit.model.radiation`).
    probes
        Contact thermometers in each region, by its name: ``STREAM:CHANNEL``, the channel by name or number.
    horizon, horizons
        Pairs of azimuth and elevation: of the site, and by name of regions with one of their own. [degrees]
    method, model
        How rows are solved, with the models ``paper`` and ``full``; what is assumed of surface, air and sky.
    window_s
        Length of the window of ``paper`` and ``full``; None for "since the last change of weather", that is
        as far back as one slope explains the bins. ``learned`` uses all bins. [s]
    azimuth
        Whether the azimuths of the regions are known or estimated.
    tilt_limit_deg
        Largest tilt considered. [degrees]
    refraction
        Whether the sun's position includes refraction.
    reflected_temperature_k
        Effective temperature of the sky as reflected into the camera. [K]
    noise_k
        Standard deviation of the random part of a region's minute mean. [K]
    low_sun_deg
        Elevation of the sun below which no slope is estimated. [degrees]
    settle_s
        Time after a cloud during which bins count as clouded. [s]
    min_minutes
        Fewest bins of an estimate.
    contour_tolerance_w_m2, contour_threshold
        Half width of a contour, None for two standard deviations [W/m2]; least score, as a share of all bins.
    scale, scale_sd
        Calibrated kappa, measured over true ``delta S / S``, and its standard uncertainty (irradiance,
        albedo).
    exchange_sd
        Relative standard uncertainty of the heat exchange with the air.
    offsets_k, offset_sd_k, drift_sd_k_per_h
        Calibrated offsets of regions, measured minus true against the reference; their standard uncertainty;
        that of their drift. [K], [K], [K/h]
    emissivity_sd, own_emissivity_sd
        Standard uncertainty of the surface's emissivity in the camera's band; of regions with one of their
        own.
    factor_sd
        Relative standard uncertainty of a calibrated light meter's factor.
    slab, conductivity_sd, capacity_sd
        The layer under the surface; relative standard uncertainties of its conductivity and heat capacity.
    sky, ground_albedo
        Model of diffuse light; albedo of the ground around.
    longwave_down_w_m2, diffuse_fraction
        Used where longwave or diffuse light is not measured; with the learned model and a logged air
        temperature longwave is that of a clear sky over this air. [W/m2], [-]
    prior
        Physical priors of the learned model.
    body
        The world of the site, by its name in `fieldkit.physics.bodies`.
    camera_path
        The camera's pose over time, by which regions on the ground are followed; None if it is not known.
    """

    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    irradiance: IrradianceModel = field(default_factory=IrradianceModel)
    light_stream: str = ""
    measures: Mapping[str, str] = field(default_factory=dict)
    probes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    horizon: Horizon = ()
    horizons: Mapping[str, Horizon] = field(default_factory=dict)
    method: Method = "unit-norm"
    model: Model = "learned"
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
    prior: Prior = field(default_factory=Prior)
    body: str = "earth"
    camera_path: CameraPath | None = None

    def horizon_of(self, region: str) -> Horizon:
        """The horizon of a region by its name: its own, else the site's."""
        return self.horizons.get(region, self.horizon)
