"""Arguments that cannot be, in Python; the command line refuses the same ones by the same table."""

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from fieldkit import calibrate
from fieldkit.calibrate.result import stamp
from fieldkit.calibration.calibration_record import CalibrationRecord
from fieldkit.config import Config
from fieldkit.model.errors import CalibrationError, ConfigError
from tests.harness.next_steps import at

NOWHERE = Path("no-such-session.h5")
STATION: dict[str, Any] = {"against": "station", "reference": "alamosa-2016-01-01"}


@pytest.mark.parametrize("sd", [-0.1, math.nan])
def test_a_standard_uncertainty_is_a_number_of_at_least_0(sd):
    """A negative one counted as its opposite, or as none, and NaN as none: the result looked better."""
    with pytest.raises(ConfigError, match="reference_sd"):
        calibrate.irradiance(NOWHERE, reference_sd=sd, **STATION)
    with pytest.raises(ConfigError, match="target_sd_k"):
        calibrate.uniformity(NOWHERE, target_sd_k=sd)
    with pytest.raises(ConfigError, match="tilt_sd_deg"):
        calibrate.surface(NOWHERE, tilt_sd_deg=sd)
    with pytest.raises(ConfigError, match="mark_sd_px"):
        calibrate.pose(NOWHERE, "EPSG:32654", (120, 160), mark_sd_px=sd)


def test_another_kind_of_reference_is_not_taken_for_a_station():
    with pytest.raises(ConfigError, match="'pyro'"):
        calibrate.irradiance(NOWHERE, against="pyro", reference="alamosa-2016-01-01")  # type: ignore[arg-type]


def test_a_clock_that_was_read_without_its_zone_is_refused():
    config = Config.__new__(Config)
    with pytest.raises(ConfigError, check=at(datetime(2026, 12, 11, 11, 52))):
        calibrate.host_clock(config, host_ns=0, shown=datetime(2026, 12, 11, 11, 52))


@pytest.mark.parametrize(("value", "sd"), [(math.nan, 0.1), (1.0, math.nan), (1.0, math.inf)])
def test_a_result_that_is_no_number_is_not_saved(value, sd):
    """A budget of 1e9 K gave 0.892 ± nan, and a record without an uncertainty."""
    with pytest.raises(CalibrationError, match="not determined"):
        stamp(CalibrationRecord("clock", "clock", datetime(2026, 1, 1, tzinfo=UTC), value, sd, "s", "test"))


def test_a_record_has_a_name_that_a_file_can_have():
    nameless = CalibrationRecord("clock", "../clock", datetime(2026, 1, 1), 1.0, 0.1, "s", "test")
    with pytest.raises(ConfigError, match="write 'clock'"):
        stamp(nameless)
