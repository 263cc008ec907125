"""BSRN's tests on measured minutes of a SURFRAD station, as they are and spoilt as instruments spoil them."""

from pathlib import Path

import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.limits import is_rare
from fieldkit.model.samples import Reading
from fieldkit.physics.sun import sun_vectors
from fieldkit.sessions.formats.imported import ImportedRecording, write_imported
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.radiation_check import radiation_findings
from fieldkit.sessions.reader import open_session
from fieldkit.weather import packaged_day

NAMES = ("ghi", "dhi", "dni", "longwave_down")
STREAMS = (
    *(StreamInfo(name, "irradiance", "W m-2", (1,), measures=(name,), rate_hz=1 / 60) for name in NAMES),
    StreamInfo("air", "air_temperature", "K", (1,), rate_hz=1 / 60),
)


@pytest.fixture(scope="module")
def noon():
    """An hour about local noon (19 UTC) at Alamosa; global irradiance as the sum of its components."""
    day = packaged_day()
    chosen = (day.time_ns >= day.time_ns[0] + 18.5 * 3.6e12) & (day.time_ns < day.time_ns[0] + 19.5 * 3.6e12)
    time_ns = day.time_ns[chosen]
    dni, dhi = day.dni_w_m2[chosen], day.dhi_w_m2[chosen]
    return {
        "time_ns": time_ns,
        "ghi": dhi + dni * sun_vectors(time_ns, day.site)[:, 2],
        "dhi": dhi,
        "dni": dni,
        "longwave_down": day.longwave_down_w_m2[chosen],
        "air": day.air_temperature_k[chosen],
    }


def findings(path: Path, columns: dict[str, np.ndarray]) -> list[tuple[str, str]]:
    streams = tuple(one for one in STREAMS if one.name in columns)
    times = columns["time_ns"].tolist()
    rows = [
        Reading(one.name, at, at, (float(value),))
        for one in streams
        for at, value in zip(times, columns[one.name], strict=True)
    ]
    rows.sort(key=lambda one: one.time_ns)
    write_imported(
        path, SessionHeader("light", packaged_day().site, streams), ImportedRecording(streams, rows), "a test"
    )
    with open_session(path) as session:
        return [(one.level, one.text) for one in radiation_findings(session)]


def test_a_clear_measured_hour_passes(tmp_path, noon):
    ((level, _),) = findings(tmp_path / "a.h5", noon)
    assert level == "ok"


@pytest.mark.parametrize(
    ("column", "spoilt", "text"),
    [
        ("ghi", 54.0, "dhi exceeds ghi"),  # leaves on the dome
        ("dni", 20.0, "ghi is not dhi and dni together"),  # the tracker stopped
        ("longwave_down", 450.0, "longwave_down does not fit the air"),  # wet dome in cold air
        ("longwave_down", 550.0, "longwave_down is extremely rare"),
    ],
)
def test_a_spoilt_instrument_is_named(tmp_path, noon, column, spoilt, text):
    wrong = {**noon, column: np.full(60, spoilt)}
    found = findings(tmp_path / "a.h5", wrong)
    assert {level for level, _ in found} == {"warn"}
    assert any(words.startswith(f"{text} in 60 min, first at 2016-01-01 11:29 MST") for _, words in found)


def test_light_alone_is_not_compared(tmp_path, noon):
    alone = {name: noon[name] for name in ("time_ns", "dni")}
    assert [level for level, _ in findings(tmp_path / "a.h5", alone)] == ["ok"]
    air = {name: noon[name] for name in ("time_ns", "air")}
    assert findings(tmp_path / "b.h5", air) == []


def test_extremely_rare_limits_of_bsrn():
    # at the zenith under 1361 W/m2: 1.2 x 1361 + 50, 0.75 x 1361 + 30, 0.95 x 1361 + 10
    for name, most in (("ghi", 1683.2), ("dhi", 1050.75), ("dni", 1302.95)):
        values = np.array([most - 0.1, most + 0.1, -1.9, -2.1, np.nan])
        rare = is_rare(name, values, np.ones(5), np.full(5, 1361.0))
        assert rare.tolist() == [False, True, False, True, False]
    # at 30 degrees: 1361 x 1.2 x 0.5^1.2 + 50 = 760.9
    assert is_rare("ghi", np.array([760.0, 762.0]), np.full(2, 0.5), np.full(2, 1361.0)).tolist() == [
        False,
        True,
    ]
