"""The uncertainty budgets of a session's slopes, as arrays for the cache and as a table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from fieldkit.estimation.budget import BudgetTerm
from fieldkit.results.cache import Arrays
from fieldkit.sessions.json_forms import build

Budgets = Mapping[str, tuple[BudgetTerm, ...]]
"""The terms of each target's slope, by its name."""


def packed_budgets(found: Budgets) -> Arrays:
    """Budgets as arrays for the cache, every number exact."""
    texts = json.dumps({name: [asdict(term) for term in terms] for name, terms in found.items()})
    return {"budgets": np.array([texts], np.bytes_)}


def unpacked_budgets(arrays: Arrays) -> Budgets:
    """Budgets of which `packed_budgets` made arrays."""
    stored = json.loads(arrays["budgets"].tolist()[0])
    return {name: tuple(build(BudgetTerm, term) for term in terms) for name, terms in stored.items()}


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
