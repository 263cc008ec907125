"""``fieldkit map``: tilt and azimuth of every pixel of recorded sessions, as a picture and as arrays."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_sessions, latest_session
from fieldkit.model.errors import IntegrityError, NoAnswerError, StorageError

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.workflows.slope_map import MappedSession

ENDINGS = (".png", ".nc")
_POLL_S = 1.0


@click.command(cls=common.Command)
@click.argument("sessions", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), metavar="NAME",
    help="Of several sessions: a folder [default: the results folder].",
)  # fmt: skip
@click.option(
    "--window",
    metavar="TIME",
    help="How far back from the last good minute: 20m, 1h, all, or weather: as the regions' slopes look "
    "[default: as configured].",
)
@common.present_option
@click.option("--follow", is_flag=True, help="Map a session anew each minute while it is being recorded.")
@common.workers_options
@common.set_option
@click.pass_context
def command(
    ctx: click.Context,
    sessions: tuple[Path, ...],
    out: Path | None,
    window: str | None,
    present: bool,
    follow: bool,
    jobs: int | None,
    kind: str,
    address: str | None,
    settings: tuple[str, ...],
) -> None:
    """Map the slopes of SESSIONS or folders of them (default: the newest), pixel by pixel.

    NAME.png shows azimuth as hue and tilt as strength of colour, shaded like a relief; NAME.nc
    (netCDF) has the arrays with state and 90 % region of every pixel. Both are replaced whole with
    --follow, so a picture viewer or a browser may keep them open; the recording does not notice.
    """
    paths = find_sessions(ctx, sessions) if sessions else [latest_session(ctx, None)]
    if len(paths) > 1:
        from fieldkit.cli.map_many import map_many

        if follow:
            raise click.UsageError("--follow is for one session")
        made = partial(map_session, window=window, settings=settings, present=present)
        map_many(paths, out, made, settings, (kind, address, jobs))
        return
    path = paths[0]
    base = base_of(out, path)
    print_json = common.print_json_line if follow else common.print_json

    def map_now() -> None:
        _map(path, base, window, settings, print_json, present=present)

    if follow:
        _follow(path, map_now)
    map_now()


def _follow(path: Path, map_now: Callable[[], None]) -> None:
    """Map at each new minute of a recording until it ends; a minute that makes no map yet is said."""
    from fieldkit.model.units import MINUTE_NS
    from fieldkit.sessions.layout import journal_path
    from fieldkit.sessions.lock import is_locked
    from fieldkit.sessions.reader import open_session

    mapped = -1
    while is_locked(journal_path(path)):
        with open_session(path) as opened:
            minute = opened.end_ns // MINUTE_NS
        if minute > mapped:
            mapped = minute
            try:
                map_now()
            except NoAnswerError as error:
                common.say(error.message)
        time.sleep(_POLL_S)
    common.say("the recording has ended")


def _map(
    path: Path,
    base: Path,
    window: str | None,
    settings: tuple[str, ...],
    print_json: Callable[[Mapping[str, Any]], None],
    *,
    present: bool,
) -> None:
    found = map_session(path, window=window, settings=settings, present=present)
    for remark in remarks(found):
        common.say(remark)
    files = write(base, path, found, settings)
    if common.options().json:
        print_json(document(path, found, files))
    else:
        print_map(found, files)
    if (error := damage(path, found)) is not None:
        raise error


def damage(path: Path, found: MappedSession) -> IntegrityError | None:
    """What to say of a session with frames that do not match their checksum; the map is made without them."""
    if not found.damaged:
        return None
    text = f"{path}: {found.damaged} frames do not match their checksum; the map is made without them"
    return IntegrityError(text, fix=f"fieldkit check {path}")


def map_session(path: Path, *, window: str | None, settings: tuple[str, ...], present: bool) -> MappedSession:
    """The map of a session; also what a worker does of many. Raises `FieldkitError`."""
    from fieldkit.workflows.estimate import config_for
    from fieldkit.workflows.slope_map import map_of
    from fieldkit.workflows.sources import reading

    with reading(path) as opened:
        config = config_for(opened, settings, present=present)
        return map_of(opened, config, _window_s(window, config), present=present)


def remarks(found: MappedSession) -> list[str]:
    """What was asked for of regions and cannot be had pixel by pixel, and what spoils a map."""
    from fieldkit.model.samples import Quality

    said = {
        "the map is by the paper's model: the full one is for regions": found.settings.model == "full",
        "the map leaves the azimuth free: only regions have a known one": found.settings.azimuth == "known",
        "the picture moved within the window: edges are smeared; choose another --window": bool(
            found.flags & Quality.MOVED
        ),
    }
    return [remark for remark, holds in said.items() if holds]


def _window_s(window: str | None, config: Config) -> float | None:
    from fieldkit.cli.types import DURATION

    if window is None:
        return config.estimator_settings().window_s
    words: dict[str, float | None] = {"all": math.inf, "weather": None}
    return words[window] if window in words else DURATION.convert(window, None, None)


def base_of(out: Path | None, session: Path) -> Path:
    """What both files are called, with or without an ending typed."""
    from fieldkit.cli import batch

    if out is not None:
        return batch.base_of(out, ENDINGS)
    parent = session.resolve().parent
    if parent.name == "recordings":
        return parent.parent / "results" / session.stem / "slope-map"
    return parent / f"{session.stem}-slope-map"


def write(base: Path, path: Path, found: MappedSession, settings: tuple[str, ...]) -> list[Path]:
    """Write the map of the session at `path` as picture and arrays; the files. Raises `StorageError`."""
    from fieldkit.sessions.reader import open_session
    from fieldkit.views import formatting, slope_map_image
    from fieldkit.workflows.slope_map import write_map

    begin, end = (formatting.clock_time(time_ns, found.site) for time_ns in (found.start_ns, found.end_ns))
    day = formatting.local_time(found.start_ns, found.site).date()
    under = f"{day} {begin}-{end} {formatting.zone_name(found.start_ns, found.site)}, {found.minutes} min"
    files = [base.with_name(base.name + ending) for ending in ENDINGS]
    picture, arrays = parts = [file.with_name(f".{file.name}.part") for file in files]
    try:
        base.parent.mkdir(parents=True, exist_ok=True)
        picture.write_bytes(slope_map_image.png(found.slopes, found.bounds, found.regions, path.stem, under))
        with open_session(path) as session:
            write_map(arrays, found, session, settings)
        for part, file in zip(parts, files, strict=True):
            part.replace(file)  # whole at once: somebody may be looking at the one before
    except OSError as error:
        raise StorageError(
            f"cannot write {base}: {error.strerror or error}", fix="name another place with -o"
        ) from error
    return files


def document(path: Path, found: MappedSession, files: list[Path]) -> dict[str, Any]:
    """A map for ``--json``."""
    return {
        "session": str(path), "files": [str(file) for file in files], "minutes": found.minutes,
        "start_ns": found.start_ns, "end_ns": found.end_ns, "states": _shares(found.slopes.state),
        "flags": [str(flag.name).lower() for flag in found.flags], "regions": _beds(found),
    }  # fmt: skip


def print_map(found: MappedSession, files: list[Path]) -> None:
    """What the map says of each region, and where it is."""
    rows = [
        (
            bed["region"], _number(bed["tilt_deg"], 1), _number(bed["azimuth_deg"], 0),
            _range(bed["tilt_low_deg"], bed["tilt_high_deg"]),
            _range(*bed["tilt_region_deg"]), bed["pixels"],
            ", ".join(f"{state} {share:.0%}" for state, share in bed["states"].items()),
        )
        for bed in _beds(found)
    ]  # fmt: skip
    common.print_table(
        ("region", "tilt °", "azimuth °", "half of pixels °", "90 % of one °", "pixels", "states"), rows
    )
    for file in files:
        click.echo(file)


def _beds(found: MappedSession) -> list[dict[str, Any]]:
    return [_bed(found, index) for index in range(len(found.regions))]


def _bed(found: MappedSession, index: int) -> dict[str, Any]:
    """A region of the map: median tilt, quartiles, azimuth of the mean normal, shares of the states.

    `tilt_region_deg` are the medians over the pixels of the ends of their 90 % regions.
    """
    import numpy as np

    from fieldkit.physics.facet import normal, tilt_azimuth

    region, slopes = found.regions[index], found.slopes
    inside = region.mask((slopes.state.shape[0], slopes.state.shape[1]))
    known = inside & np.isfinite(slopes.tilt_deg)
    low, middle, high, azimuth = (math.nan,) * 4
    ends = [math.nan, math.nan]
    if known.any():
        low, middle, high = (float(q) for q in np.percentile(slopes.tilt_deg[known], (25, 50, 75)))
        normals = normal(slopes.tilt_deg[known], slopes.azimuth_deg[known])
        azimuth = float(tilt_azimuth(normals.mean(axis=0))[1])
        bounds = (found.bounds.tilt_low_deg, found.bounds.tilt_high_deg)
        ends = [float(np.median(bound[known])) for bound in bounds]
    return {
        "region": region.name, "tilt_deg": middle, "azimuth_deg": azimuth, "tilt_low_deg": low,
        "tilt_high_deg": high, "tilt_region_deg": ends, "pixels": int(inside.sum()),
        "states": _shares(slopes.state[inside]),
    }  # fmt: skip


def _shares(states: Any) -> dict[str, float]:
    """Which share of the pixels is in which state; states that do not occur are left out."""
    from fieldkit.model.slope import SlopeState

    shares = {state.name.lower(): float((states == state).mean()) for state in SlopeState if states.size}
    return {name: share for name, share in shares.items() if share}


def _range(low: float, high: float) -> str:
    return _number(low, 1) if math.isnan(low) else f"{_number(low, 1)} to {_number(high, 1)}"


def _number(value: float, digits: int) -> str:
    from fieldkit.views.formatting import number

    return number(value, digits)
