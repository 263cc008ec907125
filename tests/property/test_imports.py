"""What holds for all that import reads: damage is told or does no harm, quickly and in little memory."""

import random
import resource
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from fieldkit.cli import import_session
from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import EventKind
from fieldkit.sessions.reader import open_session
from tests.harness.foreign_files import one_of_each

LIMIT_S = 30.0  # a tenth of a second on an idle machine
MEMORY_LIMIT_KB = 300_000
NAMES = (
    "a.raw.y16.gz", "a.fff", "a.seq", "a.jpg", "20260512T010000.irg", "20260512T010001.tif", "log.csv",
    "slv16001.dat", "tat0624.dat", "obsdl.csv", "DR202406_tat.txt", "a.csq", "20260512T010002.csv",
    "stack.tiff", "a.mcap", "abq20163.dat", "a.epw", "tmy3.csv", "nsrdb.csv", "pvgis.csv", "cams.csv",
    "a.xlsx", "a.parquet", "a.feather", "a.nc", "a.cdf",
)  # fmt: skip


def imported(source: Path, out: Path, options: tuple[str, ...]) -> Result:
    out.unlink(missing_ok=True)
    words = [str(source), "--site", "37.7,-105.92,2317", "-o", str(out), "-C", str(source.parent), *options]
    return CliRunner().invoke(import_session.command, words, catch_exceptions=True)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return one_of_each(tmp_path_factory.mktemp("sound"))


@pytest.mark.parametrize("name", NAMES)
def test_sound_files_of_every_kind_become_sessions(sound, tmp_path, name):
    source = next(path for path in sound if path.name == name)
    done = imported(source, tmp_path / "a.h5", sound[source])
    assert done.exit_code == 0, done.output
    with open_session(tmp_path / "a.h5") as session:
        assert session.state == "sealed"
        assert len(list(session.samples())) > 0
        origin = session.events()[0]
    assert (origin.kind, Path(origin.text.split()[-1]).name) == (EventKind.IMPORTED, name)


OPTIONS = {
    "--kelvin-per-count": "0.5", "--kelvin-at-zero": "1", "--times": __file__, "--time-format": "%Y",
    "--zone": "Asia/Tokyo", "--clock-offset": "+1s", "--unit": "lx", "--column": "x", "--measures": "gti",
    "--encoding": "cp1252", "--time": "x", "--keep": "first", "--sheet": "x",
    "--start": "2026-05-12T01:00Z", "--date": "2026-05-12",
}  # fmt: skip
FIELDS = {word: option.name for option in import_session.command.params for word in option.opts}
TIMES = {"--times", "--time-format", "--zone", "--clock-offset"}
FRAMES, TABLE = TIMES | {"--kelvin-per-count", "--kelvin-at-zero"}, {
    "--time-format", "--zone", "--clock-offset", "--unit", "--column", "--measures", "--encoding",
    "--time", "--keep", "--start", "--date",
}  # fmt: skip
CONTAINED = TABLE - {"--encoding"} | {"--sheet"}
USED = {
    "20260512T010000.irg": FRAMES, "20260512T010001.tif": FRAMES, "log.csv": TABLE,
    "a.csq": TIMES, "20260512T010002.csv": FRAMES | {"--unit"}, "stack.tiff": FRAMES,
    "a.mcap": {"--kelvin-per-count", "--kelvin-at-zero", "--unit", "--column", "--clock-offset"},
    **dict.fromkeys(("a.xlsx", "a.parquet", "a.feather", "a.nc", "a.cdf"), CONTAINED),
    "a.raw.y16.gz": {"--clock-offset"}, "a.fff": TIMES, "a.seq": TIMES, "a.jpg": TIMES,
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_options_that_a_format_does_not_use_are_refused_by_name(sound, tmp_path, name):
    source = next(path for path in sound if path.name == name)
    for option in OPTIONS.keys() - USED.get(name, set()):
        done = imported(source, tmp_path / "a.h5", (*sound[source], option, OPTIONS[option]))
        assert isinstance(done.exception, ConfigError), option
        assert done.exception.fix == "omit " + Argument(FIELDS[option])


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Cut somewhere, some bytes changed, a stretch repeated, or overwritten with the largest numbers."""
    broken, place = bytearray(data), chance.randrange(len(data))
    kind = chance.randrange(5)
    if kind == 0:
        del broken[place:]
    elif kind == 1:
        for _ in range(chance.randrange(1, 8)):
            broken[chance.randrange(len(broken))] = chance.randrange(256)
    elif kind == 2:
        broken[place : place + 8] = b"\xff" * min(8, len(broken) - place)
    elif kind == 3:
        broken[place : place + 4] = b"9999"[: len(broken) - place]
    else:
        broken[place:place] = broken[place : place + chance.randrange(1, 200)]
    return bytes(broken)


def most_memory_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("trials", [1, pytest.param(400, marks=pytest.mark.slow)])
def test_damage_is_told_or_does_no_harm(sound, tmp_path, name, trials):
    """Exit by an error of fieldkit's own with something to do next, or with a session that opens."""
    source = next(path for path in sound if path.name == name)
    chance, before_kb = random.Random(f"{name} {trials}"), most_memory_kb()
    victim, out = tmp_path / name, tmp_path / "out" / "a.h5"
    out.parent.mkdir()
    for _ in range(trials):
        victim.write_bytes(damaged(source.read_bytes(), chance))
        began = time.monotonic()
        done = imported(victim, out, sound[source])
        assert time.monotonic() - began < LIMIT_S
        if done.exit_code == 0:
            with open_session(out) as session:
                assert list(session.samples())
        else:
            assert isinstance(done.exception, FieldkitError | SystemExit), repr(done.exception)
            if isinstance(done.exception, FieldkitError):
                assert done.exception.fix
            assert list(out.parent.iterdir()) == []
    assert most_memory_kb() - before_kb < MEMORY_LIMIT_KB
