"""Actions on a campaign's recording in progress, in whichever process: mark, status, stop.

Each imports as little as the command of that name.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldkit.config import find_campaign, load_config
from fieldkit.recording.marks import mark_of
from fieldkit.recording.requests import SentRequest, send_to_recorder
from fieldkit.recording.running import UnresponsiveRecorder, running_session, stop_recording
from fieldkit.recording.status_request import present_status

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.recording.campaign import Campaign

_log = logging.getLogger(__name__)


def mark(
    text: str,
    campaign: Campaign | Config | str | Path = ".",
    *,
    kind: str = "",
    at: str = "-0s",
    until: str | None = None,
) -> SentRequest:
    """Add a note to the recording in progress, as an event of its session.

    Parameters
    ----------
    text
        The note; ``"shade-test b15"`` when a board begins to shade a region, ``"shade-test b15 end"`` after.
    campaign
        A campaign, or a path in its folder.
    kind
        One word to filter by.
    at, until
        When, or from when until when: ``"-30s"``, ``"12:31"`` at the site, or ISO 8601.

    Raises
    ------
    RefusedError
        Nothing is being recorded.
    ConfigError
        A time is invalid, or the note is too long.

    Examples
    --------
    >>> def gust(minute):
    ...     fieldkit.mark("a gust", campaign, kind="wind")
    >>> with fieldkit.record(campaign, duration="3m", on_minute=gust) as windy:
    ...     {event.text for event in windy.events() if event.kind.name == "MARK"}
    {'a gust'}
    """
    file = _file(campaign)
    folder = file.parent / "recordings"
    note, _ = mark_of(folder, lambda: load_config(file), text, kind=kind, at=at, to=until)
    return send_to_recorder(folder, note)


def status(campaign: Campaign | Config | str | Path = ".") -> dict[str, Any]:
    """How the recording in progress is doing, as ``fieldkit status --json`` prints it.

    Raises `RefusedError` if nothing is being recorded.

    Examples
    --------
    >>> fieldkit.status(campaign)
    Traceback (most recent call last):
    ...
    fieldkit.model.errors.RefusedError: no recording is running in this campaign
      fix: fieldkit.record()
    """
    session = running_session(_file(campaign).parent / "recordings")
    document: dict[str, Any] = present_status(session)["document"]
    return document


def stop(campaign: Campaign | Config | str | Path = ".") -> Path | None:
    """Stop and seal the recording that another process makes, and wait for it; the file of its session.

    One that waits for its time (``record --at``) is called off: there is no session, None.
    Raises `RefusedError` if nothing is being recorded, `SessionError` if it ended without sealing.

    Examples
    --------
    >>> fieldkit.stop(campaign)
    Traceback (most recent call last):
    ...
    fieldkit.model.errors.RefusedError: no recording is running in this campaign
      fix: fieldkit.record()
    """
    file = _file(campaign)

    def warn(silent: UnresponsiveRecorder) -> None:
        _log.warning(silent.at(load_config(file).site))

    return stop_recording(file.parent / "recordings", notify=warn)


def _file(campaign: Campaign | Config | str | Path) -> Path:
    return find_campaign(Path(campaign if isinstance(campaign, str | Path) else campaign.directory))
