"""Physical priors of the learned model: what is known of surface, air and sky before any data.

A name with ``_log_sd`` is the standard deviation of the natural logarithm. Offsets, drift and noise are
`EstimatorSettings`' own, inertia and depth are centred on its `slab`. The fields are the keys of ``[prior]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

from fieldkit.estimation.estimator_keys import STRICT, key

SHARE, LOG, KELVIN, FLUX = ({"ge": 1e-4, "le": most} for most in (1.0, 3.0, 100.0, 1000.0))
"""Limits of relative deviations, of those of logarithms, of temperatures, of fluxes and their exchange."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Assumptions of the learned model before any data: medians and standard deviations (sd).

    Attributes
    ----------
    gain_sd
        Relative sd of absorbed over stated direct light. A light meter of class B (limits of 10 %, 6 % as a
        standard deviation; DIN 5032-7) and an albedo of 0.20 +- 0.05. [-]
    diffuse_sd, diffuse_unmeasured_sd
        Relative sd of diffuse light: measured beside the beds (calibration and horizon), or taken as a fixed
        share of the global (between clear and hazy sky the share changes by half). [-]
    circumsolar_share, circumsolar_sd
        Share of Hay and Davies' circumsolar part in the diffuse light: 0 isotropic, 1 as they give it. [-]
    brightening_share, brightening_sd
        Share of what Perez' sky has around sun and horizon beyond Hay and Davies': 0 none, 1 all. [-]
    own_gain_sd, own_exchange, own_inertia_sd
        Relative sd of one bed against the others for the whole session: absorbed light, heat exchange,
        thermal inertia; scaled by how unlike the minutes show the beds to be. [-]
    wind_w_m2_k_per_m_s, wind_sd_w_m2_k_per_m_s
        Heat exchange by the logged wind. [W m-2 K-1 per m/s]
    longwave_sd_w_m2
        Longwave, also where it is logged: formulas from air temperature and humidity scatter by 20 to
        30 W/m2 under all skies (Flerchinger et al. 2009, doi:10.1029/2008WR007394); with a pyrgeometer state
        10. [W/m2]
    air_sd_k, air_unlogged_sd_k
        Air temperature at the beds: logged by a shaded thermometer nearby, or unknown, within the
        daily range. [K]
    exchange_w_m2_k, exchange_log_sd
        Heat exchange with the air; 90 % within 7 to 34. One-dimensional conduction fitted to radiometers over
        cinder and clay finds 3 + 1.8 U and 4 + 1.7 U (U wind in m/s); the paper has 18. [W m-2 K-1], [-]
    inertia_log_sd
        Thermal inertia around the slab's: dry loose sand lies between 450 and 700 J m-2 K-1 s-1/2, damp or
        packed sand outside. [-]
    depth_log_sd, deep_share
        Depth around the slab's; probability that the layer has no bottom that heat reaches. [-]
    gust_sd_w_m2_k, gust_log_sd
        Amplitude of the exchange's gusts, Ornstein-Uhlenbeck processes of 2 to 20 min, and of its logarithm.
        [W m-2 K-1], [-]
    slow_gust_sd
        Relative sd of the wind's slow changes over 60 min. [-]
    common_flux_sd_w_m2
        Fluxes that the model has no term for, shared by all regions over 40 min. [W/m2]
    own_slow_exchange
        Relative sd of a bed's own exchange against that of the others, over 60 min. [-]
    unrest_log_sd
        Logarithm of a factor on the three before, which the data adapt. [-]
    past_flux_sd_w_m2, bed_past_flux_sd_w_m2
        Net fluxes before the first minute: shared by all regions, of one bed. [W/m2]
    normal_horizontal_sd
        Each horizontal component of a bed's normal: tilts of up to 25 degrees are ordinary. [-]
    beam_change_share
        Error of the direct light of a minute in which it changes, as a share of the change. [-]
    camera_noise_k
        Noise of a minute's mean that all regions share. [K]
    camera_offset_sd_k
        Error of the camera that all regions share. [K]
    probe_sd_k
        Error of a contact probe as the temperature of the bed's surface. [K]

    Raises
    ------
    ValueError
        For a value outside the limits of its key.
    """

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STRICT

    gain_sd: float = key(
        0.09, "relative, of absorbed direct light: class B meter (DIN 5032-7), albedo within 0.05", **SHARE
    )
    diffuse_sd: float = key(0.12, "relative, of measured diffuse light", **SHARE)
    diffuse_unmeasured_sd: float = key(
        0.4, "relative, of diffuse light as a fixed share: clear to hazy sky", **SHARE
    )
    circumsolar_share: float = key(
        0.5, "circumsolar diffuse light: 0 isotropic, 1 Hay and Davies", ge=0, le=1
    )
    circumsolar_sd: float = key(0.4, "of circumsolar_share", **SHARE)
    brightening_share: float = key(
        0.3, "diffuse light around sun and horizon: 0 Hay and Davies, 1 Perez", ge=0, le=1
    )
    brightening_sd: float = key(0.4, "of brightening_share", **SHARE)
    own_gain_sd: float = key(0.035, "relative, of one bed's absorbed light against the others'", **SHARE)
    own_exchange: float = key(
        0.04, "relative, lasting heat exchange of one bed; more where beds are seen to differ", **SHARE
    )
    own_inertia_sd: float = key(0.14, "relative, of one bed's thermal inertia against the others'", **SHARE)
    wind_w_m2_k_per_m_s: float = key(1.8, "heat exchange by the logged wind: measured ground", **FLUX)
    wind_sd_w_m2_k_per_m_s: float = key(1.0, "of wind_w_m2_k_per_m_s", **FLUX)
    longwave_sd_w_m2: float = key(
        30.0, "of longwave, by formulas 20 to 30 (Flerchinger et al. 2009); 10 with a pyrgeometer", **FLUX
    )
    air_sd_k: float = key(0.7, "of a logged air temperature, at the beds", **KELVIN)
    air_unlogged_sd_k: float = key(8.0, "of an air temperature that is not logged: the daily range", **KELVIN)
    exchange_w_m2_k: float = key(
        15.0, "heat exchange with the air, median; measured ground: 3 + 1.8 times the wind in m/s", **FLUX
    )
    exchange_log_sd: float = key(0.5, "of its logarithm: 90 % within 7 to 34", **LOG)
    inertia_log_sd: float = key(
        0.25, "of the logarithm of thermal inertia, around the slab's: 450 to 700 for dry sand", **LOG
    )
    depth_log_sd: float = key(0.5, "of the logarithm of depth, around the slab's", **LOG)
    deep_share: float = key(0.2, "probability that heat reaches no bottom of the layer", ge=0, le=1)
    gust_sd_w_m2_k: float = key(
        1.0, "gusts of the heat exchange, over 2 to 20 min; adapted to the data", **FLUX
    )
    gust_log_sd: float = key(1.0, "of the logarithm of gust_sd_w_m2_k", **LOG)
    slow_gust_sd: float = key(0.06, "relative, slow changes of the heat exchange over 60 min", **SHARE)
    common_flux_sd_w_m2: float = key(3.0, "unmodelled flux into all regions, over 40 min", **FLUX)
    own_slow_exchange: float = key(
        0.06, "relative, heat exchange of one bed against the others, over 60 min", **SHARE
    )
    unrest_log_sd: float = key(
        0.8, "of the logarithm of a factor on the three before, adapted to the data", **LOG
    )
    past_flux_sd_w_m2: float = key(40.0, "net flux before the first minute, all regions", **FLUX)
    bed_past_flux_sd_w_m2: float = key(8.0, "net flux before the first minute, one bed", **FLUX)
    normal_horizontal_sd: float = key(
        0.25, "each horizontal component of a bed's normal; 0.42 is a tilt of 25 degrees", **SHARE
    )
    beam_change_share: float = key(
        0.1, "error of direct light while it changes, as a share of the change", **SHARE
    )
    camera_noise_k: float = key(
        0.1, "noise of the camera that all regions share, of a minute's mean", **KELVIN
    )
    camera_offset_sd_k: float = key(1.0, "error of the camera that all regions share", **KELVIN)
    probe_sd_k: float = key(0.5, "of a contact probe as the temperature of the bed's surface", **KELVIN)

    def __post_init__(self) -> None:
        for field in fields(self):
            value, least, most = getattr(self, field.name), field.metadata["ge"], field.metadata["le"]
            if not least <= value <= most:
                raise ValueError(f"prior {field.name} must lie in [{least:g}, {most:g}], not {value}")
