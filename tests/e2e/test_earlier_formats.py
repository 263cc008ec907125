"""Sessions that earlier versions of fieldkit recorded are opened, checked, estimated and reported as then.

Eight minutes of the simulated field with the paper's model, recorded when the format was 1.0 to 1.4. The
slopes expected are those that the recorder of that time stored in them.
"""

import gzip
import shutil
from pathlib import Path

import pytest

import fieldkit
from fieldkit.sessions.reader import open_session

KEPT = Path(__file__).parents[1] / "data/sessions"


@pytest.fixture(params=["1.0", "1.1", "1.2", "1.3", "1.4"])
def earlier(request, tmp_path):
    path = tmp_path / f"format-{request.param}.h5"
    with gzip.open(KEPT / f"{path.name}.gz") as kept, path.open("wb") as unpacked:
        shutil.copyfileobj(kept, unpacked)
    return path


def test_it_opens_with_everything_that_was_recorded(earlier):
    with open_session(earlier) as session:
        counts = {name: session.count(name) for name in session.streams}
        assert "format-{}.{}".format(*session.format_version) == earlier.stem
        assert [region.name for region in session.regions] == ["flat", "b05", "b15", "b25"]
    assert counts == {"camera": 24, "lux": 480, "thermometer": 481}


def test_it_checks_clean(earlier):
    found = fieldkit.check(earlier)
    assert {finding.level for finding in found.findings} == {"ok"}
    assert "27 slopes come out the same" in " ".join(finding.text for finding in found.findings)


def test_it_is_estimated_as_it_was_while_recording(earlier):
    with open_session(earlier) as session:
        stored = session.estimates()
    again = list(fieldkit.open_session(earlier).estimate())
    assert len(again) == len(stored) == 27
    for one, other in zip(again, stored, strict=True):
        assert (one.region, one.state, one.time_ns // 1000) == (
            other.region,
            other.state,
            other.time_ns // 1000,
        )
        numbers = [(one.tilt_deg, one.tilt_high_deg), (other.tilt_deg, other.tilt_high_deg)]
        # other by up to 1.4e-8 degrees since: the sun's spline of then was right to 0.001 arcseconds
        assert numbers[0] == pytest.approx(numbers[1], abs=1e-7, nan_ok=True)


def test_it_is_reported(earlier):
    page = fieldkit.report(earlier).path.read_text(encoding="utf-8")
    assert "b25" in page
    assert "<svg" in page
