"""A session and the configuration to estimate it with: its own, or the campaign's present one."""

from __future__ import annotations

import logging
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fieldkit.config import Config, ConfigMistakesError, config_from_text, find_campaign, load_config
from fieldkit.config.template import assignment
from fieldkit.config.toml_schema import RegionOutline, RegionOutlines, known_keys
from fieldkit.config.validation import explain
from fieldkit.disk import sha256
from fieldkit.estimation.region_check import CameraView, check_regions
from fieldkit.model.device import cameras_by_name
from fieldkit.model.errors import ConfigError, FieldkitError, SessionError, message_of
from fieldkit.model.marks import numbers_named
from fieldkit.model.next_step import Action, Text
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.samples import Event
from fieldkit.model.site import Region
from fieldkit.model.spelling import nearest
from fieldkit.phrases import Words
from fieldkit.sessions.reader import FILE_OBJECT, SessionReader, open_session

TABLES = ("surface", "air", "irradiance", "estimator", "prior", "slab", "site")
"""Tables of ``fieldkit.toml`` whose keys enter an estimate."""

log_warning: Callable[[Text], None] = logging.getLogger(__name__).warning
log_info: Callable[[str], None] = logging.getLogger(__name__).info
"""Receiver of notes unless the caller receives them."""


SessionOrFile = str | Path | SessionReader
"""A session, or the file of one."""
ONE = (str, Path, SessionReader)
"""Its kinds: what is none of them are several sessions."""
Settings = Mapping[str, Any] | Sequence[str] | str
"""Values by key of ``fieldkit.toml``, as `fieldkit.estimate` takes them, or a list of ``KEY=VALUE``."""


def path_of(session: SessionOrFile) -> Path:
    """The file of a session; raises `SessionError` for a closed one, and for one without."""
    if not isinstance(session, SessionReader):
        return Path(session)
    session.require_open()
    if session.path.parent == FILE_OBJECT:
        raise SessionError("has no file of its own", place=session.path, fix="copy it to this computer")
    return session.path


@contextmanager
def reading(session: SessionOrFile) -> Iterator[SessionReader]:
    """The session, opened and closed here if its file is given; errors of a file are `SessionError`."""
    if isinstance(session, SessionReader):
        session.require_open()
        yield session
        return
    path = Path(session)
    try:
        with open_session(path) as opened:
            yield opened
    except FieldkitError:
        raise
    except (OSError, RuntimeError, ValueError) as error:
        raise SessionError(
            f"cannot be read: {message_of(error)}", place=path, fix=Action.CHECK(path)
        ) from error


def marks_of(session: SessionReader, without: Collection[int] = ()) -> list[Event]:
    """The marks of a session but for those numbered `without`: an estimator takes them before the samples."""
    marks = session.marks().items()
    return [mark for number, mark in marks if number not in without]


def notify_damage(
    session: SessionReader, notify: Callable[[str], None], damaged: Mapping[str, int] | None = None
) -> None:
    """Report how many samples of each stream do not match their checksum: no result includes them.

    `damaged` are those of an earlier reading; else those that were read so far.
    """
    for name, count in (session.damaged if damaged is None else damaged).items():
        what = f"{count} of {session.count(name)} samples of {name} do not match their checksum"
        notify(f"{session.path}: {what} and are excluded; a check lists them")


@dataclass(frozen=True)
class Source:
    """A session file to estimate: `checksum` is the file's SHA-256, `without_marks` numbers of its marks."""

    path: Path
    checksum: str
    session_id: str
    config: Config
    regions: RegionSchedule
    without_marks: tuple[int, ...] = ()


def source_of(
    session: SessionOrFile,
    *,
    present: bool = False,
    regions: Sequence[Region] | None = None,
    without_marks: Collection[int | str] = (),
) -> Source:
    """Read what an estimate needs of a session; `present` takes the campaign's configuration and regions.

    `regions` replace those of the session; `without_marks` are numbers or texts of marks. Raises
    `SessionError` if it cannot be read or is still being recorded, `ConfigError`, also for regions that
    cannot be used in its frames.
    """
    with reading(session) as opened:
        path = opened.path
        if opened.state == "recording":
            fix = Words("fix.until_end") + ", or " + Action.STOP()
            raise SessionError(Words("error.recorded"), place=path, fix=fix)
        config = config_for(opened, present=present)
        if regions is None:
            schedule = regions_for(opened, config, present=present)
        else:
            schedule = schedule_of(opened, regions)
        # a session may consist of its journal alone, or lie elsewhere: then there is no file to digest
        checksum = sha256(path) if path.exists() else ""
        marks = opened.marks()
        without = sorted({number for name in without_marks for number in numbers_named(name, marks)})
        return Source(path.resolve(), checksum, opened.session_id, config, schedule, tuple(without))


def schedule_of(session: SessionReader, regions: Sequence[Region]) -> RegionSchedule:
    """Regions drawn on a finished session; raises `ConfigError` for one that cannot be used in its frames."""
    cameras = cameras_by_name(session.streams.values())
    checks = check_regions(regions, {name: CameraView(info.shape) for name, info in cameras.items()})
    if failures := [failure for check in checks for failure in check.named_failures]:
        problem = Words("text.all", texts=failures)
        raise ConfigError(problem, place=session.path, fix="draw them again on the session's frames")
    values = {"region": [RegionOutline.of(region).model_dump() for region in regions]}
    try:
        RegionOutlines.model_validate(values)
    except ValidationError as error:  # names may be those of any session
        mistakes = [mistake for mistake in explain(error, values) if mistake.path[-1] != "name"]
        if mistakes:
            raise ConfigMistakesError([("regions", mistake) for mistake in mistakes]) from None
    return RegionSchedule.of(regions)


def config_for(session: SessionReader, settings: Settings = (), *, present: bool = False) -> Config:
    """The configuration to estimate a session with.

    The session's own, unless it has none (it was imported) or `present` asks for the
    campaign's ``fieldkit.toml`` as it is now, regions included. The site is always the session's;
    only `settings` can replace it. Raises `ConfigError`.
    """
    site = {f"site.{key}": value for key, value in asdict(session.site).items()}
    settings = [*settings_from(site), *settings_from(settings)]  # those given come last, and so hold
    if session.config_toml and not present:
        return config_from_text(session.config_toml, session.path, settings=settings)
    try:
        campaign_file = find_campaign(session.path.resolve().parent)
    except ConfigError as error:
        if session.config_toml:
            raise
        raise ConfigError(
            "no configuration of its own (it was imported), and no campaign is around it",
            place=session.path,
            fix="put it into recordings/ of a campaign, and draw regions there: " + Action.ADD_REGION(),
        ) from error
    return load_config(campaign_file, settings=settings)


def configured_otherwise(session: SessionReader, other: SessionReader) -> list[str]:
    """Keys of an estimate whose values in the configuration of `other` are not those of `session`."""
    if not session.config_toml:
        return []
    own, their = (tomllib.loads(opened.config_toml) for opened in (session, other))
    keys = ((name, key) for name in TABLES for key in their.get(name, {}))
    return [f"{name}.{key}" for name, key in keys if own.get(name, {}).get(key) != their[name][key]]


def settings_from(values: Settings) -> list[str]:
    """``KEY=VALUE`` of Python values by key; a key may omit its table where only one table has it."""
    if not isinstance(values, Mapping):
        return [values] if isinstance(values, str) else list(values)
    return [_setting(qualified_key(name), value) for name, value in values.items()]


def _setting(key: str, value: Any) -> str:
    *_, last = key.split(".")
    return f"{key}={assignment(last, value).removeprefix(f'{last} = ')}"


def qualified_key(name: str) -> str:
    """``surface.albedo`` for ``albedo``; raises `ConfigError` if no table or more than one has the key."""
    if "." in name:
        return name
    names = [f"{table}.{name}" for table in TABLES if name in known_keys((table,))]
    if len(names) == 1:
        return names[0]
    if names:
        raise ConfigError("ambiguous", place=name, fix=f'qualify it: estimate({{"{names[0]}": ...}})')
    near = nearest(name, (key for table in TABLES for key in known_keys((table,))))
    fix = 'see the configuration reference; other keys need their table: {"record.every_s": 30}'
    raise ConfigError(
        "not a parameter of an estimate", place=name, fix=f"use {near}, if that is meant" if near else fix
    )


def regions_for(session: SessionReader, config: Config, *, present: bool = False) -> RegionSchedule:
    """The regions of the session as they changed, or the campaign's present ones."""
    if present or not (schedule := session.region_schedule).columns:
        return RegionSchedule.of(config.regions)
    return schedule
