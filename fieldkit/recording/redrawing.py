"""Regions redrawn while a recording runs: what changes, from which minute on, or why nothing does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from fieldkit.config import Config
from fieldkit.config.config import RECORDINGS
from fieldkit.config.edit import Draft, editing
from fieldkit.config.toml_schema import RegionOutline, RegionTable
from fieldkit.disk import one_at_a_time
from fieldkit.estimation.region_check import CameraView, check_regions
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.model.site import Region, RegionRecord, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.phrases import Words, text_document
from fieldkit.recording.regions import check_configured, regions_in_draft
from fieldkit.recording.requests import SentRequest, send_to_recorder
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.entry_rows import event_fits
from fieldkit.sessions.layout import MAX_REGIONS, check_region
from fieldkit.views import formatting

T = TypeVar("T")
SETTINGS_OF_REGIONS = ("offset_k", "emissivity_sd", "surface_kind", "probes", "horizon")
"""Keys of a region that are settings of the estimator, which a recording keeps as it began."""


@dataclass(frozen=True, slots=True)
class NewRegions:
    """All regions as they shall be from now on: a request to the running recording."""

    regions: tuple[RegionOutline, ...]
    do: ClassVar[str] = "regions"

    @classmethod
    def of(cls, regions: Iterable[Region]) -> Self:
        """The request for these regions."""
        return cls(tuple(map(RegionOutline.of, regions)))


@dataclass
class Redrawing:
    """The regions of a recording as they are now; `views` are of its cameras."""

    regions: tuple[Region, ...]
    views: Mapping[str, CameraView]
    site: Site

    def __post_init__(self) -> None:
        self._names = {region.name for region in self.regions}

    def carry_out(
        self, requested: Sequence[Region], request: str, mono_ns: int, time_ns: int
    ) -> Iterator[RegionRecord | Event]:
        """The changes that lead to the regions requested, and the event that answers; that alone if refused.

        A change holds from the next full minute on, so that no minute is seen through two outlines. Each
        counts as made once the caller asks for what follows.
        """
        if refusals := self._refusals(requested):
            text = f"regions not changed: {'; '.join(refusals)}"
            about: dict[str, Any] = {"request": request, "refusals": text_document(refusals)}
            yield _answer(mono_ns, time_ns, text, about, Severity.WARNING)
            return
        since_ns = (time_ns // MINUTE_NS + 1) * MINUTE_NS
        changes: dict[str, list[str]] = {}
        for record, what in list(_changes(self.regions, requested, since_ns)):
            yield record
            self.regions = record.changed(self.regions)
            self._names.add(record.region.name)
            changes.setdefault(what, []).append(record.region.name)
        data = {"request": request} | ({"from_ns": since_ns, **changes} if changes else {})
        yield _answer(mono_ns, time_ns, self._words(changes, since_ns), data)

    def _refusals(self, requested: Sequence[Region]) -> list[str]:
        """Mistakes of the regions requested that those of now do not have already."""
        before = set(self._failures(self.regions))
        refusals = [failure for failure in self._failures(requested) if failure not in before]
        names = [region.name for region in requested]
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        refusals += [Words("error.duplicate", name=name) for name in twice]
        if len(self._names | set(names)) > MAX_REGIONS:
            refusals.append(Words("error.most_regions", most=MAX_REGIONS))
        return refusals

    def _failures(self, regions: Sequence[Region]) -> list[str]:
        try:
            for region in regions:
                check_region(region)
        except ValueError as error:
            return [str(error)]
        inspections = check_regions(regions, self.views)
        return [failure for inspection in inspections for failure in inspection.named_failures]

    def _words(self, done: dict[str, list[str]], since_ns: int) -> str:
        if not done:
            return "regions unchanged: they are as requested"
        changes = ", ".join(f"{', '.join(names)} {what}" for what, names in done.items())
        return f"regions changed: {changes}; from {formatting.clock_time(since_ns, self.site)} on"


def _answer(
    mono_ns: int, time_ns: int, text: str, data: dict[str, Any], severity: Severity = Severity.INFO
) -> Event:
    event = Event(EventKind.REGION, mono_ns, time_ns, text, severity=severity, data=data)
    return event if event_fits(event) else replace(event, text=text[:200], data={"request": data["request"]})


def _changes(
    regions: Sequence[Region], requested: Sequence[Region], since_ns: int
) -> Iterator[tuple[RegionRecord, str]]:
    """Differences, each with its word: removals first, so that their pixels are free."""
    before = {region.name: repr(region) for region in regions}  # in which NaN is equal to NaN
    names = {region.name for region in requested}
    for region in regions:
        if region.name not in names:
            yield RegionRecord(region, since_ns, is_removed=True), "removed"
    for region in requested:
        if before.get(region.name) != repr(region):
            yield RegionRecord(region, since_ns), "changed" if region.name in before else "added"


def change_regions(file: Path, change: Callable[[Draft], T]) -> tuple[T, SentRequest | None]:
    """Change the regions of a ``fieldkit.toml``, and those of its campaign's recording if one is running.

    Estimates of the running session use the new regions from the next full minute on.

    Parameters
    ----------
    file
        The campaign's ``fieldkit.toml``.
    change
        A change by `fieldkit.recording.regions`:
        ``partial(add_region, name="b15", rect=(60, 60, 30, 30))``, or `edit_region`, or `remove_region`.

    Returns
    -------
    tuple
        What `change` returned, and the request to the recording; None where nothing is being recorded.

    Raises
    ------
    ConfigError
        The regions would be invalid, or the recording could not use them; nothing is changed then.
    RefusedError, StorageError
        As `send_to_recorder`; the file is changed then, and the recording is not.
    """
    recordings = file.parent / RECORDINGS
    if session_in_progress(recordings) is None:
        with editing(file) as draft:
            return change(draft), None
    with one_at_a_time(recordings):  # the last request must have the regions that the file ends with
        with editing(file) as draft:
            before = regions_in_draft(draft)
            result = change(draft)
            after = regions_in_draft(draft)
            check_configured(after, unless=before)
        request = send_to_recorder(recordings, NewRegions.of(after.regions))
    return result, replace(request, unused=tuple(_unused_keys(before, after)))


def _unused_keys(before: Config, after: Config) -> Iterator[str]:
    """Changed keys of regions that a recording keeps as it began: those that are no part of a `Region`."""
    previous = {region.name: region for region in before.tables.region}
    for region in after.tables.region:
        was = previous.get(region.name, RegionTable.model_construct())
        for key in SETTINGS_OF_REGIONS:
            if getattr(region, key) != getattr(was, key):
                yield f"{region.name}: {key}"
