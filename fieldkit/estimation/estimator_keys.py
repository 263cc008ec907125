"""The keys of ``[estimator]`` in ``fieldkit.toml``: what each accepts, its default and its words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from fieldkit.model.confidence import CONFIDENCE, LEAST_CONFIDENCE, MOST_CONFIDENCE
from fieldkit.model.slope import TARGET_HALF_WIDTH_DEG

Method = Literal["unit-norm", "contours"]
Model = Literal["paper", "full", "learned"]
Seconds = Annotated[float, Field(ge=60, le=86_400, strict=True)]
STRICT: Mapping[str, Any] = {"extra": "forbid", "allow_inf_nan": False}
"""Settings of pydantic for a dataclass that is a table of the configuration."""


def key(default: Any, description: str, **accepted: Any) -> Any:
    """A field of a dataclass that is a key of ``fieldkit.toml`` too.

    Parameters
    ----------
    default, description
        Its value where the file has none; its words in the template, on the reference page and in messages.
    accepted
        What it accepts, as constraints of `pydantic.Field`: ``gt``, ``ge``, ``lt``, ``le`` ...; numbers and
        truth values are not converted from anything else.
    """
    is_strict = {} if isinstance(default, str) else {"strict": True}
    return field(default=default, metadata={"description": description, **is_strict, **accepted})


LEVEL_SD_DEG = 0.3
"""Standard uncertainty of a reference's slope, where none is stated.

Judged: because an electronic level reads to 0.1 degrees, and a raked bed is no plane.
"""


@dataclass(frozen=True, slots=True)
class EstimatorKeys:
    """Estimation of slopes from minute bins."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STRICT

    method: Method = key("unit-norm", "contours: the paper's contour score; for the models paper and full")
    model: Model = key(
        "learned",
        "learned: finds sand, air and sky from the data; paper: eq. (6), direct light only; "
        "full: with diffuse light, longwave and stored heat as configured",
    )
    reference: Literal["region", "weather"] = key(
        "region",
        "weather: none, slopes from the weather alone, by a model of its own for plates and walls; "
        "region: those of known slope",
    )
    air: Literal["measured", "model"] = key(
        "measured", "model: weather of a satellite or forecast; for slopes from the weather alone"
    )
    window_s: Seconds | Literal["weather"] = key(
        "weather",
        'length of the window, for paper and full; "weather": as long as one slope explains the '
        "minutes; learned uses all minutes",
    )
    azimuth: Literal["free", "known"] = key("free", "known: uses each region's azimuth_deg")
    tilt_limit_deg: float = key(45.0, "upper limit of the tilt", gt=0, le=90)
    refraction: bool = key(False, "true: the apparent sun; false: geometric (paper)")
    noise_k: float = key(0.05, "noise of a region's minute mean, one sigma", ge=0.001, le=5)
    low_sun_deg: float = key(8.0, "minutes with a lower sun are excluded", ge=0, le=45)
    settle_s: float = key(600.0, "how long minutes stay flagged after a cloud", ge=0, le=86_400)
    min_minutes: int = key(
        5, "minimum number of good minutes; a free azimuth needs at least 3", ge=2, le=1440
    )
    contour_tolerance_w_m2: float | None = key(
        None, "half width of a contour; default: from the noise", ge=0.01, le=500, examples=[5.0]
    )
    contour_threshold: float = key(0.5, "share of minutes that the best cell must explain", ge=0, le=1)
    scale: float = key(1.0, 'kappa: measured over true share of the sun; or "@name"', ge=0.1, le=10)
    scale_sd: float = key(
        0.08, "standard uncertainty of scale with paper and full; learned: prior.gain_sd", ge=0, le=1
    )
    exchange_sd: float = key(0.15, "relative standard uncertainty of air.exchange_m_s", ge=0, le=1)
    offset_sd_k: float = key(0.25, "standard uncertainty of regions' offset_k", ge=0, le=10)
    drift_sd_k_per_h: float = key(0.1, "drift between regions in the camera, one sigma", ge=0, le=20)
    sky: Literal["isotropic", "hay-davies"] = key(
        "hay-davies", "distribution of diffuse light over the sky; not for paper"
    )
    ground_albedo: float = key(
        0.20, "albedo of the surroundings; not for paper, except on a tilted light meter", ge=0, lt=1
    )
    longwave_down_w_m2: float = key(
        300.0, "downward longwave radiation, if not measured; learned: if the air is not either", ge=0, le=700
    )
    diffuse_fraction: float = key(0.15, "diffuse fraction, if not measured; not for paper", ge=0, lt=1)
    confidence: float = key(
        CONFIDENCE,
        "probability with which likelihood regions and intervals should hold the truth",
        ge=LEAST_CONFIDENCE,
        le=MOST_CONFIDENCE,
    )
    target_half_width_deg: float = key(
        TARGET_HALF_WIDTH_DEG, "a slope is ok up to this half-width, or 0.15 of its tilt", ge=0.1, le=20
    )
