"""From a light meter's reading to direct normal irradiance (DNI), by a named model.

The paper's eq. (10) turns lux into the irradiance of 400-700 nm light on the meter's plane. Three things
stand between that and S of eq. (2), each explicit in `IrradianceModel`: the share of the band in sunlight
(`par_fraction`), the diffuse share of the reading, and the angle of the sun on the meter's plane. Global
irradiance lacks only the first of them. NaN where the reading does not determine the beam.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.model.light_meter import Diffuse, Kind, Mounting
from fieldkit.physics import daylight
from fieldkit.physics.facet import VERTICAL, normal


class DiffuseModel(NamedTuple):
    """A model of the diffuse share of global light: its words, and where it follows from the sky, how.

    `relative_sd` is the standard uncertainty of the light that it removes, `by_clearness` and `by_beam` give
    the share from the clearness index of the global and of the direct light.
    """

    words: str
    relative_sd: float
    by_clearness: Callable[[ArrayLike], FloatArray] | None = None
    by_beam: Callable[[ArrayLike], FloatArray] | None = None


DIFFUSE_MODELS: Mapping[Diffuse, DiffuseModel] = {
    "none": DiffuseModel("no diffuse", 0.03),
    "fraction": DiffuseModel("diffuse {:.0%}", 0.05),
    "erbs": DiffuseModel(
        "Erbs diffuse", 0.04, daylight.diffuse_fraction_erbs, daylight.diffuse_fraction_of_beam
    ),
}
"""Another model of the sky is one more row, with its formulas in `daylight`, and its name in `Diffuse`."""

# of the paper's eq. (10): photons of 400-700 nm for each joule of sunlight, and lux for each of them
MICROMOL_PER_JOULE = 4.57
LUX_PER_MICROMOL = 54.0
LOWEST_COSINE = 0.2
"""Below this cosine on the meter's plane its cosine error and the sky's share rule the reading."""


@dataclass(frozen=True, slots=True)
class IrradianceModel:
    """Conversion of a light meter's reading to direct normal irradiance.

    `kind`: ``eq10`` lux by the paper's eq. (10) over `par_fraction` (1.0 is eq. (10) as
    printed); ``efficacy`` lux over `efficacy_lm_w`; ``perez`` lux over the Perez
    efficacy of the current sky; ``calibrated`` reading times `factor`;
    ``pyranometer`` global irradiance on the plane in W/m2; ``pyrheliometer`` and ``file`` the direct
    normal irradiance itself.
    `mounting` is the plane the meter lies in; `plane_tilt_deg` and `plane_azimuth_deg`
    count for ``in-plane``. `diffuse`: ``none`` for a baffled tube, ``fraction`` of the
    global horizontal light (`diffuse_fraction`), or the ``erbs`` decomposition. What a tilted meter without a
    tube receives from the ground follows from `ground_albedo`.
    """

    kind: Kind = "eq10"
    par_fraction: float = 0.44
    efficacy_lm_w: float = 105.0
    factor: float = float("nan")
    mounting: Mounting = "horizontal"
    plane_tilt_deg: float = 0.0
    plane_azimuth_deg: float = 0.0
    diffuse: Diffuse = "fraction"
    diffuse_fraction: float = 0.15
    ground_albedo: float = 0.20

    @property
    def is_direct(self) -> bool:
        """True if the reading already is direct normal irradiance."""
        return self.kind in ("pyrheliometer", "file")

    @property
    def label(self) -> str:
        """The model in at most 64 characters, as stored and shown beside every value."""
        if self.is_direct:
            return f"{self.kind}, direct normal as measured"
        scale = {
            "eq10": f"eq10 /{self.par_fraction:g}",
            "efficacy": f"efficacy {self.efficacy_lm_w:g} lm/W",
            "perez": "Perez efficacy",
            "calibrated": f"calibrated x{self.factor:.6g}",
            "pyranometer": "pyranometer",
        }[self.kind]
        sky = DIFFUSE_MODELS[self.diffuse].words.format(self.diffuse_fraction)
        tilted = f"plane {self.plane_tilt_deg:g}/{self.plane_azimuth_deg:g}"
        return f"{scale}, {sky}, {tilted if self.mounting == 'in-plane' else self.mounting}"


def eq10(illuminance_lx: ArrayLike, par_fraction: float = 0.44) -> FloatArray:
    """Eq. (10): irradiance on the meter's plane from illuminance, ``l / (4.57 x 54)`` over the band's share.

    Parameters
    ----------
    illuminance_lx
        Reading of a light meter in daylight, any shape. [lx]
    par_fraction
        Share of 400-700 nm in the irradiance of sunlight, in (0, 1]: 0.44 makes the result broadband
        (ASTM G173 spectra), 1.0 is the formula as printed. [-]

    Returns
    -------
    Same shape. [W/m2]

    References
    ----------
    .. [1] R. W. Thimijan and R. D. Heins, "Photometric, radiometric, and quantum light units of measure",
       HortScience 18, 818-822, 1983: 4.57 umol/J and 54 lx per umol/(m2 s) of daylight in 400-700 nm.
    """
    band = np.asarray(illuminance_lx, np.float64) / (MICROMOL_PER_JOULE * LUX_PER_MICROMOL)
    return np.asarray(band / par_fraction)


def direct_normal(
    model: IrradianceModel,
    value: ArrayLike,
    sun: ArrayLike,
    time_ns: ArrayLike,
    dhi_w_m2: ArrayLike = float("nan"),
) -> FloatArray:
    """Direct normal irradiance S of eq. (2) from readings of a light meter or radiometer.

    Parameters
    ----------
    model
        How readings become irradiance.
    value
        Readings, shape (n,). [lx or W/m2, as the model's kind demands]
    sun
        Unit vectors to the sun, shape (n, 3).
    time_ns
        UTC nanoseconds since 1970, shape (n,).
    dhi_w_m2
        Measured diffuse horizontal irradiance, (n,) or scalar, NaN where not measured. It replaces
        the model's diffuse share of global irradiance, but not of lux: skylight has another luminous
        efficacy. [W/m2]

    Returns
    -------
    Shape (n,); NaN where the cosine on the meter's plane is below 0.2, where the sun is down, and where the
    reading is NaN. [W/m2]
    """
    reading = np.asarray(value, np.float64)
    rays = np.asarray(sun, np.float64).reshape(-1, 3)
    if model.is_direct:
        return np.where(rays[:, 2] > 0.0, reading, np.nan)
    per_beam, per_sky = shares_on_plane(model, rays)
    beam = _beam(model, reading, per_beam, per_sky, rays[:, 2], daylight.extraterrestrial(time_ns))
    if model.kind != "pyranometer":
        return beam
    sky = np.asarray(dhi_w_m2, np.float64)
    freed = np.maximum(reading - sky * per_sky, 0.0) / per_beam
    return np.where(np.isfinite(sky), freed, beam)


def shares_on_plane(model: IrradianceModel, sun: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Irradiance on the meter's plane per direct normal and per diffuse horizontal irradiance.

    Both with what level ground reflects onto the plane; a baffled tube receives the beam alone.

    Parameters
    ----------
    model
        Mounting, diffuse model and albedo of the ground.
    sun
        Unit vectors to the sun, shape (n, 3).

    Returns
    -------
    Shape (n,) each; the first is NaN where the cosine on the plane is below 0.2 or the sun is down. [-]
    """
    facets = np.broadcast_to(VERTICAL, sun.shape)
    if model.mounting == "sun-pointing":
        facets = sun
    elif model.mounting == "in-plane":
        facets = np.broadcast_to(normal(model.plane_tilt_deg, model.plane_azimuth_deg), sun.shape)
    cosine, up = np.sum(facets * sun, axis=1), facets[:, 2]
    usable = np.where((sun[:, 2] > 0.0) & (cosine >= LOWEST_COSINE), cosine, np.nan)
    if model.diffuse == "none":
        return usable, np.zeros(len(sun))
    ground = model.ground_albedo * daylight.ground_view(up)
    return usable + ground * sun[:, 2], daylight.sky_view(up) + ground


def _beam(
    model: IrradianceModel,
    reading: FloatArray,
    per_beam: FloatArray,
    per_sky: FloatArray,
    cos_zenith: FloatArray,
    top: FloatArray,
) -> FloatArray:
    """Split ``E = S per_beam + D per_sky`` with ``D = share / (1 - share) S cos_zenith``.

    The share by Erbs and the efficacy by Perez depend on S in turn; the fixed point is
    damped by one half, because a low sun on a steep meter would make it swing.
    """
    share = np.full(reading.shape, {"none": 0.0}.get(model.diffuse, model.diffuse_fraction))
    efficacy = np.full(reading.shape, model.efficacy_lm_w)
    beam = np.full(reading.shape, np.nan)
    share_by_clearness = DIFFUSE_MODELS[model.diffuse].by_clearness
    for _ in range(40 if share_by_clearness or model.kind == "perez" else 1):
        sky_per_beam = share / (1.0 - share) * cos_zenith
        beam = _on_plane(model, reading, efficacy) / (per_beam + sky_per_beam * per_sky)
        if share_by_clearness:
            clearness = beam * (cos_zenith + sky_per_beam) / (top * cos_zenith)
            share = 0.5 * (share + share_by_clearness(clearness))
        if model.kind == "perez":
            of_global, of_direct = daylight.perez_efficacy(beam, beam * sky_per_beam, cos_zenith, top)
            of_sky = of_direct if model.mounting == "sun-pointing" else of_global
            efficacy = 0.5 * (efficacy + of_sky)
    return beam


def _on_plane(model: IrradianceModel, reading: FloatArray, efficacy: FloatArray) -> FloatArray:
    """Broadband irradiance on the meter's plane, W/m2."""
    if model.kind == "eq10":
        return eq10(reading, model.par_fraction)
    if model.kind == "calibrated":
        return reading * model.factor
    if model.kind == "pyranometer":
        return reading
    return np.asarray(reading / efficacy)
