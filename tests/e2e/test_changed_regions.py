"""Regions that are added, redrawn and removed while a simulated field is recorded."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fieldkit
from fieldkit.config import Config, load_config
from fieldkit.estimation.estimator import Minute
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind, Health, Severity
from fieldkit.model.site import Region, RegionKind, RegionRecord
from fieldkit.model.slope import SlopeEstimate
from fieldkit.recording.opening import open_instruments
from fieldkit.recording.record import PreparedRecording
from fieldkit.recording.redrawing import NewRegions
from fieldkit.recording.replay import replay
from fieldkit.recording.request_reader import recover_session
from fieldkit.recording.requests import Acknowledgement, Request, Shutter, inbox, send
from fieldkit.results.session import open_session
from fieldkit.sessions.lock import journal_path
from tests.harness.command_line import succeed

SAME_DEG = 1e-9
ANGLES = ("tilt_deg", "azimuth_deg", "tilt_low_deg", "tilt_high_deg", "azimuth_low_deg", "azimuth_high_deg")
Estimates = dict[tuple[int, str], SlopeEstimate]


class Operator:
    """Sends requests at seconds of a recording, sees its minutes, and interrupts it if asked to."""

    def __init__(self, session: Path, plan: Mapping[int, Sequence[Request]], ends_at: int | None = None):
        self.session, self.plan, self.ends_at = session, plan, ends_at
        self.seconds = 0
        self.ids: list[str] = []
        self.minutes: list[Minute] = []
        self.records: list[RegionRecord] = []

    def show(self, item: object) -> None:
        if isinstance(item, Minute):
            self.minutes.append(item)
        elif isinstance(item, RegionRecord):
            self.records.append(item)
        elif isinstance(item, Health):
            self.seconds += 1
            self.ids += [send(inbox(self.session), one) for one in self.plan.get(self.seconds, ())]
            if self.seconds == self.ends_at:
                raise KeyboardInterrupt

    def close(self) -> None:
        """Nothing is held."""

    @property
    def estimates(self) -> Estimates:
        return by_minute(one for minute in self.minutes for one in minute.estimates)


def by_minute(estimates: Iterator[SlopeEstimate]) -> Estimates:
    return {(one.time_ns // 1000, one.region): one for one in estimates}  # stored to the microsecond


def same(found: Estimates, live: Estimates) -> None:
    """Every live estimate is found again, to 1e-9 degrees, in the same state and for the same reason."""
    assert live
    for key, one in live.items():
        other = found[key]
        assert (other.state, other.reason, other.n_bins) == (one.state, one.reason, one.n_bins)
        for name in ANGLES:
            assert getattr(other, name) == pytest.approx(getattr(one, name), abs=SAME_DEG, nan_ok=True)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("changed") / "sand"
    succeed("init", "--simulated", folder)
    return folder


def config_of(campaign: Path, model: str = "full") -> Config:
    settings = ["simulation.speed=max", f'estimator.model="{model}"']
    return load_config(campaign / "fieldkit.toml", settings=settings)


def record(config: Config, path: Path, operator: Operator, seconds: float) -> Operator:
    with open_instruments(config, duration_s=seconds) as tools:
        PreparedRecording(config, tools, path, duration_s=seconds).run([operator])
    return operator


def halves(region: Region) -> tuple[Region, Region]:
    """The upper half of a bed under another name, and the lower half under its own."""
    (left, top), (right, bottom) = (f(np.array(region.points_px), axis=0).tolist() for f in (np.min, np.max))
    middle = (top + bottom) // 2
    upper = ((left, top), (right, top), (right, middle - 1), (left, middle - 1))
    lower = ((left, middle + 1), (right, middle + 1), (right, bottom), (left, bottom))
    return replace(region, name="upper", points_px=upper), replace(region, points_px=lower)


Drawn = tuple[Region, ...]


@pytest.fixture(scope="module")
def drawn(campaign):
    """Lists of regions: as at first, with b05 halved, without b15, with a region that overlaps another."""
    first = config_of(campaign).regions
    upper, lower = halves(next(one for one in first if one.name == "b05"))
    halved = (*(lower if one.name == "b05" else one for one in first), upper)
    without = tuple(one for one in halved if one.name != "b15")
    return {
        "first": first, "halved": halved, "without": without, "bad": (*without, replace(upper, name="bad"))
    }  # fmt: skip


def plan(drawn: dict[str, Drawn]) -> dict[int, list[Request]]:
    """Halved in minute 6; in minute 11 b15 is removed, drawn again and removed; then what is refused."""
    halved, without = NewRegions.of(drawn["halved"]), NewRegions.of(drawn["without"])
    return {
        400: [halved],
        420: [Shutter()],
        700: [halved, without],
        705: [halved],
        710: [without],
        800: [NewRegions.of(drawn["bad"]), Acknowledgement("frozen-camera")],
    }


@pytest.fixture(scope="module")
def recorded(campaign, drawn):
    path = campaign / "recordings" / "changed.h5"
    return record(config_of(campaign), path, Operator(path, plan(drawn)), 900.0)


def events_of(operator: Operator) -> dict[str, Event]:
    """The event that answers each request."""
    with open_session(operator.session) as session:
        answers = {str(event.data["request"]): event for event in session.events() if "request" in event.data}
    assert set(answers) == set(operator.ids)
    return answers


def test_stored_replayed_and_estimated_again_the_slopes_are_those_of_the_recording(recorded):
    live = recorded.estimates
    assert {name for _, name in live} == {"b05", "b15", "b25", "upper"}
    with open_session(recorded.session) as session:
        stored = by_minute(iter(session.estimates()))
    again = by_minute(one for minute in replay(recorded.session).minutes for one in minute.estimates)
    estimated = by_minute(iter(fieldkit.estimate(recorded.session)))
    for found in (stored, again, estimated):
        assert set(found) == set(live)
        same(found, live)
    findings = fieldkit.check(recorded.session).findings
    assert {(one.level, one.what) for one in findings if one.what == "slopes"} == {("ok", "slopes")}
    assert not [one for one in findings if one.level == "FAIL"]


def minutes_with(operator: Operator, region: str) -> list[int]:
    return [number for number, one in enumerate(operator.minutes) if region in one.temperature_k]


def test_a_region_holds_from_the_next_full_minute_until_it_is_removed(recorded):
    count = len(recorded.minutes)
    assert minutes_with(recorded, "upper") == list(range(7, count))
    assert minutes_with(recorded, "b15") == list(range(12))
    assert minutes_with(recorded, "b05") == minutes_with(recorded, "b25") == list(range(count))
    pixels = [minute.pixels["b05"] for minute in recorded.minutes]
    assert pixels[0] == pixels[6] > pixels[7] == pixels[-1]


def test_a_redrawn_target_begins_anew_and_the_others_go_on(recorded):
    after = {one.region: one for one in recorded.minutes[8].estimates}
    assert "redrawn" in after["b05"].reason
    assert after["b25"].n_bins == 9


def test_every_request_is_answered_by_an_event_with_its_id(recorded):
    answers = [events_of(recorded)[one] for one in recorded.ids]
    halved, shutter, unchanged, *changes = answers[:6]
    assert (halved.data["changed"], halved.data["added"]) == (["b05"], ["upper"])
    assert "12:07" in halved.text
    assert (shutter.kind, shutter.stream) == (EventKind.SHUTTER, "camera")
    assert unchanged.text.startswith("regions unchanged")
    changed_names = [(event.data.get("removed"), event.data.get("added")) for event in changes]
    assert changed_names == [(["b15"], None), (None, ["b15"]), (["b15"], None)]
    assert answers[7].data["acknowledge"] == "frozen-camera"


def test_a_region_that_shares_pixels_is_refused_and_nothing_changes(recorded):
    refusal = events_of(recorded)[recorded.ids[6]]
    assert (refusal.kind, refusal.severity) == (EventKind.REGION, Severity.WARNING)
    assert refusal.text.startswith("regions not changed: bad: shares ")
    assert "bad" not in {record.region.name for record in recorded.records}


def test_tables_maps_and_reports_hold_each_region_where_it_held(recorded):
    with fieldkit.open_session(recorded.session) as session:
        series = session["camera"].region_series()
        minute = (series.time_ns // 60_000_000_000) - (session.start_ns // 60_000_000_000)
        known = dict(zip(series.regions, np.isfinite(series.mean_k).T, strict=True))
        assert (known["upper"] == (minute >= 7)).all()
        assert (known["b15"] == (minute < 12)).all()
        table = session.estimate().to_xarray()
        assert int(np.isfinite(table.temperature_k.sel(region="b15")).sum()) == 12
        mapped = session.slope_map("all")
        assert {one.name for one in mapped.regions} == {"flat", "b05", "b25", "upper"}
        assert session.report().path.stat().st_size > 0


def test_regions_drawn_afterwards_hold_for_all_of_a_session(recorded, drawn):
    before = recorded.session.read_bytes()
    found = fieldkit.estimate(recorded.session, regions=drawn["first"])
    as_drawn = {bed.name for bed in drawn["first"] if bed.kind is RegionKind.TARGET}
    assert set(found.final) == as_drawn
    assert len(found) == len(as_drawn) * len(recorded.minutes)
    same(by_minute(iter(found)), by_minute(iter(recorded.minutes[6].estimates)))
    with pytest.raises(ConfigError, match="bad: shares"):
        fieldkit.estimate(recorded.session, regions=drawn["bad"])
    assert recorded.session.read_bytes() == before


def interrupted(config: Config, path: Path, plan: dict[int, list[Request]]) -> Operator:
    """A recording that ends without sealing after 15 minutes."""
    operator = Operator(path, plan, ends_at=900)
    with pytest.raises(KeyboardInterrupt):
        record(config, path, operator, 1200.0)
    return operator


@pytest.mark.parametrize("lost", [pytest.param("nothing", marks=pytest.mark.slow), "file"])
def test_after_recovery_the_slopes_are_those_of_the_recording(campaign, drawn, lost):
    path = campaign / "recordings" / f"interrupted-{lost}.h5"
    operator = interrupted(config_of(campaign), path, plan(drawn))
    if lost == "file":
        path.unlink()
    recover_session(path)
    assert not journal_path(path).exists()
    with open_session(path) as session:
        same(by_minute(iter(session.estimates())), operator.estimates)
    same(by_minute(iter(fieldkit.estimate(path))), operator.estimates)


def test_a_reference_that_is_redrawn_makes_all_learn_anew(campaign, drawn):
    _, lower = halves(drawn["first"][0])
    assert lower.kind is RegionKind.REFERENCE
    path = campaign / "recordings" / "reference.h5"
    operator = Operator(path, {250: [NewRegions.of((lower, *drawn["first"][1:]))]})
    record(config_of(campaign, "learned"), path, operator, 480.0)
    same(by_minute(iter(fieldkit.estimate(path))), operator.estimates)
    beds = operator.minutes[6].estimates
    assert len(beds) == 3
    assert all("reference was redrawn" in bed.reason for bed in beds)


def test_a_slope_measured_afterwards_changes_no_estimate(campaign, drawn):
    measured = tuple(replace(bed, tilt_deg=14.2) if bed.name == "b15" else bed for bed in drawn["first"])
    path = campaign / "recordings" / "measured.h5"
    operator = record(config_of(campaign), path, Operator(path, {250: [NewRegions.of(measured)]}), 480.0)
    assert {bed.region: bed.n_bins for bed in operator.minutes[6].estimates} == {"b05": 7, "b15": 7, "b25": 7}
    with open_session(path) as session:
        assert {region.name: region.tilt_deg for region in session.regions}["b15"] == 14.2
