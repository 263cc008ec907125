"""What fieldkit 0.2 left interrupted is recovered; where its journal is torn, it is left as it is."""

import zipfile
from pathlib import Path

import pytest

from fieldkit.model.errors import RefusedError
from fieldkit.model.samples import EventKind
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from tests.harness.recording import header, same, sample

KEPT = Path(__file__).parents[2] / "data" / "sessions" / "interrupted-0.2.zip"
"""The journal of 40 samples of each of two streams, in three parts, as version 0.2 left it."""
HEADER = header((8, 10))


@pytest.fixture
def path(tmp_path):
    with zipfile.ZipFile(KEPT) as kept:
        kept.extractall(tmp_path)
    return tmp_path / "a.h5"


def content(path: Path) -> dict[str, bytes]:
    return {
        file.name: file.read_bytes() for file in journal_path(path).iterdir() if file.suffix != ".sqlite-shm"
    }


def test_interrupted_session_of_version_0_2_is_recovered(path):
    report = recover(path)
    assert report.counts == {"camera": 40, "lux": 40, "thermometer": 0}
    assert (report.lost, report.end_is_known) == ((), True)
    assert [file.name for file in path.parent.iterdir()] == ["a.h5"]
    with open_session(path) as session:
        for info in HEADER.streams[:2]:
            found = list(session.stream(info.name).samples())
            assert all(same(one, sample(info, seq)) for seq, one in enumerate(found))
        marks = [event.text for event in session.events() if event.kind is EventKind.MARK]
        assert marks == ["mark 3", "mark 23"]
        assert [region.name for region in session.regions] == ["flat", "b05"]


def torn_log(data: bytes) -> bytes:
    place = len(data) // 2
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("000003.sqlite-wal", torn_log),
        ("000002.sqlite-wal", torn_log),
        ("000001.sqlite", lambda data: b""),
        ("000003.sqlite-wal", lambda data: data[:9000]),
    ],
)
def test_torn_journal_of_version_0_2_is_left_as_it_is(path, name, damage):
    file = journal_path(path) / name
    file.write_bytes(damage(file.read_bytes()))  # type: ignore[operator]
    before = content(path)
    with pytest.raises(RefusedError, match=r"torn journal of fieldkit 0\.2") as caught:
        recover(path)
    assert "version 0.2 recovers it" in (caught.value.fix or "")
    after = content(path)
    assert {name: after[name] for name in before} == before


def test_end_of_a_journal_whose_count_is_gone_is_not_known(path):
    (journal_path(path) / "written").unlink()
    report = recover(path)
    assert report.counts["camera"] == 40
    assert not report.end_is_known
