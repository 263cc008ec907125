"""After a power cut at any moment nothing is lost that a completed sync had covered.

Every write of a recording is replayed up to some point, torn, reordered or zeroed as disks
do; then the session is recovered from what is left.
"""

import random
import time
from pathlib import Path

import pytest

from fieldkit.model.errors import SessionError
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from tests.harness import disk
from tests.harness.faulty_recorder import HEADER, MARKS
from tests.harness.recording import same, sample

KINDS = ("prefix", "torn at a byte", "torn at a sector", "reordered", "zeroed tail")
LIMIT_S = 60.0  # a moment on an idle computer


@pytest.fixture(scope="module")
def changes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("watched")
    log = folder / "log"
    done = disk.run_watched(
        folder, "-m", "tests.harness.faulty_recorder", "record", str(folder / "disk"), log=log
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "72"
    return disk.read_log(log, folder / "disk")


def image(changes: list[disk.Change], count: int, kind: str, chance: random.Random) -> disk.Disk:
    if kind == "prefix":
        return disk.after(changes, count)
    if kind == "reordered":
        return disk.reordered(changes, count, chance)
    if kind == "zeroed tail":
        return disk.zeroed_tail(changes, count)
    return disk.torn(changes, count, chance, sector=kind == "torn at a sector")


def survivors(folder: Path) -> int:
    """Samples of the recovered session, each of which is right; 0 where there never was one."""
    path = folder / "field.h5"
    if not path.exists() and not journal_path(path).exists():
        return 0
    began = time.monotonic()
    try:
        recover(path)
    except SessionError:
        return 0  # nothing readable: fine only if nothing was promised
    finally:
        assert time.monotonic() - began < LIMIT_S
    if not path.exists():
        return 0  # the power went before the first sample: recovery removes what had been made
    count = 0
    with open_session(path) as session:
        for item in session.samples():
            assert same(item, sample(HEADER.stream(item.stream), item.seq))
            count += 1
    return count


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("trials", [2, pytest.param(250, marks=pytest.mark.slow)])
def test_nothing_covered_by_a_sync_is_lost(changes, tmp_path, kind, trials):
    chance = random.Random(f"{kind} {trials}")
    durable = list(disk.durable_counts(changes, MARKS))
    assert durable[-1] == 72
    for _ in range(trials):
        count = chance.randrange(1, len(changes) + 1)
        folder = image(changes, count, kind, chance).store(tmp_path / "disk")
        assert survivors(folder) >= durable[count - 1], f"{kind} after {count} of {len(changes)} changes"


@pytest.mark.parametrize("every", [6, pytest.param(1, marks=pytest.mark.slow)])
def test_nothing_is_lost_where_the_disk_kept_what_syncs_asked_for_and_nothing_else(changes, tmp_path, every):
    """Cut right before and right after each sync promises more: then most is gone."""
    durable = list(disk.durable_counts(changes, MARKS))
    rises = [count for count in range(1, len(changes)) if durable[count] > durable[count - 1]]
    chosen = [*rises[::every], rises[-1]]
    for count in (*chosen, *(count + 1 for count in chosen), len(changes)):
        folder = disk.confirmed(changes, count).store(tmp_path / "disk")
        assert survivors(folder) >= durable[count - 1], f"after {count} of {len(changes)} changes"


@pytest.mark.slow
def test_every_single_prefix(changes, tmp_path):
    durable = list(disk.durable_counts(changes, MARKS))
    state = disk.Disk()
    for count, change in enumerate(changes):
        state.apply(change)
        if change.kind in "WTU":
            assert survivors(state.store(tmp_path / "disk")) >= durable[count]
