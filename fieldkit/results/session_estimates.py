"""Slopes of a session minute by minute, as columns: for tables, for the cache, for pandas and xarray."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.estimation.budget import BudgetTerm
from fieldkit.model.arrays import IntArray, TableArray
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import (
    SHORT_FIELDS,
    SLOPE_FIELDS,
    ReferenceCheck,
    SlopeEstimate,
    SlopeState,
    final_estimates,
)
from fieldkit.model.spelling import did_you_mean
from fieldkit.views import formatting, html, learnt_words, plots

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes

MEASURED = ("temperature_k", "irradiance_w_m2")
ROW = np.dtype(
    [
        ("time_ns", "<i8"),
        ("window_start_ns", "<i8"),
        ("region", "<i2"),
        ("state", "i1"),
        ("flags", "<u4"),
        ("n_bins", "<i4"),
        ("model", "<i4"),
        ("reason", "<i4"),
        *((name, "<f8") for name in (*SLOPE_FIELDS, *MEASURED)),
    ]
)
"""One estimate; `region`, `model` and `reason` are indices into the lists beside the rows."""
Budgets = Mapping[str, tuple[BudgetTerm, ...]]
"""The terms of each target's slope, by its name."""
_LEARNT_NUMBERS = tuple(field.name for field in fields(LearntParameter) if field.type == "float")


@dataclass(frozen=True)
class LearntSeries:
    """Parameters learnt up to each minute, by the minute's UTC nanoseconds; empty with other models.

    ``learnt["depth"]`` is a parameter at the end, `to_frame` the table of all minutes.

    >>> session.estimate(model="learned").learnt["thermal_inertia"].value          # doctest: +SKIP
    """

    by_time_ns: Mapping[int, Learnt]

    @property
    def final(self) -> Learnt | None:
        """Parameters learnt from the whole session, or None if nothing."""
        return list(self.by_time_ns.values())[-1] if self.by_time_ns else None

    def __len__(self) -> int:
        return len(self.by_time_ns)

    def __getitem__(self, name: str) -> LearntParameter:
        parameters = {parameter.name: parameter for parameter in self.final.parameters} if self.final else {}
        try:
            return parameters[name]
        except KeyError:
            raise KeyError(f"no parameter {name!r}; {did_you_mean(name, parameters)}") from None

    def columns(self) -> dict[str, list[Any]]:
        """The tidy table: a row for each minute and parameter, its prior and its estimate in `unit`."""
        rows = [
            (time_ns, parameter)
            for time_ns, learnt in self.by_time_ns.items()
            for parameter in learnt.parameters
        ]
        names = {"parameter": "name", **{name: name for name in ("unit", *_LEARNT_NUMBERS)}}
        columns = {key: [getattr(parameter, name) for _, parameter in rows] for key, name in names.items()}
        return {"time_ns": [time_ns for time_ns, _ in rows], **columns}

    def to_frame(self) -> pd.DataFrame:
        """The tidy table as a pandas frame by UTC; needs ``fieldkit-slope[lab]``."""
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
        words = ", ".join(
            f"{parameter.name} {learnt_words.value_text(parameter)}" for parameter in parameters
        )
        return f"<Learnt in {len(self)} min: {words or 'nothing'}>"

    def _repr_html_(self) -> str:
        rows = learnt_words.rows(self.final)
        return html.table_html(html.Table(learnt_words.COLUMNS, rows, learnt_words.meaning(self.final)))


@dataclass(frozen=True)
class Estimates:
    """Every slope of a session: rows of `ROW` by time, then by target; texts and regions they index.

    ``estimates["b05"]`` is the final estimate of a region, `to_frame` the table of all minutes.

    `temperature_k` is the target's surface temperature of the minute, `irradiance_w_m2` the
    direct normal irradiance; angles in degrees, NaN where nothing is known. `learnt` is what the data taught
    the learned model, `budgets` the uncertainty budget of each final slope; none from the weather alone.
    `checks` are the slopes of references as all others show them, with two or more of known slope.
    `site` is where they were measured; None where that does not matter.
    """

    rows: TableArray
    texts: tuple[str, ...]
    regions: tuple[Region, ...]
    learnt: LearntSeries = field(default_factory=lambda: LearntSeries({}))
    budgets: Budgets = field(default_factory=dict)
    checks: tuple[ReferenceCheck, ...] = ()
    site: Site | None = None

    @classmethod
    def of(
        cls,
        estimates: Sequence[SlopeEstimate],
        measured: Mapping[str, ArrayLike],
        regions: Sequence[Region],
        learnt: Mapping[int, Learnt] | None = None,
        budgets: Budgets | None = None,
        checks: tuple[ReferenceCheck, ...] = (),
    ) -> Estimates:
        """Estimates as rows, with the `MEASURED` columns of the same targets at the same minutes.

        `learnt` is by the minutes' UTC nanoseconds.
        """
        places = {region.name: place for place, region in enumerate(regions)}
        texts = {text: place for place, text in enumerate(dict.fromkeys(_texts(estimates)))}
        rows = np.zeros(len(estimates), ROW)
        rows["region"] = [places[estimate.region] for estimate in estimates]
        for name in ("model", "reason"):
            rows[name] = [texts[getattr(estimate, name)] for estimate in estimates]
        for name in ("time_ns", "window_start_ns", "state", "flags", "n_bins", *SLOPE_FIELDS):
            rows[name] = [getattr(estimate, name) for estimate in estimates]
        for name in MEASURED:
            rows[name] = measured[name]
        return cls(rows, tuple(texts), tuple(regions), LearntSeries(learnt or {}), budgets or {}, checks)

    def __len__(self) -> int:
        return self.rows.size

    def __iter__(self) -> Iterator[SlopeEstimate]:
        return (self._estimate(row) for row in self.rows)

    def _estimate(self, row: np.void) -> SlopeEstimate:
        return SlopeEstimate(
            time_ns=int(row["time_ns"]),
            region=self.regions[row["region"]].name,
            state=SlopeState(int(row["state"])),
            flags=Quality(int(row["flags"])),
            window_start_ns=int(row["window_start_ns"]),
            n_bins=int(row["n_bins"]),
            model=self.texts[row["model"]],
            reason=self.texts[row["reason"]],
            **{name: float(row[name]) for name in SLOPE_FIELDS},
        )

    def __getitem__(self, region: str) -> SlopeEstimate:
        try:
            return self.final[region]
        except KeyError:
            raise KeyError(f"no target region {region!r}; {did_you_mean(region, self.final)}") from None

    @cached_property
    def final(self) -> dict[str, SlopeEstimate]:
        """The final estimate of each target region, by its name."""
        return final_estimates(self, self.regions)

    def __repr__(self) -> str:
        return f"<Estimates of {self.minutes} min: {', '.join(map(_short, self.final.values()))}>"

    def _repr_html_(self) -> str:
        rows = [
            (
                slope.region,
                formatting.tilt(slope),
                formatting.azimuth(slope),
                *formatting.short_columns(slope),
                formatting.state(slope),
            )
            for slope in self.final.values()
        ]
        short = [field.short for field in SHORT_FIELDS]
        columns = ("region", "tilt, °", "azimuth, °", *short, "state")
        return html.table_html(html.Table(columns, rows, f"Final estimates of {self.minutes} minutes"))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot each region's tilt over the site's time with its likelihood region."""
        series, time_ns = {}, np.empty(0, np.int64)
        for region in self.regions:
            if (rows := self.of_region(region)).size:
                angles = rows["tilt_deg"], rows["tilt_low_deg"], rows["tilt_high_deg"]
                series[region.name] = plots.TiltSeries(*angles, region.tilt_deg)
                time_ns = time_ns if time_ns.size else rows["time_ns"]
        return plots.tilts(time_ns, series, self.site, ax)

    @property
    def minutes(self) -> int:
        """Number of minutes."""
        return int(np.unique(self.rows["time_ns"]).size)

    def of_region(self, region: Region) -> TableArray:
        """The rows of one target."""
        return np.asarray(self.rows[self.rows["region"] == self.regions.index(region)])

    def columns(self) -> dict[str, list[Any]]:
        """The tidy table: a row for each target and minute; times in UTC, units in the names."""
        regions = [self.regions[place] for place in self.rows["region"].tolist()]
        states = {state.value: state.name.lower() for state in SlopeState}
        return {
            "time": [iso(time_ns) for time_ns in self.rows["time_ns"].tolist()],
            "region": [region.name for region in regions],
            "true_tilt_deg": [region.tilt_deg for region in regions],
            "true_azimuth_deg": [region.azimuth_deg for region in regions],
            "state": [states[state] for state in self.rows["state"].tolist()],
            **{name: self.rows[name].tolist() for name in (*SLOPE_FIELDS, *MEASURED)},
            "minutes": self.rows["n_bins"].tolist(),
            "flags": [_words(flags) for flags in self.rows["flags"].tolist()],
            "model": [self.texts[place] for place in self.rows["model"].tolist()],
            "reason": [self.texts[place] for place in self.rows["reason"].tolist()],
            "time_ns": self.rows["time_ns"].tolist(),
            "window_start_ns": self.rows["window_start_ns"].tolist(),
        }

    def to_frame(self) -> pd.DataFrame:
        """The tidy table as a pandas frame by UTC; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        columns: Mapping[str, Any] = self.columns()
        times = pd.to_datetime(np.asarray(columns["time_ns"], np.int64), utc=True).rename("time")
        return pd.DataFrame({name: values for name, values in columns.items() if name != "time"}, index=times)

    def to_xarray(self) -> xr.Dataset:
        """Angles and measurements over (time, region), and given slopes; needs ``fieldkit-slope[lab]``."""
        import xarray as xr

        targets = [self.regions[place] for place in dict.fromkeys(self.rows["region"].tolist())]
        time_ns, grid = self._grid()
        return xr.Dataset(
            {
                name: (("time", "region"), grid[name], _attributes(name))
                for name in ("state", *SLOPE_FIELDS, *MEASURED)
            },
            coords={
                "time": ("time", time_ns.astype("datetime64[ns]")),
                "region": ("region", [target.name for target in targets]),
                "true_tilt_deg": ("region", [target.tilt_deg for target in targets]),
                "true_azimuth_deg": ("region", [target.azimuth_deg for target in targets]),
            },
        )

    def _grid(self) -> tuple[IntArray, TableArray]:
        """Times, and rows over times and targets; without data where a region did not hold."""
        time_ns, row = np.unique(self.rows["time_ns"], return_inverse=True)
        places = {place: column for column, place in enumerate(dict.fromkeys(self.rows["region"].tolist()))}
        grid = np.zeros((time_ns.size, max(1, len(places))), ROW)
        for name in (*SLOPE_FIELDS, *MEASURED):
            grid[name] = np.nan
        grid["state"] = SlopeState.NO_DATA
        grid[row, [places[place] for place in self.rows["region"].tolist()]] = self.rows
        return time_ns, grid


_BUDGET_FIELDS = {
    "term": "name",
    "type": "kind",
    "standard_uncertainty": "uncertainty",
    "unit": "unit",
    "sensitivity_deg_per_unit": "sensitivity",
    "share_of_variance": "share",
}


def budget_columns(budgets: Budgets) -> dict[str, list[Any]]:
    """The budgets as a table, a row for each term of each region."""
    rows = [(name, term) for name, terms in budgets.items() for term in terms]
    numbers = {column: [getattr(term, name) for _, term in rows] for column, name in _BUDGET_FIELDS.items()}
    return {"region": [name for name, _ in rows], **numbers}


def _attributes(name: str) -> dict[str, str]:
    """Unit and meaning of a column as CF conventions have them."""
    about = SLOPE_FIELDS.get(name)
    return {"units": about.unit, "long_name": about.description} if about else {}


def _short(estimate: SlopeEstimate) -> str:
    return f"{estimate.region} {formatting.tilt_degrees(estimate)} ({formatting.state(estimate)})"


def iso(time_ns: int) -> str:
    """A moment in UTC as ISO 8601."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).isoformat()


def _texts(estimates: Sequence[SlopeEstimate]) -> Iterator[str]:
    for estimate in estimates:
        yield from (estimate.model, estimate.reason)


def _words(flags: int) -> str:
    return " ".join(str(flag.name).lower() for flag in Quality(flags))
