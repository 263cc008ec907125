"""The clock offset of a log is found where the time series determine it, and refused where they do not."""

from pathlib import Path

import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Reading
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.sessions.formats.imported import ImportedRecording, write_imported
from fieldkit.sessions.formats.merged import TimeSeries, align, best_offset
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from fieldkit.weather import packaged_day, read_surfrad
from tests.harness.logs import read
from tests.harness.next_steps import at
from tests.shared_data import shared

NOON_S = 19 * 3600.0  # of the station, in UTC


def light(
    chance: np.random.Generator, *, cloudy: bool, true_s: float, noise: float
) -> tuple[TimeSeries, TimeSeries]:
    """Three hours at 1 Hz, and a log of four at 0.1 Hz with a gain and level of its own and a wrong clock."""
    day = read_surfrad(shared("data/weather/slv15365.dat")) if cloudy else packaged_day()
    measured_s = (day.time_ns - day.time_ns[0]) / 1e9
    seconds, tens = np.arange(0, 3 * 3600.0), np.arange(-1800.0, 3.5 * 3600.0, 10.0)
    lux = 110.0 * np.interp(NOON_S + seconds, measured_s, day.ghi_w_m2)
    log = 500.0 + 102.0 * np.interp(NOON_S + tens, measured_s, day.ghi_w_m2)
    return (
        TimeSeries(tens - true_s, log + chance.normal(0, noise, tens.size)),
        TimeSeries(seconds, lux + chance.normal(0, noise, seconds.size)),
    )


@pytest.mark.parametrize(
    "true_s",
    [-4000.0, 12.3, *(pytest.param(offset_s, marks=pytest.mark.slow) for offset_s in (-37.0, 0.0, 3600.0))],
)
def test_broken_cloud_tells_the_offset_to_a_second_or_two(true_s):
    found = best_offset(*light(np.random.default_rng(1), cloudy=True, true_s=true_s, noise=500.0))
    assert found.offset_s == pytest.approx(true_s, abs=found.uncertainty_s)
    assert found.uncertainty_s < 5.0
    assert found.correlation > 0.99


@pytest.mark.parametrize("count", [4, pytest.param(10, marks=pytest.mark.slow)])
def test_stated_uncertainty_covers_the_error_under_a_clear_sky(count):
    """A smooth bell tells little; what is said must still be true nineteen times of twenty."""
    misses = answers = 0
    for seed in range(count):
        try:
            found = best_offset(*light(np.random.default_rng(seed), cloudy=False, true_s=300.0, noise=200.0))
        except NoAnswerError:
            continue
        answers += 1
        misses += abs(found.offset_s - 300.0) > found.uncertainty_s
    assert answers >= 3
    assert misses <= count // 10


SECONDS, NOISE = np.arange(3000.0), np.random.default_rng(3)


@pytest.mark.parametrize(
    ("log", "curve", "value"),
    [
        (np.sin(SECONDS / 50), np.sin(SECONDS / 50), r"[+-]\d+ s fits"),
        (SECONDS, SECONDS, r"[+-]\d+ s fits"),
        (np.ones(3000), np.ones(3000), "0%"),
        (NOISE.normal(size=3000), NOISE.normal(size=3000), r"\d%"),
        (SECONDS[:5], SECONDS, "20 points"),
    ],
    ids=["periodic", "a straight line", "constant", "noises", "few points"],
)
def test_curves_that_fit_in_several_places_or_nowhere_are_refused(log, curve, value):
    with pytest.raises(NoAnswerError, match=value):
        best_offset(TimeSeries(SECONDS[: log.size] - 7, log), TimeSeries(SECONDS, curve))


# --- sessions

START_NS = 1_480_000_000_000_000_000


def wandering(seconds: np.ndarray) -> np.ndarray:
    """A temperature that goes up and down as under passing clouds, never twice alike."""
    return 293.15 + np.sin(seconds / 91) + 2 * np.sin(seconds / 233 + 1) + 3 * np.sin((seconds / 900) ** 1.5)


@pytest.fixture
def session(tmp_path):
    info = StreamInfo("thermometer", "temperature", "K", (2,), channels=("T1", "T2"), rate_hz=1.0)
    stamps = [(START_NS + n * 10**9, float(kelvin)) for n, kelvin in enumerate(wandering(SECONDS))]
    samples = [Reading("thermometer", ns, ns, (kelvin, kelvin + 1)) for ns, kelvin in stamps]
    path = tmp_path / "a.h5"
    write_imported(path, SessionHeader("t", Site(0, 0), (info,)), ImportedRecording((info,), samples), "here")
    with open_session(path) as opened:
        yield opened


def log(tmp_path: Path, offset_s: float) -> ImportedRecording:
    times = np.arange(100.0, 2900.0, 5.0)
    shown = zip(START_NS / 1e9 + times - offset_s, wandering(times) - 273.15, strict=True)
    rows = [f"{stamp:.3f},{celsius:.4f}" for stamp, celsius in shown]
    return read(tmp_path, "time,T1 [C]\n" + "\n".join(rows), "logger")


def test_log_is_moved_onto_the_sessions_curve_and_says_so(session, tmp_path):
    moved = align(session, log(tmp_path, 83.0))
    first = next(iter(moved.samples))
    assert (first.time_ns - START_NS) / 1e9 == pytest.approx(100.0, abs=1.0)
    assert first.mono_ns == first.time_ns
    assert "± 1.0 s (k=2)" in moved.notes[-1][1]
    assert " thermometer," in moved.notes[-1][1]


def test_whole_hours_are_suspected_to_be_a_zone(session, tmp_path):
    assert "zone" in align(session, log(tmp_path, 3600.0)).notes[-1][1]


def test_regions_of_the_pictures_tell_the_offset_of_a_probe_in_the_sand(tmp_path):
    info = StreamInfo("camera", "brightness_temperature", "K", (4, 6), 0.01, rate_hz=0.5)
    corners = ((0.0, 0.0), (5.0, 0.0), (5.0, 3.0), (0.0, 3.0))
    head = SessionHeader("t", Site(0, 0), (info,), (Region("b05", RegionKind.TARGET, corners),))
    empty, stamps = np.empty((0, 0), np.uint16), range(0, 3000, 2)
    counts = np.rint(wandering(np.array(stamps, float)) * 100).astype(np.uint16)
    frames = [
        Frame("camera", START_NS + n * 10**9, START_NS + n * 10**9, np.full((4, 6), count), empty)
        for n, count in zip(stamps, counts, strict=True)
    ]
    write_imported(tmp_path / "a.h5", head, ImportedRecording((info,), frames), "here")
    with open_session(tmp_path / "a.h5") as session:
        moved = align(session, log(tmp_path, -20.0))
    assert " b05 of camera," in moved.notes[-1][1]
    first = next(iter(moved.samples))
    assert (first.time_ns - START_NS) / 1e9 == pytest.approx(100.0, abs=1.0)


def test_log_of_another_quantity_is_refused(session, tmp_path):
    lux = read(tmp_path, "time,L [lx]\n" + "\n".join(f"{START_NS / 1e9 + n},{n % 7}" for n in range(50)))
    with pytest.raises(NoAnswerError, check=at(session.path, Argument("offset_s", 12))):
        align(session, lux)
