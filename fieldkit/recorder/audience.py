"""Who looks on while a recording runs; a view may fail without harm."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol, TypeAlias

from fieldkit.estimation.estimator import Minute
from fieldkit.model.samples import Event, Health, Sample

Shown: TypeAlias = Sample | Event | Minute | Health
log = logging.getLogger(__name__)


class View(Protocol):
    """Something that looks on; it may fail without harm, and is then left out."""

    def show(self, item: Shown) -> None:
        """Take note of an item; must return at once."""

    def close(self) -> None:
        """The recording is over."""


class Audience:
    """All views of a recording; `lost` is told why one is left out from now on."""

    def __init__(self, views: Sequence[View], lost: Callable[[Exception], None]) -> None:
        self._views = list(views)
        self._lost = lost

    def show(self, item: Shown) -> None:
        """Show an item to every view."""
        for view in tuple(self._views):
            self._guarded(view, partial(view.show, item))

    def close(self) -> None:
        """Tell every view that the recording is over."""
        for view in tuple(self._views):
            self._guarded(view, view.close)

    def _guarded(self, view: View, act: Callable[[], None]) -> None:
        try:
            act()
        except Exception as error:
            log.exception("view failed")
            self._views.remove(view)
            self._lost(error)
