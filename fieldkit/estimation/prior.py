"""Physical priors of the learned model: what is known of surface, air and sky before any data."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Prior:
    """Medians and standard deviations of what the learned model estimates besides the slopes.

    A name with ``_log_sd`` is the standard deviation of the natural logarithm. Offsets, drift and noise are
    `EstimatorSettings`' own, inertia and depth are centred on its `slab`.

    Attributes
    ----------
    gain_sd
        Relative, of absorbed over stated direct light. A light meter of class B (limits of 10 %, 6 % as a
        standard deviation; DIN 5032-7) and an albedo of 0.20 +- 0.05. [-]
    diffuse_sd, diffuse_unmeasured_sd
        Relative, of diffuse light: measured beside the beds (calibration and horizon), or taken as a fixed
        share of the global (between clear and hazy sky the share changes by half). [-]
    circumsolar_share, circumsolar_sd
        Share of Hay and Davies' circumsolar part in the diffuse light: 0 isotropic, 1 as they give it. [-]
    longwave_sd_w_m2
        Of longwave that is stated, not measured: formulas from air temperature and humidity scatter by 20 to
        30 W/m2 under all skies (Flerchinger et al. 2009, doi:10.1029/2008WR007394). [W/m2]
    air_sd_k, air_unlogged_sd_k
        Of the air temperature at the beds: logged by a shaded thermometer nearby, or unknown, within the
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
        Relative, of the wind's slow changes over 60 min. [-]
    common_flux_sd_w_m2, bed_flux_sd_w_m2
        Of fluxes the model has no term for: shared by all regions over 40 min, of one bed over 60 min. [W/m2]
    unrest_log_sd
        Of the logarithm of a factor on the three before, which the data adapt. [-]
    past_flux_sd_w_m2, bed_past_flux_sd_w_m2
        Of the net fluxes before the first minute: shared by all regions, of one bed. [W/m2]
    normal_horizontal_sd
        Of each horizontal component of a bed's normal: tilts of up to 25 degrees are ordinary. [-]
    beam_change_share
        Of the direct light of a minute in which it changes, as a share of the change. [-]
    camera_offset_sd_k
        Of the camera's error that all regions share. [K]
    probe_sd_k
        Of a contact probe as the temperature of the bed's surface. [K]

    Raises
    ------
    ValueError
        For a value that is not finite, a standard deviation or an exchange that is not positive, and a share
        outside [0, 1].
    """

    gain_sd: float = 0.09
    diffuse_sd: float = 0.12
    diffuse_unmeasured_sd: float = 0.4
    circumsolar_share: float = 0.5
    circumsolar_sd: float = 0.4
    longwave_sd_w_m2: float = 30.0
    air_sd_k: float = 0.7
    air_unlogged_sd_k: float = 8.0
    exchange_w_m2_k: float = 15.0
    exchange_log_sd: float = 0.5
    inertia_log_sd: float = 0.25
    depth_log_sd: float = 0.5
    deep_share: float = 0.2
    gust_sd_w_m2_k: float = 1.0
    gust_log_sd: float = 1.0
    slow_gust_sd: float = 0.06
    common_flux_sd_w_m2: float = 3.0
    bed_flux_sd_w_m2: float = 1.5
    unrest_log_sd: float = 0.8
    past_flux_sd_w_m2: float = 40.0
    bed_past_flux_sd_w_m2: float = 20.0
    normal_horizontal_sd: float = 0.25
    beam_change_share: float = 0.1
    camera_offset_sd_k: float = 1.0
    probe_sd_k: float = 0.5

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if name in ("circumsolar_share", "deep_share"):
                if not 0.0 <= value <= 1.0:
                    raise ValueError(f"prior {name} must lie in [0, 1], not {value}")
            elif not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"prior {name} must be finite and above 0, not {value}")
