"""Learnt parameters, minute by minute: for notebooks, tables and the cache.

>>> session.estimate(model="learned").learnt["thermal_inertia"].value          # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.results.cache import as_texts, of_texts
from fieldkit.views import html, learnt_words

if TYPE_CHECKING:
    import pandas as pd

NUMBERS = tuple(field.name for field in fields(LearntParameter) if field.type == "float")


@dataclass(frozen=True)
class LearntSeries:
    """Parameters learnt up to each minute, by the minute's UTC nanoseconds; empty with other models.

    ``learnt["depth"]`` is a parameter at the end, `to_frame` the table of all minutes.
    """

    by_time_ns: Mapping[int, Learnt]

    @property
    def final(self) -> Learnt | None:
        """Parameters learnt from the whole session, or None if nothing."""
        return list(self.by_time_ns.values())[-1] if self.by_time_ns else None

    def __len__(self) -> int:
        return len(self.by_time_ns)

    def __getitem__(self, name: str) -> LearntParameter:
        found = {one.name: one for one in self.final.parameters} if self.final else {}
        try:
            return found[name]
        except KeyError:
            raise KeyError(f"no parameter {name!r}; there are {', '.join(found) or 'none'}") from None

    def columns(self) -> dict[str, list[Any]]:
        """The tidy table: a row for each minute and parameter, its prior and its estimate in `unit`."""
        rows = [(time_ns, one) for time_ns, learnt in self.by_time_ns.items() for one in learnt.parameters]
        return {
            "time_ns": [time_ns for time_ns, _ in rows],
            "parameter": [one.name for _, one in rows],
            "unit": [one.unit for _, one in rows],
            **{name: [getattr(one, name) for _, one in rows] for name in NUMBERS},
        }

    def to_frame(self) -> pd.DataFrame:
        """The tidy table as a pandas frame by UTC; needs ``fieldkit[lab]``."""
        import pandas as pd

        columns = self.columns()
        times = pd.to_datetime(np.asarray(columns.pop("time_ns"), np.int64), utc=True).rename("time")
        return pd.DataFrame(columns, index=times)

    def residuals(self) -> pd.DataFrame:
        """One-minute-ahead prediction errors by UTC and region, in kelvin, with their autocorrelation."""
        import pandas as pd

        rows = [
            (time_ns, region, residual_k, learnt.autocorrelation.get(region, np.nan), learnt.chi_square)
            for time_ns, learnt in self.by_time_ns.items()
            for region, residual_k in learnt.residual_k.items()
        ]
        names = ["time", "region", "residual_k", "autocorrelation", "chi_square"]
        frame = pd.DataFrame(rows, columns=names)
        return frame.assign(time=pd.to_datetime(frame["time"], utc=True)).set_index("time")

    def __repr__(self) -> str:
        parameters = self.final.parameters if self.final else ()
        words = ", ".join(f"{one.name} {learnt_words.found(one)}" for one in parameters)
        return f"<Learnt in {len(self)} min: {words or 'nothing'}>"

    def _repr_html_(self) -> str:
        rows = learnt_words.rows(self.final)
        return html.table_html(html.Table(learnt_words.COLUMNS, rows, learnt_words.meaning(self.final)))

    def packed(self) -> dict[str, NDArray[Any]]:
        """The series as arrays, every number exact."""
        learnt = as_texts(self.by_time_ns.values())
        return {"learnt_ns": np.array([*self.by_time_ns], np.int64), "learnt": learnt}

    @classmethod
    def unpacked(cls, arrays: Mapping[str, NDArray[Any]]) -> LearntSeries:
        """The series that `packed` made arrays of."""
        learnt = of_texts(Learnt, arrays["learnt"])
        return cls(dict(zip(arrays["learnt_ns"].tolist(), learnt, strict=True)))
