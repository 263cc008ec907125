"""Measures that would narrow a slope: what is known by now, conditioned on what each of them would give.

One linear step of the joint posterior (Kalman's update by a reading that is still to come): it never widens
a region. What a measure teaches besides, such as the course of an air temperature beside its level, is not
counted, so the gain is the least to expect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import NamedTuple

from fieldkit.estimation.estimator_keys import LEVEL_SD_DEG
from fieldkit.estimation.learned.inputs import Logged
from fieldkit.estimation.learned.readout import Moments
from fieldkit.estimation.settings import EstimatorSettings

LEAST_GAIN = 0.05
"""Share of a half-width below which a measure is not worth a word.

Judged: because half-widths of one session scatter by as much.
"""
AIR_LOGGED_SD_K = 0.5
"""Judged: because it is the error of a shaded thermometer as the air at the beds."""
LONGWAVE_MEASURED_SD_W_M2 = 10.0
"""The uncertainty of a pyrgeometer in the field, as the description of `prior.longwave_sd_w_m2` states it."""
DEPTH_MEASURED_SD = 0.1
"""Relative. Judged: because a ruler in 3 cm of sand reads to 3 mm."""
OFFSET_SD_K = 0.05
"""What a calibration of uniformity leaves of the offsets."""
SHADE_TEST = {"exchange": 0.12, "thermal_inertia": 0.08}
"""Relative. What a shade test of each bed leaves of both in simulated sessions of three hours."""


class Measure(NamedTuple):
    """A measure in words, and by name in `Moments` the standard uncertainty of each number after it."""

    words: str
    known: Mapping[str, float]


def measures(settings: EstimatorSettings, logged: Logged, targets: Mapping[int, str]) -> list[Measure]:
    """Measures that these settings and instruments do not have yet; names of targets by their place."""
    prior = settings.prior
    by_instrument = (
        (not logged.air, "an air temperature logged in the shade", {"air": AIR_LOGGED_SD_K}),
        (not logged.diffuse, "diffuse irradiance measured", {"diffuse": prior.diffuse_sd}),
        (
            prior.longwave_sd_w_m2 > LONGWAVE_MEASURED_SD_W_M2,
            f"a pyrgeometer with prior.longwave_sd_w_m2 = {LONGWAVE_MEASURED_SD_W_M2:g}",
            {"longwave": LONGWAVE_MEASURED_SD_W_M2},
        ),
        (
            prior.depth_log_sd > DEPTH_MEASURED_SD,
            f"the depth of the sand, prior.depth_log_sd = {DEPTH_MEASURED_SD:g}",
            {"depth": DEPTH_MEASURED_SD},
        ),
        (
            settings.offset_sd_k > OFFSET_SD_K,
            f"calibrated offsets, estimator.offset_sd_k = {OFFSET_SD_K:g}",
            {f"offset{target}": OFFSET_SD_K for target in targets},
        ),
        (True, "a shade test of each bed", SHADE_TEST),
    )
    by_bed = (
        Measure(f"{name} as a known bed", {f"tilt{target}": LEVEL_SD_DEG}) for target, name in targets.items()
    )
    return [*(Measure(words, known) for is_open, words, known in by_instrument if is_open), *by_bed]


def narrowing(joint: Moments, tilt: str, offers: Sequence[Measure]) -> dict[str, float]:
    """Share of a tilt's half-width that each measure leaves, the smallest first; small gains are omitted."""
    shares = {
        offer.words: joint.sd_if_known(tilt, _readings(joint, offer)) / joint.sd(tilt)
        for offer in offers
        if tilt not in offer.known
    }
    worth_it = ((words, share) for words, share in shares.items() if share <= 1.0 - LEAST_GAIN)
    return dict(sorted(worth_it, key=itemgetter(1)))


def _readings(joint: Moments, offer: Measure) -> dict[str, float]:
    """Standard uncertainties of readings that leave those of the measure; none of what is known as well."""
    now = {name: joint.sd(name) for name in offer.known}
    return {name: (sd**-2 - now[name] ** -2) ** -0.5 for name, sd in offer.known.items() if sd < now[name]}
