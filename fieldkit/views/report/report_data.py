"""Data of a report, gathered once; each section takes its part of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fieldkit.estimation.budget import BudgetTerm
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.statistics import SdKind
from fieldkit.model.samples import Event, EventKind, Frame
from fieldkit.model.site import Region, Site
from fieldkit.views import formatting
from fieldkit.views.html import Figure
from fieldkit.views.report.series import Series

if TYPE_CHECKING:
    from fieldkit.sessions.reader import SessionReader


@dataclass(frozen=True)
class ReportData:
    """A session, its minutes as columns, the settings they were estimated with, and its events.

    `site`, `regions` and `config_toml` are those of the estimator, as an imported session has none of its
    own. `others` holds the same minutes estimated with other surface models, by their names,
    `budgets` the uncertainty budget of each slope, with the learned model.
    """

    session: SessionReader
    site: Site
    regions: tuple[Region, ...]
    columns: Series
    settings: EstimatorSettings
    sd: SdKind
    events: Sequence[Event]
    frame: Frame | None
    others: Mapping[str, Series]
    command_line: str
    config_toml: str
    can_draw: bool
    is_recordings: bool = False
    budgets: Mapping[str, tuple[BudgetTerm, ...]] = field(default_factory=dict)

    def events_of(self, *kinds: EventKind) -> list[Event]:
        """Events of some kinds, in order."""
        return [event for event in self.events if event.kind in kinds]

    def clock_time(self, time_ns: int, *, seconds: bool = False) -> str:
        """A time of day at the site."""
        return formatting.clock_time(time_ns, self.site, seconds=seconds)

    def drawn(self, draw: Callable[[ReportData], Iterator[Figure]]) -> list[Figure] | None:
        """The figures that `draw` yields; None without matplotlib."""
        return list(draw(self)) if self.can_draw else None

    @property
    def zone(self) -> str:
        """The time zone at the start, with its offset."""
        return formatting.zone_name(self.session.start_ns, self.site)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the contact probes of all thermometers, in their order."""
        meters = [info for info in self.session.streams.values() if info.quantity == "temperature"]
        return tuple(
            info.channels[i] if i < len(info.channels) else str(i + 1)
            for info in meters
            for i in range(info.shape[0])
        )
