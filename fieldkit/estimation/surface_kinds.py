"""Kinds of surface: what is known beforehand of how each takes up light, stores heat and gives it to the air.

``[surface] kind`` chooses one; it gives the defaults of keys that the configuration does not set. Numbers are
of the kind, never of one site: what was measured belongs into the configuration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from fieldkit.physics.slab import Slab

Kind = Literal["sand", "soil", "rock", "plate", "wall", "snow", "vegetation", "forest"]
SAND: Kind = "sand"
STEEP_SD = 0.42
"""Horizontal component of a normal from which a kind, usually steeper than 25 degrees, may be vertical."""
_AIR_J_M3_K = 1210.0  # heat capacity of the default air


@dataclass(frozen=True, slots=True)
class SurfaceKind:
    """Medians and standard deviations of a kind; ``_log_sd`` of the logarithm, the fields as in ``[prior]``.

    `wind_w_m2_k_per_m_s` is the change of the heat exchange with the air by logged wind; `gain_sd` the
    relative standard deviation of absorbed light, its own and that of a light meter. Conductivity, heat
    capacity, inertia and depth are of the layer under the surface, `deep_share` is the probability that heat
    reaches no bottom. `normal_horizontal_sd` is of each horizontal component of a normal. `exchange_m_s`,
    `exchange_sd` and `scale_sd` are the same for the models paper and full; by default those above.
    `stated_gain_sd` is `gain_sd` where the albedo is stated; by default as it is.
    """

    exchange_w_m2_k: float
    exchange_log_sd: float
    wind_w_m2_k_per_m_s: float
    wind_sd_w_m2_k_per_m_s: float
    albedo: float
    gain_sd: float
    conductivity_w_m_k: float
    heat_capacity_j_m3_k: float
    inertia_log_sd: float
    depth_m: float
    depth_log_sd: float
    deep_share: float
    normal_horizontal_sd: float = 0.25
    exchange_m_s: float | None = None
    exchange_sd: float | None = None
    scale_sd: float | None = None
    stated_gain_sd: float | None = None

    @property
    def tilt_limit_deg(self) -> float:
        """Upper limit of the tilt."""
        return 90.0 if self.normal_horizontal_sd > STEEP_SD else 45.0

    def defaults(self, *, albedo_stated: bool = False) -> dict[str, dict[str, float]]:
        """The values as tables of ``fieldkit.toml``; an albedo of the surface itself narrows the gain."""
        gain_sd = self.stated_gain_sd if albedo_stated and self.stated_gain_sd else self.gain_sd
        priors = (
            "exchange_w_m2_k exchange_log_sd wind_w_m2_k_per_m_s wind_sd_w_m2_k_per_m_s gain_sd"
            " inertia_log_sd depth_log_sd deep_share normal_horizontal_sd"
        )
        slab = ("depth_m", "conductivity_w_m_k", "heat_capacity_j_m3_k")
        estimator = {
            "tilt_limit_deg": self.tilt_limit_deg,
            "exchange_sd": self.exchange_log_sd if self.exchange_sd is None else self.exchange_sd,
            "scale_sd": gain_sd if self.scale_sd is None else self.scale_sd,
        }
        return {
            "surface": {"albedo": self.albedo},
            "air": {"exchange_m_s": self.exchange_m_s or round(self.exchange_w_m2_k / _AIR_J_M3_K, 4)},
            "slab": {name: getattr(self, name) for name in slab},
            "estimator": estimator,
            "prior": {**{name: getattr(self, name) for name in priors.split()}, "gain_sd": gain_sd},
        }


@dataclass(frozen=True, slots=True)
class Unlike:
    """A region's surface against that of the references: ratios of medians, and what it may differ beyond.

    `exchange`, `inertia`, `depth` and `light` are ratios of heat exchange, thermal inertia, depth of the
    layer and absorptance; `exchange_sd`, `inertia_sd` and `gain_sd` relative standard deviations of its own,
    `normal_horizontal_sd` that of each horizontal component of its normal.
    """

    exchange: float = 1.0
    inertia: float = 1.0
    depth: float = 1.0
    light: float = 1.0
    exchange_sd: float = 0.0
    inertia_sd: float = 0.0
    gain_sd: float = 0.0
    normal_horizontal_sd: float = 0.25

    @classmethod
    def of(cls, kind: SurfaceKind, exchange_w_m2_k: float, slab: Slab, albedo: float) -> Unlike:
        """A kind against the configured surface of the references."""
        own = Slab(kind.depth_m, kind.conductivity_w_m_k, kind.heat_capacity_j_m3_k)
        return cls(
            exchange=kind.exchange_w_m2_k / exchange_w_m2_k,
            inertia=own.thermal_inertia / slab.thermal_inertia,
            depth=kind.depth_m / slab.depth_m,
            light=(1.0 - kind.albedo) / (1.0 - albedo),
            exchange_sd=kind.exchange_log_sd,
            inertia_sd=kind.inertia_log_sd,
            gain_sd=kind.gain_sd,
            normal_horizontal_sd=kind.normal_horizontal_sd,
        )


SAME: Mapping[str, float] = {
    "own_gain_sd": 0.02,
    "own_exchange": 0.015,
    "own_inertia_sd": 0.04,
    "own_slow_exchange": 0.02,
}
"""Keys of ``[prior]`` for beds of one heap, laid at one time.

Judged: because beds of one sand, raked alike, showed 0.005 to 0.01 of albedo and a few percent of the rest;
minutes that contradict it widen what is a bed's own all the same (`Noise.unlike`).
"""

# Oke (1987), Boundary Layer Climates, 2nd edition: tables 1.1 (albedo), 2.1 (soils, snow), 7.4 (building
# materials). Exchange in W m-2 K-1, U the wind in m/s, from 0 to 4 where a median is given.
KINDS: Mapping[Kind, SurfaceKind] = {
    # the defaults of every table: the paper's Table 1, and the sources in `Prior`
    "sand": SurfaceKind(
        15.0, 0.5, 1.8, 1.0, 0.20, 0.09, 0.25, 1.3e6, 0.25, 0.03, 0.5, 0.2,
        exchange_m_s=0.015, exchange_sd=0.15, scale_sd=0.08,
    ),
    # exchange of bare measured ground as for sand, 3 + 1.8 U and 4 + 1.7 U; albedo 0.05 (dark, wet) to 0.40
    # (light, dry); inertia from dry clay, 600, to wet sand, 2550 (Oke); no bottom
    "soil": SurfaceKind(15.0, 0.5, 1.8, 1.0, 0.20, 0.12, 0.75, 2.0e6, 0.45, 0.30, 0.5, 0.9),
    # exchange as of bare ground; albedo 0.10 (basalt) to 0.40 (limestone), building stone 0.20 to 0.35; stone
    # 2.19 W m-1 K-1, 2.25 MJ m-3 K-1 (Oke), from sandstone to granite a third around it
    "rock": SurfaceKind(15.0, 0.5, 1.8, 1.0, 0.25, 0.12, 2.2, 2.25e6, 0.30, 0.50, 0.5, 0.9),
    # exchange of both sides, 25 to 35 within one sd: Faiman (2008) finds 25 + 6.8 U for modules on a rack,
    # less 10 for emission of two sides; half of its wind, which is slower near the ground. Light that becomes
    # heat: 0.9 absorbed, less 0.1 to 0.2 of power; 11 kJ m-2 K-1 (Fuentes 1987, SAND85-0330); racks stand at
    # the latitude, up to vertical
    "plate": SurfaceKind(30.0, 0.2, 4.0, 2.0, 0.20, 0.15, 1.0, 2.2e6, 0.4, 0.005, 0.5, 0.01, 0.6),
    # exchange 4 + 4 U (ISO 6946); albedo of brick 0.20 to 0.40, concrete 0.10 to 0.35, white paint 0.50 to
    # 0.90: known to a factor, where it is stated within 0.05; inertia of brick 1065, of dense concrete 1785
    # (Oke); render on insulation is thin
    "wall": SurfaceKind(
        12.0, 0.4, 4.0, 1.5, 0.50, 0.50, 0.83, 1.5e6, 0.4, 0.10, 1.0, 0.2, 0.6, stated_gain_sd=0.15,
    ),
    # smooth: bulk coefficients of 1.5 to 2.5e-3 at 2 to 5 m/s give 4 to 15; albedo 0.40 (old) to 0.95
    # (fresh), so that absorbed light is known to a factor; inertia 130 (fresh) to 595 (old) (Oke)
    "snow": SurfaceKind(8.0, 0.5, 2.0, 1.0, 0.80, 0.5, 0.18, 0.42e6, 0.45, 0.30, 0.7, 0.8),
    # short grass after FAO-56 (Allen et al. 1998): 1200 / (208 / U) dry, and at 20 C 15 by transpiration;
    # albedo 0.16 (long) to 0.26 (short, Oke); by day a tenth of net radiation enters the ground (FAO-56)
    "vegetation": SurfaceKind(30.0, 0.5, 5.0, 2.5, 0.21, 0.12, 0.12, 0.75e6, 0.6, 0.10, 0.7, 0.5),
    # rough: 40 to 60 within one sd; measured on leafless ridges, by temperature over slope; albedo of
    # conifers 0.05 to 0.15, leafless deciduous 0.15, in leaf 0.20 (Oke); stems and twigs store little
    "forest": SurfaceKind(50.0, 0.2, 8.0, 4.0, 0.14, 0.12, 0.15, 1.0e6, 0.6, 0.10, 0.7, 0.5),
}  # fmt: skip
"""Every kind by its name."""
