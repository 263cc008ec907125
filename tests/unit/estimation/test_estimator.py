from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator import Estimator, EstimatorSettings, Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import EventKind, Frame, Quality, Reading
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.physics.facet import angle_between_deg, normal
from tests.harness.last_minute import collected, history_of, last_of, measured


def run(yard, samples, settings=None) -> list[Minute]:
    estimator = Estimator(yard.site, yard.beds, yard.streams, settings or EstimatorSettings(model="paper"))
    closed = [minute for sample in samples for minute in estimator.add(sample)]
    return closed + estimator.finish()


def with_frames(yard, samples, change, after_min=0.0):
    """Samples with other counts of the frames from a minute on: by what they were and the minutes since."""
    begin_ns = yard.start_ns + round(after_min * MINUTE_NS)
    return [
        s._replace(counts=change(s.counts, (s.time_ns - begin_ns) / MINUTE_NS).astype(np.uint16))
        if isinstance(s, Frame) and s.time_ns >= begin_ns
        else s
        for s in samples
    ]


def with_readings(yard, minutes, change):
    """Samples of some minutes with other readings of the light meter."""
    return [change(s) if s.stream == "lux" else s for s in yard.samples(minutes)]


def by_name(minute: Minute) -> dict:
    return {estimate.region: estimate for estimate in minute.estimates}


@pytest.fixture(scope="module")
def hour(yard):
    """The bins of an hour, which do not depend on how slopes are found."""
    return history_of(yard, yard.samples(61))


def slopes_after(yard, hour, **settings):
    """Slopes at the end of the hour by the paper's model."""
    settings = EstimatorSettings(**{"model": "paper", "window_s": 3600.0, **settings})
    return {slope.region: slope for slope in SlopeChain(yard.beds, settings).at(hour).slopes}


@pytest.fixture(scope="module")
def an_hour(yard):
    return run(yard, yard.samples(61), EstimatorSettings(model="paper", window_s=3600.0))


def off_deg(found, tilt_deg, azimuth_deg) -> float:
    """Angle between a slope that was found and the true one."""
    return float(angle_between_deg(normal(found.tilt_deg, found.azimuth_deg), normal(tilt_deg, azimuth_deg)))


def assert_beds(yard, slopes, within_deg):
    """Every bed is near its true slope, which lies in its region."""
    assert list(slopes) == ["b08", "b17", "b25"]
    for bed in yard.beds[1:]:
        found = slopes[bed.name]
        assert off_deg(found, bed.tilt_deg, bed.azimuth_deg) < within_deg
        assert found.tilt_low_deg < bed.tilt_deg < found.tilt_high_deg
        assert found.azimuth_low_deg < bed.azimuth_deg < found.azimuth_high_deg


def test_one_hour_of_the_papers_physics_gives_every_slope_back(yard, an_hour):
    assert_beds(yard, by_name(an_hour[-1]), 0.2)  # counts are rounded to 0.01 K
    for found in an_hour[-1].estimates:
        assert found.tilt_low_deg <= found.noise_tilt_low_deg
        assert found.noise_tilt_high_deg <= found.tilt_high_deg
        assert found.model == "paper, unit-norm"


def test_a_minute_tells_what_was_measured(yard, an_hour):
    minute = an_hour[10]
    assert minute.dni_w_m2 == pytest.approx(800.0, rel=1e-9)
    assert minute.irradiance_model == "eq10 /0.44, diffuse 15%, horizontal"
    assert minute.contact_k[0] == pytest.approx(304.15)
    assert np.isnan(minute.contact_k[1])
    assert minute.pixels == {"flat": 315, "b08": 315, "b17": 315, "b25": 315}
    # 9:00 local, S = 800, Ta = 303.15, L = 400 on the flat bed: 318.655 K (independent reference)
    assert an_hour[0].temperature_k["flat"] == pytest.approx(318.655, abs=0.02)
    # eq. (7) at the sun of that minute, through emissivity 0.90 and a sky of 233.15 K and back
    assert minute.temperature_k["flat"] == pytest.approx(an_hour[9].temperature_k["flat"] + 0.08, abs=0.08)
    assert minute.time_ns // MINUTE_NS == yard.start_ns // MINUTE_NS + 10


def test_a_region_below_its_horizon_is_flagged_and_the_others_are_as_they_were(yard):
    plain = by_name(last_of(yard, yard.samples(31)))
    below = EstimatorSettings(model="paper", horizons={"b17": ((0.0, 89.0),)})
    found = by_name(last_of(yard, yard.samples(31), below))
    assert found["b17"].flags & Quality.SHADED
    assert np.isnan(found["b17"].tilt_deg)
    assert repr(found["b08"]) == repr(plain["b08"])


def stacked(yard, samples):
    """The bins of all samples to the bit, from which any model makes its slopes."""
    _, closed = collected(yard, samples)
    bins = History.of([entry for entry, _ in closed]).arrays()
    events = [event for _, reported in closed for event in reported]
    return events, {name: values.tobytes() for name, values in bins.items()}


def test_interleaving_within_two_seconds_changes_nothing_at_all(yard):
    samples = replace(yard, noise_k=0.05).samples(25, frames=3)
    random = np.random.default_rng(3)
    late = [sample.time_ns + int(random.uniform(0, 0.99e9)) for sample in samples]
    shuffled = [samples[index] for index in np.argsort(late, kind="stable")]
    assert [s.time_ns for s in shuffled] != [s.time_ns for s in samples]
    in_order, mixed = (stacked(yard, order) for order in (samples, shuffled))
    assert in_order == mixed


def test_contours_find_the_beds_within_their_regions(yard, hour):
    slopes = slopes_after(yard, hour, method="contours", tilt_limit_deg=30.0)
    assert_beds(yard, slopes, 0.4)  # the mean over a grid of half a degree
    assert all("contours" in found.model for found in slopes.values())


def test_two_minutes_are_the_fewest_that_can_disagree_about_a_tilt_alone(yard):
    for options, few in (
        ({"azimuth": "known", "min_minutes": 2}, 1),
        ({"azimuth": "free", "min_minutes": 2}, 2),
        ({}, 4),
    ):
        minutes = run(yard, yard.samples(few + 2), EstimatorSettings(model="paper", **options))
        states = [minute.estimates[0].state for minute in minutes]
        assert [state is SlopeState.TOO_FEW for state in states] == [True] * few + [False] * 2


def test_known_azimuth_needs_few_minutes(yard):
    minute = last_of(yard, yard.samples(8), EstimatorSettings(model="paper", azimuth="known"))
    for bed in yard.beds[1:]:
        assert by_name(minute)[bed.name].tilt_deg == pytest.approx(bed.tilt_deg, abs=0.1)
        assert by_name(minute)[bed.name].azimuth_deg == pytest.approx(bed.azimuth_deg)


@pytest.mark.parametrize("azimuth", [100.0, 280.0, -80.0])
def test_a_known_azimuth_holds_for_a_bed_found_flat(yard, azimuth):
    """In the morning tilt to the east warms and tilt to the west cools."""
    flat = replace(yard, beds=(yard.beds[0], replace(yard.beds[1], tilt_deg=0.0, azimuth_deg=azimuth)))
    samples = flat.samples(8)
    # a little too cold for a flat bed turned towards the sun, too warm for one turned away
    offset_k = 0.3 if azimuth == 100.0 else -0.3
    settings = EstimatorSettings(model="paper", azimuth="known", offsets_k={"b08": offset_k})
    found = last_of(flat, samples, settings).estimates[0]
    assert found.tilt_deg == 0.0
    assert found.azimuth_deg == found.azimuth_low_deg == found.azimuth_high_deg == azimuth % 360.0
    assert (found.kelvin_per_degree > 0.0) == (azimuth == 100.0)
    slightly = replace(flat, beds=(flat.beds[0], replace(flat.beds[1], tilt_deg=1.0)))
    warmer = last_of(slightly, slightly.samples(8), EstimatorSettings(model="paper", azimuth="known"))
    kelvin = warmer.temperature_k["b08"] - warmer.temperature_k["flat"]
    assert found.kelvin_per_degree == pytest.approx(kelvin, abs=0.05)


def test_tilted_reference_and_several_references(yard):
    leaning = Region("leaning", RegionKind.REFERENCE, yard.beds[2].points_px, 17.0, 250.0)
    beds = (yard.beds[0], yard.beds[1], leaning, yard.beds[3])
    for chosen in (beds, beds[1:]):
        some = replace(yard, beds=chosen)
        settings = EstimatorSettings(model="paper", window_s="weather")
        found = by_name(last_of(some, some.samples(61), settings))["b08"]
        assert off_deg(found, 8.0, 140.0) < 0.3


def test_flat_target_is_called_flat(yard):
    beds = (*yard.beds[:1], replace(yard.beds[1], tilt_deg=0.0))
    level = replace(yard, beds=beds)
    settings = EstimatorSettings(model="paper", offset_sd_k=0.1, target_half_width_deg=3.0)
    found = last_of(level, level.samples(120), settings).estimates[0]
    assert found.state == SlopeState.FLAT
    assert found.tilt_low_deg == 0.0
    assert found.azimuth_high_deg - found.azimuth_low_deg == pytest.approx(360.0)
    assert found.reason.startswith("flat within")


def test_a_slope_known_to_a_wide_region_only_is_called_wide(yard, hour):
    for found in slopes_after(yard, hour, offset_sd_k=2.0).values():
        assert found.state == SlopeState.WIDE
        low, high = found.tilt_low_deg, found.tilt_high_deg
        assert found.reason == f"anything from {low:.1f}° to {high:.1f}° fits (90 %)"


@pytest.mark.parametrize(("azimuth", "factor"), [("known", 1.1916), ("free", 1.1406)])
def test_regions_of_another_confidence_are_wider_by_the_root_of_the_chi_square_quantiles(
    yard, hour, azimuth, factor
):
    """3.8415 over 2.7055 with one angle, 5.9915 over 4.6052 with two (tables of chi-square)."""

    def widths(confidence: float) -> np.ndarray:
        found = slopes_after(yard, hour, azimuth=azimuth, confidence=confidence).values()
        assert {one.confidence for one in found} == {confidence}
        return np.array([one.noise_tilt_high_deg - one.noise_tilt_low_deg for one in found])

    assert widths(0.95) / widths(0.90) == pytest.approx(factor, rel=0.03)


def test_both_branches_are_reported_when_both_fit(yard):
    noon = replace(
        yard,
        start_ns=int(np.datetime64("2017-08-30T03:00", "ns").astype(np.int64)),
        beds=(yard.beds[0], replace(yard.beds[1], tilt_deg=20.0, azimuth_deg=180.0)),
    )
    found = last_of(noon, noon.samples(21)).estimates[0]
    assert found.state == SlopeState.NOT_RESOLVED
    assert found.flags & Quality.UNRESOLVED
    assert found.second_tilt_deg == pytest.approx(33.0, abs=0.5)


@pytest.mark.parametrize("flag", [Quality.SHUTTER, Quality.SATURATED])
def test_flagged_pictures_are_held_out_but_not_forgotten(yard, flag):
    samples = yard.samples(21)
    hot = np.full((60, 80), 65000, np.uint16)
    spoilt = [
        s._replace(counts=hot, quality=flag) if isinstance(s, Frame) and i % 17 == 0 else s
        for i, s in enumerate(samples)
    ]
    with_them, without = (history_of(yard, one) for one in (spoilt, [s for s in spoilt if not s.quality]))
    assert (with_them.flags & flag).any()
    assert with_them.temperature_k.tobytes() == without.temperature_k.tobytes()


def test_overrange_light_is_no_light(yard):
    minute = last_of(yard, with_readings(yard, 21, lambda s: s._replace(quality=Quality.OVERRANGE)))
    assert minute.estimates[0].state == SlopeState.NO_DATA
    assert "irradiance" in minute.estimates[0].reason
    assert np.isnan(minute.dni_w_m2)
    assert minute.flags & Quality.OVERRANGE


def test_level_pyranometer_gives_the_slopes_that_a_light_meter_gives(yard):
    """Taken for direct irradiance, its readings made a bed of 15 degrees steeper than 45."""
    whole = StreamInfo("whole", "irradiance", "W m-2", (1,), measures=("ghi",))
    lux_per_w_m2 = 0.44 * 4.57 * 54.0
    samples = with_readings(
        yard, 21, lambda s: Reading("whole", s.mono_ns, s.time_ns, (s.values[0] / lux_per_w_m2,))
    )
    minute = last_of(replace(yard, streams=(yard.streams[0], whole)), samples)
    assert minute.dni_w_m2 == pytest.approx(800.0, rel=1e-3)
    assert minute.irradiance_model.split(", ") == ["pyranometer", "diffuse 15%", "horizontal"]
    by_lux = last_of(yard, yard.samples(21))
    for one, other in zip(minute.estimates, by_lux.estimates, strict=True):
        assert one.tilt_deg == pytest.approx(other.tilt_deg, abs=1e-6)


def test_cloud_holds_the_estimate_and_tells_when_it_began_and_ended(yard):
    clouded = replace(yard, clouds=range(25, 31), noise_k=0.02)
    minutes = run(clouded, clouded.samples(50))
    before, during = minutes[24].estimates[0], minutes[28].estimates[0]
    assert during.state == SlopeState.HELD_CLOUD
    assert during.tilt_deg == before.tilt_deg
    assert "unsteady" in during.reason
    events = [event for minute in minutes for event in minute.events if event.kind == EventKind.CLOUD]
    assert [event.data["phase"] for event in events] == ["begin", "end"]
    start = clouded.start_ns + 25 * MINUTE_NS
    assert events[0].time_ns == start + 1
    assert events[0].mono_ns == start + 8
    assert events[0].stream == "lux"
    assert events[1].time_ns >= clouded.start_ns + 31 * MINUTE_NS
    assert all(minute.flags & Quality.CLOUD for minute in minutes[25:41])
    assert not minutes[-1].flags & Quality.CLOUD
    last = by_name(minutes[-1])["b08"]
    assert last.state != SlopeState.HELD_CLOUD
    assert off_deg(last, 8.0, 140.0) < 2.0


def test_shadow_on_one_bed_is_told_from_a_cloud(yard):
    shady = replace(yard, shade={"b17": range(30, 38)}, noise_k=0.03)
    minutes = run(shady, shady.samples(50))
    for minute in minutes[31:37]:
        assert by_name(minute)["b17"].state == SlopeState.SHADED
        assert by_name(minute)["b08"].state != SlopeState.SHADED
        assert not minute.flags & Quality.CLOUD
    assert by_name(minutes[34])["b17"].tilt_deg == by_name(minutes[29])["b17"].tilt_deg
    assert by_name(minutes[45])["b17"].state != SlopeState.SHADED


def test_regions_follow_a_camera_that_moved(yard):
    samples = replace(yard, noise_k=0.05).samples(12)
    shifted = with_frames(yard, samples, lambda counts, _: np.roll(counts, (3, 2), (0, 1)), after_min=6)
    minutes, still = measured(yard, shifted), measured(yard, samples)
    (event,) = (event for minute in minutes for event in minute.events if event.kind == EventKind.MOVED)
    assert event.data["shift_px"] == pytest.approx(np.hypot(3.0, 2.0), abs=0.1)
    assert not any(minute.flags & Quality.MOVED for minute in minutes)
    for minute, same in zip(minutes, still, strict=True):
        assert minute.temperature_k == same.temperature_k  # the very pixels that were drawn


@pytest.mark.parametrize(
    ("model", "to_deg"),
    [("learned", 0.05), ("full", 1e-6)],  # `learned` predicts through them, at the times of their frames
)
def test_minutes_in_which_regions_are_lost_change_no_slope(yard, model, to_deg):
    samples = replace(yard, noise_k=0.05).samples(30)
    moved = range(12, 20)
    kicked_ns = yard.start_ns + 12 * MINUTE_NS + SECOND_NS // 2  # between the two frames of a minute

    def is_of_moved(s):
        return isinstance(s, Frame) and (s.time_ns - yard.start_ns) // MINUTE_NS in moved

    def kicked(s):
        return s._replace(counts=np.roll(s.counts, (10, 30), (0, 1)))

    shifted = [kicked(s) if is_of_moved(s) and s.time_ns >= kicked_ns else s for s in samples]
    settings = EstimatorSettings(model=model, azimuth="known")
    minutes = measured(yard, shifted)
    found = by_name(last_of(yard, shifted, settings))
    expected = by_name(last_of(yard, [s for s in samples if not is_of_moved(s)], settings))
    assert [n for n, minute in enumerate(minutes) if minute.flags & Quality.MOVED] == list(moved)
    phases = [one.data["phase"] for minute in minutes for one in minute.events if one.kind is EventKind.MOVED]
    assert phases == ["lost", "corrected"]
    for name, slope in found.items():
        assert slope.tilt_deg == pytest.approx(expected[name].tilt_deg, abs=to_deg)


def test_frozen_picture_is_seen_without_the_drivers_help(yard):
    samples = replace(yard, noise_k=0.05).samples(12)
    first = next(s for s in samples if isinstance(s, Frame))
    minutes = measured(yard, with_frames(yard, samples, lambda *_: first.counts, after_min=5))
    assert [bool(minute.flags & Quality.FROZEN) for minute in minutes] == [False] * 6 + [True] * 6


def test_late_samples_are_left_out_and_counted(yard):
    samples = yard.samples(6)
    late = samples.pop(3)
    minutes = measured(yard, [*samples, late])
    assert minutes[-1].time_ns == measured(yard, samples)[-1].time_ns
    (event,) = (event for m in measured(yard, [*samples[:-8], late, *samples[-8:]]) for event in m.events)
    assert event.data == {"excluded": 1}


def test_a_last_minute_without_pictures_keeps_the_kelvin_per_degree(yard):
    samples = yard.samples(20)
    last_ns = yard.start_ns + 19 * MINUTE_NS
    cut = [sample for sample in samples if not (isinstance(sample, Frame) and sample.time_ns >= last_ns)]
    before, without = run(yard, cut)[-2:]
    for one, other in zip(without.estimates, before.estimates, strict=True):
        assert one.kelvin_per_degree == pytest.approx(other.kelvin_per_degree, rel=0.05)


def test_window_reaches_back_over_a_passing_cloud_to_the_start(yard):
    clouded = replace(yard, clouds=range(20, 24), noise_k=0.02)
    last = last_of(clouded, clouded.samples(50)).estimates[0]
    assert last.window_start_ns < clouded.start_ns + MINUTE_NS
    assert off_deg(last, 8.0, 140.0) < 1.0


def test_window_is_halved_until_one_slope_explains_it(yard):
    """A bed turned over after 40 minutes: the minutes before carry no information about it."""
    turned = replace(yard, beds=(yard.beds[0], replace(yard.beds[1], tilt_deg=20.0)))
    before = replace(yard, beds=yard.beds[:2]).samples(40)
    after = [sample for sample in turned.samples(80) if sample.time_ns >= yard.start_ns + 40 * MINUTE_NS]
    last = last_of(turned, [*before, *after], EstimatorSettings(model="paper", azimuth="known")).estimates[0]
    assert last.tilt_deg == pytest.approx(20.0, abs=0.3)
    assert last.window_start_ns >= yard.start_ns + 40 * MINUTE_NS


def drifting(yard, beds):
    """Slopes at the last 45 of 105 minutes, in which beds grow warmer by 2 K an hour from the 70th on."""
    mask = np.any([bed.mask((60, 80)) for bed in beds], axis=0)
    samples = replace(yard, noise_k=0.05).samples(105)
    samples = with_frames(
        yard, samples, lambda counts, m: counts + mask * round(m / 60.0 * 200), after_min=70
    )
    history, chain = history_of(yard, samples), SlopeChain(yard.beds, EstimatorSettings(model="paper"))
    estimated = (chain.at(history.until(last)) for last in range(60, 106))
    return [{slope.region: slope for slope in minute.slopes} for minute in estimated]


def test_a_region_that_alone_drifts_is_named_and_the_others_go_on(yard):
    """One bed grows warmer by 2 K an hour from the 70th minute on: seen within half an hour."""
    minutes = drifting(yard, yard.beds[2:3])
    drifts = [slopes["b17"] for slopes in minutes if "alone deviates" in slopes["b17"].reason]
    assert yard.start_ns + 70 * MINUTE_NS < drifts[0].time_ns <= yard.start_ns + 101 * MINUTE_NS
    assert drifts[0].state == SlopeState.NO_INTERSECTION
    assert "+0.5 K" in drifts[0].reason or "+0.6 K" in drifts[0].reason
    for slopes in minutes:
        assert "alone deviates" not in slopes["b08"].reason + slopes["b25"].reason


def test_no_drift_is_reported_where_all_regions_drift_together(yard):
    """The same drift on every bed is the reference's or the camera's, not one region's."""
    reasons = [slope.reason for slopes in drifting(yard, yard.beds[1:]) for slope in slopes.values()]
    assert not any("alone deviates" in reason for reason in reasons)
