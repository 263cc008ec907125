"""What is no session, or means harm, is refused, with little memory; a session tells its state."""

import os
import shutil
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.learnt import Learnt
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Quality
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.results.session import open_session
from fieldkit.results.session import open_session as open_whole_session
from fieldkit.sessions.check import check
from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.layout import MAX_LEARNT
from fieldkit.sessions.lock import SessionLock, journal_path
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.records import MinuteRecord
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.seal import SealReport, seal
from fieldkit.sessions.writer import SessionWriter
from tests.harness.learnt import learnt
from tests.harness.next_steps import at, steps
from tests.harness.recording import START_NS, CountedClock, fill, header, recorded, sample, session_of


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    path = tmp_path_factory.mktemp("sealed") / "field.h5"
    recorded(path, header((24, 32)), 10)
    return path


@pytest.fixture
def path(sealed, tmp_path):
    return Path(shutil.copy(sealed, tmp_path))


def test_missing_file_and_folder_are_named(tmp_path):
    with pytest.raises(SessionError, match=r"nowhere\.h5"):
        open_session(tmp_path / "nowhere.h5")
    with pytest.raises(SessionError, match="directory") as caught:
        open_session(tmp_path)
    assert caught.value.fix
    with pytest.raises(SessionError, match="directory"):
        open_session(".")


def test_a_recording_that_has_just_begun_is_waited_for(path, tmp_path):
    """Its lock is there up to a second before its file can be read."""
    begun = tmp_path / "begun.h5"
    journal_path(begun).mkdir()
    lock = SessionLock(journal_path(begun))
    begun.write_bytes(b"")
    later = threading.Timer(0.2, shutil.copyfile, (path, begun))
    later.start()
    with open_session(begun) as session:
        assert session.count("camera")
    later.join()
    begun.unlink()
    os.utime(journal_path(begun) / "lock", (0, 0))  # a file that was deleted since
    with pytest.raises(SessionError, match=begun.name):
        open_session(begun)
    lock.release()


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("config/packages", lambda session: session.provenance),
        ("time_map/add_ns", lambda session: session.time_map()),
    ],
)
def test_what_another_program_took_from_a_header_is_named_with_the_next_step(path, name, read):
    with h5py.File(path, "r+") as file:
        del file[name]
    with open_session(path) as session, pytest.raises(SessionError, match=r"field\.h5 is damaged") as error:
        read(session)
    assert [step.action for step in steps(error.value)] == [Action.RECOVER]


def test_other_hdf5_files_are_refused(tmp_path):
    for name, libver in (("old.h5", "earliest"), ("new.h5", LIBVER)):
        with h5py.File(tmp_path / name, "w", libver=libver) as file:
            file["numbers"] = np.arange(10)
        with pytest.raises(SessionError, match=f"{name}: "):
            open_session(tmp_path / name)


def test_a_stream_that_is_not_there_or_cannot_do_it_is_refused_by_name(path):
    with open_session(path) as session:
        with pytest.raises(SessionError, match="no stream 'nothing'") as caught:
            session["nothing"]
        assert all(name in str(caught.value.fix) for name in session.streams)
        with pytest.raises(SessionError, check=at("camera")):
            session["camera"].readings()
        with pytest.raises(SessionError, check=at(path)) as caught:
            session["lux"].kelvin()
        assert "'lux'" in caught.value.message
        assert "camera" in str(caught.value.fix)


ARGUMENTS = {
    "stream": "camera", "camera": "camera", "meter": "lux", "path": "config/header", "to": "csv", "end": 9,
    "row": 0, "box": (slice(1), slice(1)), "step": 1, "with_rows": False, "mark": 1,
}  # fmt: skip
VAR_ARGS, VAR_NAMES = Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD
OPEN_OR_NOT = {"close", "is_closed", "name", "config_toml", "damaged", "info", "frame_datasets", "tables"}
"""What does not need the file; the last are objects of h5py, which closed with it."""
CLOSED = r"field\.h5: closed\n  fix: open it again: fieldkit\.open_session|is (not )?a camera"


def read(of: object, name: str) -> None:
    """Read a property, or call a method with whatever it needs and go through all that it returns."""
    found = getattr(of, name)
    if callable(found):
        known = {**ARGUMENTS, "name": "seq" if name == "column" else "lux" if name == "stream" else "events"}
        asked = [one for one in signature(found).parameters.values() if one.kind not in (VAR_ARGS, VAR_NAMES)]
        needed = [one.name for one in asked if one.default is one.empty]
        found = found(**{one: known[one] for one in needed})
        list(found if isinstance(found, Iterator) else ())


def test_every_method_of_a_closed_session_states_that_it_is_closed(path):
    with open_whole_session(path) as session:
        objects = [session, *(found for name in session for found in (session[name], session.stream(name)))]
    for of in objects:
        names = {name for name in dir(of) if not name.startswith("_") and hasattr(type(of), name)}
        for name in sorted(names - OPEN_OR_NOT):
            with pytest.raises(SessionError, match=CLOSED):
                read(of, name)


def test_a_closed_session_can_be_shown(path):
    with open_whole_session(path) as session:
        camera = session["camera"]
    assert (repr(session), session._repr_html_()) == ("<Session field: closed>", None)
    assert repr(camera).startswith("<Stream camera: closed, ")


def test_session_closed_while_its_samples_are_read_is_not_damaged(path):
    with open_session(path) as session:
        samples = session.samples("camera")
        next(samples)
    with pytest.raises(SessionError, match=": closed"):
        list(samples)
    assert session.damaged == {}


def test_a_row_that_only_some_columns_have_is_not_read(path):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        file["camera/seq"].resize((11,))
    with open_session(path) as session:
        assert len(session.stream("camera")) == 10


def test_the_window_of_an_estimate_begins_when_it_began(tmp_path):
    head, began_ns = header((24, 32)), START_NS - 1_200_000_000_000
    slope = SlopeEstimate(START_NS, "b05", SlopeState.OK, 5.0, 180.0, window_start_ns=began_ns)
    minute = MinuteRecord(START_NS, (slope,), 800.0, "clear sky")
    with open_session(session_of(tmp_path / "field.h5", head, sample(head.streams[0], 0), minute)) as session:
        assert [one.window_start_ns for one in session.estimates()] == [began_ns]


def in_session(found: Learnt) -> Learnt:
    """What a session of the regions flat and b05 keeps of what was learnt."""
    by_region = {"flat": 0.5}
    return replace(found, residual_k=by_region, autocorrelation=by_region)


@pytest.mark.parametrize("how", ["sealed", "recovered"])
def test_what_was_learnt_comes_back_minute_by_minute(tmp_path, how):
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "field.h5", header((24, 32)), clock)
    fill(writer, 2, clock)
    start_ns = clock.to_utc_ns(clock.mono_ns()) // 1000 * 1000
    expected = {start_ns + n: in_session(learnt(n // 50)) for n in (0, 1000, 2000)}
    writer.put(MinuteRecord(start_ns - 1000, ()))
    for time_ns, found in expected.items():
        writer.put(MinuteRecord(time_ns, (), learnt=found))
    if how == "sealed":
        writer.close()
    else:
        writer.abandon()
        recover(tmp_path / "field.h5")
    with open_session(tmp_path / "field.h5") as session:
        assert session.state == how
        assert session.learnt() == expected
        assert [minute.learnt for minute in session.minutes()] == [None, *expected.values()]


def test_more_parameters_than_a_row_holds_are_cut_and_end_no_recording(tmp_path):
    head = header((24, 32))
    many = replace(learnt(), parameters=learnt().parameters * 2, residual_k={"elsewhere": 1.0})
    minute = MinuteRecord(START_NS, (), learnt=many)
    with open_session(session_of(tmp_path / "field.h5", head, sample(head.streams[0], 0), minute)) as session:
        (found,) = session.learnt().values()
    assert found.parameters == many.parameters[:MAX_LEARNT]
    assert found.residual_k == {}


def _without(name: str) -> Callable[[h5py.File], None]:
    """What removes an object."""
    return lambda file: file.__delitem__(name)


def _soft_link(file: h5py.File) -> None:
    del file["lux/value"]
    file["lux/value"] = h5py.SoftLink("/lux/mono_ns")


def _outside_storage(file: h5py.File) -> None:
    del file["lux/value"]
    file.create_dataset("lux/value", (3,), "<f8", external=[("/etc/passwd", 0, 24)])


def _virtual(file: h5py.File) -> None:
    del file["camera/counts"]
    layout = h5py.VirtualLayout((10, 24, 32), "<u2")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", (10, 24, 32))
    file.create_virtual_dataset("camera/counts", layout)


def _claim_many_rows(file: h5py.File) -> None:
    for name in file["lux"]:
        if file["lux"][name].maxshape[0] is None:
            file["lux"][name].resize(10**12, axis=0)


def _huge_chunks(file: h5py.File) -> None:
    del file["camera/counts"]
    shape = (10, 24, 32)
    file.create_dataset("camera/counts", shape, "<u2", maxshape=(None, 24, 32), chunks=(1_000_000, 24, 32))


def _one_wide_chunk(file: h5py.File) -> None:
    """No side is the first that is larger than a picture's."""
    del file["camera/counts"]
    file.create_dataset("camera/counts", (10, 24, 32), "<u2", maxshape=(None,) * 3, chunks=(9, 1, 30_000_000))


def _table_of_wide_chunks(file: h5py.File) -> None:
    values = file["lux/value"][:]
    del file["lux/value"]
    wide = file.create_dataset(
        "lux/value", values.shape, "<f8", maxshape=(None,), chunks=(10_000_000,), compression="gzip"
    )
    wide[:] = values


def _other_shape(file: h5py.File) -> None:
    del file["camera/counts"]
    file.create_dataset("camera/counts", (10, 24000, 32000), "<u2", chunks=(1, 100, 100))


def _header_is_no_json(file: h5py.File) -> None:
    del file["config/header"]
    file["config/header"] = np.bytes_("{not json")


def _other_session(file: h5py.File) -> str:
    """A whole other session beside this one."""
    beside = Path(file.filename).with_name("beside.h5")
    recorded(beside, header((24, 32)), 10)
    return str(beside)


def _outside(name: str, target: str) -> Callable[[h5py.File], None]:
    """What puts a link into another session in the place of an object."""

    def harm(file: h5py.File) -> None:
        del file[name]
        file[name] = h5py.ExternalLink(_other_session(file), target)

    return harm


def _table_is_a_dataset(file: h5py.File) -> None:
    del file["regions"]
    file["regions"] = np.arange(10)


def _look_at_everything(session: SessionReader) -> None:
    list(session.samples())
    session.entries()
    session.estimates()
    session.sealed_objects()
    assert session.provenance


@pytest.mark.parametrize(
    "harm",
    [
        *(_outside(name, f"/{name}") for name in ("camera", "events", "entry/complete", "entry")),
        *(_outside(name, "/lux/seq") for name in ("time_map/add_ns", "lux/value")),
        *map(_without, ("camera", "config/header", "events", "time_map", "integrity")),
        _table_is_a_dataset, _soft_link, _outside_storage, _virtual,
        _claim_many_rows, _huge_chunks, _one_wide_chunk, _table_of_wide_chunks, _other_shape,
        _header_is_no_json,
    ],
)  # fmt: skip
def test_hostile_session_is_refused_without_much_memory(path, harm):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        harm(file)
    tracemalloc.start()
    try:
        with pytest.raises(SessionError, match=str(path)) as caught, open_session(path) as session:
            _look_at_everything(session)
        assert caught.value.fix
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()


def test_no_new_samples_of_a_stream_are_none_and_no_error(path):
    with open_session(path) as session:
        for name in session.streams:
            assert not list(session.stream(name).samples(2, 2))


def test_session_tells_where_it_came_from(path):
    with open_session(path) as session:
        assert set(session.provenance) >= {"fieldkit_version", "packages", "platform", "command_line"}
        assert session.start_ns < session.end_ns
        with pytest.raises(SessionError, match="no stream 'sonar'"):
            session.count("sonar")


def test_session_is_still_being_recorded_while_it_is_sealed(tmp_path, monkeypatch):
    """To verify a long session takes minutes, and all that time its file is closed and not yet complete."""
    seen: list[object] = []

    def watched(path: Path, *rest: Any) -> SealReport:
        with open_session(path) as session:
            seen.extend([session.state, session.count("camera"), session["camera"].to_xarray().sizes["time"]])
        seen.extend(one.level for one in check(path) if one.what == "state")
        return seal(path, *rest)

    # the moment between complete and sealed is too short to be hit from outside
    monkeypatch.setattr("fieldkit.sessions.writer.seal", watched)
    recorded(tmp_path / "a.h5", header((24, 32)), 20)
    assert seen == ["recording", 20, 20, "warn"]
    with open_session(tmp_path / "a.h5") as session:
        assert session.state == "sealed"


def test_readings_that_cannot_be_are_stored_as_they_came_and_have_no_value(tmp_path):
    """Of a reading only the channel that cannot be is lost; the flag is there on reading."""
    head = header((24, 32))
    values = [(290.0, 291.0, 292.0, 293.0), (290.0, -7725.85, 292.0, 9.9e37)]
    stored = (sample(head.streams[2], seq)._replace(values=one) for seq, one in enumerate(values))
    with open_session(session_of(tmp_path / "a.h5", head, *stored)) as session:
        stored = session.stream("thermometer").column("value")
        readings = session.readings("thermometer")
        again = list(session.samples("thermometer"))
        dataset = session["thermometer"].to_xarray()
        assert np.isnan(dataset["temperature"].values).tolist() == np.isnan(readings.values).tolist()
        assert dataset["flags"].values.tolist() == readings.flags.tolist()
        assert session["thermometer"].to_pandas()["T2 [K]"].isna().tolist() == [False, True]
    assert stored[1].tolist() == [290.0, -7725.85, 292.0, 9.9e37]
    assert np.isnan(readings.values).tolist() == [[False] * 4, [False, True, False, True]]
    assert readings.flags.tolist() == [0, int(Quality.IMPLAUSIBLE)]
    assert [one.quality for one in again] == [Quality.GOOD, Quality.IMPLAUSIBLE]
    assert again[1].values == (290.0, -7725.85, 292.0, 9.9e37)


def test_light_that_the_sun_cannot_give_at_that_height_has_no_value(tmp_path):
    """In Tokyo it is night at 15:06 UTC: BSRN's limit of global light is then 100 W/m2."""
    sun = StreamInfo("sun", "irradiance", "W m-2", (1,), measures=("ghi",), raw_bytes=16)
    readings = (sample(sun, seq)._replace(values=(value,)) for seq, value in enumerate([50.0, 800.0]))
    path = session_of(tmp_path / "a.h5", replace(header((24, 32)), streams=(sun,)), *readings)
    with open_session(path) as session:
        assert session.readings("sun").flags.tolist() == [0, int(Quality.IMPLAUSIBLE)]
        (excess,) = session.stream("sun").excesses()
    assert (excess.count, excess.first, excess.value) == (1, 1, 800.0)
