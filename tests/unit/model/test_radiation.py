"""What a radiation stream measures: declared, stated, or certain from where an older session comes from."""

import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.radiation import measured, named, with_components
from fieldkit.model.site import Site
from fieldkit.sessions.layout import SessionHeader


def stream(name="sun", quantity="irradiance", unit="W m-2", channels=1, **more):
    return StreamInfo(name, quantity, unit, (channels,), **more)


@pytest.mark.parametrize(
    ("info", "expected"),
    [
        (stream("slv-direct", driver="import", model="NOAA, SURFRAD, slv16001.dat"), ("dni",)),
        (stream("slv-diffuse", driver="import", model="NOAA, SURFRAD, slv16001.dat"), ("dhi",)),
        (stream("tat-global", driver="import", vendor="Japan Meteorological Agency"), ("ghi",)),
        (
            stream("s-longwave-up", "longwave_irradiance", driver="import", model="BSRN, a.gz"),
            ("longwave_up",),
        ),
        (stream("logger-direct", driver="import"), ("",)),  # a table that its user called so
        (stream(driver="modbus", model="Apogee SP-522"), ("ghi",)),
        (stream(driver="modbus", model="Kipp & Zonen SMP / SHP1", channels=2), ("", "")),  # one map for both
        (stream(driver="text", model="text"), ("",)),
        (stream("lux", "illuminance", "lx"), ()),
    ],
)
def test_older_sessions_say_only_what_their_origin_leaves_no_doubt_of(info, expected):
    assert measured(info, {}) == expected


def test_configuration_stands_above_what_a_stream_declares():
    tilted = stream(measures=("ghi", "ghi"), channels=2)
    assert measured(tilted, {"sun": "gti", "other": "dni"}) == ("gti", "gti")
    assert with_components(stream(), {"sun": "dhi"}).measures == ("dhi",)
    assert with_components(stream(), {}) == stream()


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        (["GHI_Avg", "dhi_w_m2", "cell"], ("ghi", "dhi", "")),
        (["sun", "radiation", "global"], ()),
        (["longwave_down"], ("longwave_down",)),
    ],
)
def test_only_the_components_own_names_say_what_a_column_measures(labels, expected):
    assert named(labels) == expected


def test_headers_of_older_sessions_have_no_components_and_open():
    header = SessionHeader("a day", Site(0.0, 0.0), (stream(measures=("ghi",)),))
    assert SessionHeader.from_json(header.to_json()).streams[0].measures == ("ghi",)
    older = header.to_json().replace('"measures": ["ghi"], ', "")
    assert "measures" not in older
    assert SessionHeader.from_json(older).streams[0].measures == ()
