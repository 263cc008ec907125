"""Settings of the estimator; every default is stated in the decision records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fieldkit.estimation.estimator_keys import LEVEL_SD_DEG, EstimatorKeys
from fieldkit.estimation.prior import Prior
from fieldkit.estimation.surface_kinds import KINDS, SAND, Kind, Unlike
from fieldkit.model.site import Site
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.horizon import Horizon
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.slab import Slab
from fieldkit.physics.trajectory import CameraPath

PAPER_SCALE_SD = 0.20
"""Scale error equivalent to sky light, longwave of the ground and stored heat, which that model neglects."""


@dataclass(frozen=True, slots=True)
class EstimatorSettings(EstimatorKeys):
    """Settings of estimates from minute bins: the configured keys, and values of other tables and files.

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
    limits
        Rows of the table of limits that differ (`fieldkit.model.limits.rows_of`).
    kind
        Kind of the surface.
    kinds
        Kind of surface of each region that has another one than the references, by its name; learned only.
    same
        Whether the beds are stated to be of one heap; the sizes of what is a bed's own are in `prior`.
    level_sds_deg
        Standard uncertainties of the references' slopes, by name; elsewhere `LEVEL_SD_DEG`. [degrees]
    probes
        Contact thermometers in each region, by its name: ``STREAM:CHANNEL``, the channel by name or number.
    horizon, horizons
        Pairs of azimuth and elevation: of the site, and by name of regions with one of their own. [degrees]
    reflected_temperature_k
        Effective temperature of the sky as reflected into the camera. [K]
    offsets_k
        Calibrated offsets of regions, measured minus true against the reference. [K]
    emissivity_sd, own_emissivity_sd
        Standard uncertainty of the surface's emissivity in the camera's band; of regions with one of their
        own.
    factor_sd
        Relative standard uncertainty of a calibrated light meter's factor.
    slab, conductivity_sd, capacity_sd
        The layer under the surface; relative standard uncertainties of its conductivity and heat capacity.
    prior
        Physical priors of the learned model.
    body
        The world of the site, by its name in `fieldkit.physics.bodies`.
    site
        Where the regions lie, for the usual air of the place where none is logged; None if it is not known.
    camera_path
        The camera's pose over time, by which regions on the ground are followed; None if it is not known.
    """

    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    irradiance: IrradianceModel = field(default_factory=IrradianceModel)
    light_stream: str = ""
    measures: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    kind: Kind = SAND
    kinds: Mapping[str, Kind] = field(default_factory=dict)
    same: bool = False
    level_sds_deg: Mapping[str, float] = field(default_factory=dict)
    probes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    horizon: Horizon = ()
    horizons: Mapping[str, Horizon] = field(default_factory=dict)
    reflected_temperature_k: float = 233.15
    offsets_k: Mapping[str, float] = field(default_factory=dict)
    emissivity_sd: float = 0.0
    own_emissivity_sd: Mapping[str, float] = field(default_factory=dict)
    factor_sd: float = 0.0
    slab: Slab = field(default_factory=Slab)
    conductivity_sd: float = 0.20
    capacity_sd: float = 0.10
    prior: Prior = field(default_factory=Prior)
    body: str = "earth"
    site: Site | None = None
    camera_path: CameraPath | None = None

    @property
    def fixed_window_s(self) -> float | None:
        """Length of the window of ``paper`` and ``full`` in s; None where it is as long as one slope fits."""
        return None if isinstance(self.window_s, str) else self.window_s

    @property
    def circumsolar_share(self) -> float:
        """Share of Hay and Davies' circumsolar light that the configured sky has."""
        return 1.0 if self.sky == "hay-davies" else 0.0

    def unlike(self, region: str) -> Unlike:
        """The surface of a region by its name against that of the references."""
        kind, prior = self.kinds.get(region), self.prior
        if kind is None:
            return Unlike(normal_horizontal_sd=prior.normal_horizontal_sd)
        return Unlike.of(KINDS[kind], prior.exchange_w_m2_k, self.slab, self.surface.albedo)

    def level_sd_deg(self, region: str) -> float:
        """Standard uncertainty of a reference's slope, by its name."""
        return self.level_sds_deg.get(region, LEVEL_SD_DEG)

    def horizon_of(self, region: str) -> Horizon:
        """The horizon of a region by its name: its own, else the site's."""
        return self.horizons.get(region, self.horizon)
