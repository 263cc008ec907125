"""What two recorders took side by side becomes one session: as good as if one of them had taken it all."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import fieldkit
from fieldkit.model.errors import ConfigError, FormatError, NoAnswerError
from fieldkit.model.marks import Mark, mark_event
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import EventKind
from fieldkit.results.importing import ImportOptions, import_into, import_recording
from fieldkit.sessions.formats.imported import StampedClock
from fieldkit.sessions.formats.merged import is_session
from fieldkit.sessions.writer import SessionWriter
from tests.harness.next_steps import at

BEHIND_S = 83.4
"""How much the clock of the second recorder was slow."""


def part(session, path: Path, streams, *, behind_s=0.0, marks=(), samples=slice(None), **header) -> Path:
    """A session of some streams of another one, as a recorder took it whose clock was slow."""
    behind_ns, infos = round(behind_s * 1e9), tuple(session.streams[name] for name in streams)
    first_ns = session.start_ns - behind_ns
    clock = StampedClock(first_ns)
    writer = SessionWriter(path, replace(session.header, streams=infos, **header), clock)
    for text, after_s in marks:
        time_ns = first_ns + round(after_s * 1e9)
        writer.put(mark_event(Mark(text), time_ns, time_ns))
    for sample in list(session.samples(*streams))[samples]:
        time_ns = sample.time_ns - behind_ns
        writer.append(sample._replace(time_ns=time_ns, mono_ns=time_ns))
        clock.now_ns = time_ns
    writer.close()
    return path


@pytest.fixture
def whole(sessions):
    with fieldkit.open_session(sessions[0]) as session:
        yield session


def slopes_of(session) -> dict[str, float]:
    return {name: slope.tilt_deg for name, slope in session.estimate(model="full").final.items()}


@pytest.mark.parametrize(
    ("first", "second", "behind_s", "options"),
    [
        (["camera", "lux"], ["lux", "thermometer"], BEHIND_S, {}),  # the same light
        (["camera"], ["lux", "thermometer"], -BEHIND_S, {"offset_s": -BEHIND_S}),
        (["camera", "thermometer"], ["lux"], BEHIND_S, {"name": "light"}),  # by marks
        (["lux"], ["camera", "thermometer"], 3600.0, {}),  # the regions come with the camera
    ],
    ids=["light", "stated", "marks", "camera"],
)
def test_what_two_recorders_took_is_as_if_one_had(whole, tmp_path, first, second, behind_s, options):
    marks = [("sync", 60.0), ("Sync 2", 120.0)]
    own = part(whole, tmp_path / "a.h5", first, marks=marks)
    their = part(whole, tmp_path / "b.h5", second, behind_s=behind_s, marks=[*marks, ("rain", 200.0)])
    made = import_into(own, their, options=ImportOptions(**options))
    assert made.path == tmp_path / "a-with-b.h5"
    with made.open() as joined:
        (event,) = (event for event in joined.events() if event.kind is EventKind.IMPORTED)
        assert event.data["offset_s"] == pytest.approx(behind_s, abs=2.0)
        names = {name: name for name in whole.streams} | ({"lux": "light"} if "name" in options else {})
        assert set(names.values()) <= {*joined.streams}
        for name, new in names.items():
            np.testing.assert_allclose(joined.times_ns(new), whole.times_ns(name), rtol=0, atol=2e9)
        assert [region.name for region in joined.regions] == [region.name for region in whole.regions]
        np.testing.assert_allclose(
            joined["camera"].region_series().mean_k, whole["camera"].region_series().mean_k, atol=0.01
        )
        assert slopes_of(joined) == pytest.approx(slopes_of(whole), abs=0.05)
        assert "rain" in [mark.text for mark in joined.marks().values()]
        assert any(str(finding.text).count("clock offset") for finding in fieldkit.check(joined).findings)


def test_equal_names_get_numbers_and_regions_stay_in_their_camera(whole, tmp_path):
    marks = [("sync", 60.0), ("shade-test b15", 90.0)]
    own = part(whole, tmp_path / "a.h5", ["camera", "lux"], marks=marks[:1])
    their = part(whole, tmp_path / "b.h5", ["camera"], behind_s=BEHIND_S, marks=marks)
    with import_into(own, their).open() as joined:
        cameras = {region.name: region.camera for region in joined.regions}
        assert cameras == dict.fromkeys(("flat", "b05", "b15", "b25"), "") | dict.fromkeys(
            ("flat-2", "b05-2", "b15-2", "b25-2"), "camera-2"
        )
        assert joined.marks()[3].data["shade_test"] == "b15-2"
        first, second = (joined[name].region_series() for name in ("camera", "camera-2"))
        np.testing.assert_array_equal(first.mean_k, second.mean_k)
        slopes = slopes_of(joined)
        assert slopes["b25-2"] == pytest.approx(slopes["b25"], abs=0.05)


def test_a_longer_session_joins_whole(whole, tmp_path):
    """One that began before the other, and ended after it."""
    middle = part(whole, tmp_path / "a.h5", ["lux"], samples=slice(40, 120))
    around = part(whole, tmp_path / "b.h5", ["camera", "thermometer"])
    with import_into(middle, around, options=ImportOptions(offset_s=0.0)).open() as joined:
        np.testing.assert_array_equal(joined.times_ns("camera"), whole.times_ns("camera"))
        assert slopes_of(joined).keys() == slopes_of(whole).keys()


def test_no_session_joins_itself_or_what_it_is_a_part_of(whole, tmp_path):
    options = ImportOptions(offset_s=0.0)
    first, second = (part(whole, tmp_path / f"{name}.h5", [name]) for name in ("lux", "thermometer"))
    both = import_into(first, second, options=options).path
    for own, their in ((first, first), (both, first), (both, second), (second, both)):
        with pytest.raises(ConfigError, check=at(their)):
            import_into(own, their, tmp_path / "new.h5", options)
    assert not (tmp_path / "new.h5").exists()


@pytest.mark.parametrize(
    ("session", "options", "error", "steps"),
    [
        ({"site": fieldkit.Site(10.0, 20.0)}, {"offset_s": 0.0}, ConfigError, []),
        ({}, {}, NoAnswerError, [Argument("offset_s", 12)]),
        ({"marks": [("rain", 60.0)]}, {"offset_s": "auto"}, NoAnswerError, [Argument("offset_s", 12)]),
        ({}, {"offset_s": 1e6}, ConfigError, [Argument("offset_s")]),
        ({}, {"zone": "UTC", "offset_s": 0.0}, ConfigError, [Argument("zone")]),
    ],
    ids=["another site", "nothing in common", "other marks", "no overlap", "useless option"],
)
def test_what_cannot_be_joined_is_refused(whole, tmp_path, session, options, error, steps):
    own = part(whole, tmp_path / "a.h5", ["camera", "lux"], marks=[("sync", 60.0)])
    their = part(whole, tmp_path / "b.h5", ["thermometer"], **session)
    with pytest.raises(error, check=at(their, *steps)):
        import_into(own, their, options=ImportOptions(**options))
    assert not (tmp_path / "a-with-b.h5").exists()


def test_marks_that_contradict_the_light_are_not_believed(whole, tmp_path):
    own = part(whole, tmp_path / "a.h5", ["camera", "lux"], marks=[("sync", 60.0)])
    their = part(whole, tmp_path / "b.h5", ["lux"], behind_s=BEHIND_S, marks=[("sync", 200.0)])
    with pytest.raises(NoAnswerError, check=at(their, Argument("offset_s", 12))):
        import_into(own, their)


@pytest.mark.parametrize("version", ["1.3", "3.0"])
def test_a_session_of_another_format_is_refused(whole, tmp_path, version):
    own, their = (part(whole, tmp_path / f"{name}.h5", [name]) for name in ("lux", "thermometer"))
    with h5py.File(their, "r+") as file:
        file.attrs["fieldkit_format_version"] = version
    with pytest.raises(FormatError, check=at(their)):
        import_into(own, their, options=ImportOptions(offset_s=0.0))


def test_other_files_of_hdf5_are_no_sessions(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    assert not is_session(tmp_path / "other.h5")
    (tmp_path / "other.h5").write_bytes((tmp_path / "other.h5").read_bytes()[:600])
    assert is_session(tmp_path / "other.h5")  # damaged, which its reader tells


def test_a_session_alone_needs_no_import(whole):
    with pytest.raises(ConfigError, check=at(whole.path, Action.IMPORT_INTO(whole.path))):
        import_recording(whole.path)
