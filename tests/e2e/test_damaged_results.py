"""What a damaged sample holds reaches no result: damaged this way or that, every command says the same."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import h5py
import pytest

from fieldkit.model.samples import Quality
from fieldkit.sessions.check import check
from fieldkit.sessions.reader import open_session
from tests.harness import command_line

READINGS = (300, 301, 302)


def fieldkit(*words: object) -> str:
    """What a command says: its results, or that samples were damaged, or too few are left."""
    done = command_line.fieldkit(*words)
    assert isinstance(done.exception, SystemExit | None), (words, done.output, done.exception)
    return _without_hashes(f"exit code {done.exit_code}\n{done.output}")


def _without_hashes(text: str) -> str:
    """Results name the file they are of by its SHA-256."""
    return re.sub("[0-9a-f]{64}", "", text)


@pytest.fixture(scope="module")
def session(recorded, tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("campaign"))


def _pictures(path: Path, bit: int) -> None:
    """A bit within the packed chunk of a burst of three frames."""
    with h5py.File(path) as file:
        chunk = file["camera/counts"].id.get_chunk_info_by_coord((9, 0, 0))
    data = bytearray(path.read_bytes())
    data[chunk.byte_offset + chunk.size // (2 + bit)] ^= 1 << bit
    path.write_bytes(data)


def _light(path: Path, bit: int) -> None:
    with h5py.File(path, "r+") as file:
        for row in READINGS:
            file["lux/value"][row] = file["lux/value"][row] * (2.0 if bit else 0.5)


def _stamps(path: Path, bit: int) -> None:
    with h5py.File(path, "r+") as file:
        for row in READINGS:
            file["lux/device_time"][row] ^= 1 << bit


@pytest.mark.parametrize(
    ("damage", "stream"),
    [(_pictures, "camera"), (_light, "lux"), pytest.param(_stamps, "lux", marks=pytest.mark.slow)],
)
def test_no_result_depends_on_how_a_sample_is_damaged(session, tmp_path, damage, stream):
    said = []
    for bit in (0, 5):
        path = session.with_name("damaged.h5")  # of the same campaign, and named the same both times
        shutil.copy(session, path)
        damage(path, bit)
        assert stream in [one.what for one in check(path) if one.level == "fail"]
        with open_session(path) as opened:
            bad = [one.seq for one in opened.samples(stream) if one.quality & Quality.BAD_CRC]
        assert bad == (list(range(9, 12)) if stream == "camera" else list(READINGS))
        said.append(dict(_results(path, tmp_path / f"bit{bit}")))
        path.unlink()
    one, other = said
    assert one.keys() == other.keys()
    assert "exit code 7" in one["estimate"]
    assert '"tilt_deg": ' in one["estimate"]
    for name in one:
        assert one[name] == other[name], name


def _results(path: Path, out: Path) -> Iterator[tuple[str, object]]:
    """What every command makes of a session, but for what it says of the damaged rows themselves."""
    out.mkdir()
    named = ("--name", out.name, "--json")
    for name, *words in (
        ("estimate", "estimate", path, "--json"),
        ("map", "map", path, "-o", out / "map", "--json"),
        ("uniformity", "calibrate", "uniformity", path, *named),
        ("surface", "calibrate", "surface", path, *named),
    ):
        yield name, fieldkit(*words).replace(str(out), "").replace(out.name, "")
    fieldkit("report", path, "-o", out / "report.html")
    yield "report", _without_hashes((out / "report.html").read_text())
    fieldkit("export", path, "--to", "csv", "-o", out / "csv")
    for table in sorted((out / "csv").iterdir()):
        yield f"export {table.name}", _unflagged(table)


def _unflagged(table: Path) -> list[str]:
    """The lines of a table without those that carry the flag."""
    head, *lines = table.read_text().splitlines()
    names = head.split(",")
    if "flags" not in names:
        return [head, *lines]
    place = names.index("flags")
    return [line for line in lines if not int(line.split(",")[place]) & Quality.BAD_CRC]
