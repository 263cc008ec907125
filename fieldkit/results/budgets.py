"""The uncertainty budgets of a session's slopes, by the learned or full model, found again in the cache."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from fieldkit.estimation import slopes
from fieldkit.estimation.budget import BudgetTerm
from fieldkit.estimation.chain import SlopeChain
from fieldkit.results.cache import Arrays, digest
from fieldkit.results.minutes import Run, measured_in
from fieldkit.sessions.json_forms import build
from fieldkit.sessions.reader import SessionReader

Budgets = Mapping[str, tuple[BudgetTerm, ...]]


def budgets_of(run: Run, session: SessionReader | None = None) -> Budgets:
    """Budget of each target at the end of a session; empty with the model of the paper.

    All minutes are taken at once, seconds for three hours; `session` is the open file, if there is one.
    Raises `SessionError`.
    """
    if run.settings.model == "paper":
        return {}
    key = digest("budgets", run.key)
    if (known := run.cache.load(key)) is not None:
        return unpacked_budgets(known)
    found = _found(run, session)
    run.cache.store(key, packed_budgets(found))
    return found


def packed_budgets(found: Budgets) -> Arrays:
    """Budgets as arrays for the cache, every number exact."""
    texts = json.dumps({name: [asdict(term) for term in terms] for name, terms in found.items()})
    return {"budgets": np.array([texts], np.bytes_)}


def unpacked_budgets(arrays: Arrays) -> Budgets:
    """Budgets of which `packed_budgets` made arrays."""
    stored = json.loads(arrays["budgets"].tolist()[0])
    return {name: tuple(build(BudgetTerm, term) for term in terms) for name, terms in stored.items()}


def _found(run: Run, session: SessionReader | None) -> Budgets:
    history, schedule = measured_in(run, session).history, run.source.regions
    if not len(history):
        return {}
    history, regions = history.at_last(schedule)
    if run.settings.model == "full":
        return slopes.budgets(history, regions, run.settings)
    chain = SlopeChain(regions, run.settings)
    chain.at_once(history)
    return chain.budgets()


def budget_columns(found: Budgets) -> dict[str, list[Any]]:
    """The budgets as a table, a row for each term of each region."""
    rows = [(name, term) for name, terms in found.items() for term in terms]
    return {
        "region": [name for name, _ in rows],
        "term": [term.name for _, term in rows],
        "type": [term.kind for _, term in rows],
        "standard_uncertainty": [term.uncertainty for _, term in rows],
        "unit": [term.unit for _, term in rows],
        "sensitivity_deg_per_unit": [term.sensitivity for _, term in rows],
        "share_of_variance": [term.share for _, term in rows],
    }
