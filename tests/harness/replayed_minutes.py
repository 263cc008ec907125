"""The minutes of a session by a fresh estimator: nothing comes from the recording or a cache."""

from __future__ import annotations

from itertools import chain

from fieldkit.config import Config
from fieldkit.estimation.estimator import Minute
from fieldkit.results.estimate import estimator_for
from fieldkit.results.sources import marks_of
from fieldkit.sessions.reader import SessionReader


def replayed_minutes(session: SessionReader, config: Config, *, present: bool = False) -> list[Minute]:
    """Every minute, as the estimator closes it on the session's samples."""
    estimator = estimator_for(session, config, present=present)
    samples = chain(marks_of(session), session.samples())
    return [minute for sample in samples for minute in estimator.add(sample)] + list(estimator.finish())
