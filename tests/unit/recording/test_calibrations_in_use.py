"""A record in a configuration that does not use it, or not as it was made."""

from datetime import UTC, datetime

import pytest

from fieldkit.calibration.calibration_record import CalibrationRecord, save
from fieldkit.config import load_config
from fieldkit.recording.preflight import _use_warnings

NOW = datetime(2026, 12, 10, tzinfo=UTC)
SITE = "[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\n"
EQ10 = "eq10 /0.44, diffuse 15%, horizontal"


@pytest.mark.parametrize(
    ("table", "light", "said"),
    [
        ('[irradiance]\nfactor = "@roof"\n', EQ10, ['roof is not used: irradiance.model is "eq10"']),
        ('[irradiance]\nmodel = "calibrated"\nfactor = "@roof"\n', "calibrated", []),
        ('[estimator]\nmodel = "paper"\nscale = "@beds"\n', EQ10, []),
        ('[estimator]\nmodel = "paper"\nscale = "@beds"\n', "calibrated", [f"for light by {EQ10}, not by"]),
        ('[estimator]\nmodel = "full"\nscale = "@beds"\n', EQ10, ["of the paper model, not of full"]),
    ],
)
def test_a_record_that_does_not_fit_the_configuration_is_a_warning(tmp_path, table, light, said):
    details = {"model": "paper", "irradiance": EQ10}
    for record in (
        CalibrationRecord("irradiance", "roof", NOW, 0.0091, 0.0002, "W/m2/lx", "test"),
        CalibrationRecord("surface", "beds", NOW, 1.1, 0.02, "1", "test", details=details),
    ):
        save(record, tmp_path / "calibration")
    (tmp_path / "fieldkit.toml").write_text(SITE + table)
    config = load_config(tmp_path / "fieldkit.toml", environment={})
    ((key, record),) = config.calibrations().items()
    found = _use_warnings(key, record, config, light)
    assert len(found) == len(said)
    assert all(words in warning for words, warning in zip(said, found, strict=True))
