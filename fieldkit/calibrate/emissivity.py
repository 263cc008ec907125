"""The emissivity of a sample in the camera's band, from a recorded session."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldkit.calibrate import measurement
from fieldkit.calibrate.inputs import open_to_calibrate, write_lines
from fieldkit.calibrate.result import Calibration, make_record
from fieldkit.calibration import steady_pairs
from fieldkit.calibration.calibration_record import instrument_of, validity
from fieldkit.calibration.emissivity import Emissivity, Pairs
from fieldkit.calibration.uncertainty import effective_freedom
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.results.sources import SessionOrFile, Settings, log_warning
from fieldkit.views.calibration_figure import emissivity_figure
from fieldkit.views.plotting import available, svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WITH_TAPE = "reference emissivity (tape), ASTM E1933"
WITH_THERMOMETER = "contact thermometer, ASTM E1933"


@dataclass(frozen=True, repr=False)
class EmissivityCalibration(Calibration):
    """An emissivity with the pairs of surface and apparent temperature that it was fitted to."""

    fit: Emissivity
    pairs: Pairs
    setup: measurement.MeasurementSetup

    def plot(self) -> Figure:
        """The pairs with the fitted line, and the error budget."""
        return emissivity_figure(self.fit, self.pairs, self.setup.band)

    def save(self, folder: Path | None = None) -> Path:
        """Write the record file, and beside it the figure if matplotlib is installed; the record's path."""
        path = super().save(folder)
        if available():
            write_lines(path.with_suffix(".svg"), [svg(self.plot())])
        return path


def emissivity(
    session: SessionOrFile,
    *,
    sample: str,
    region: str | None = None,
    reflected: str | float | None = None,
    options: measurement.MeasurementOptions | None = None,
    settings: Settings = (),
    notify: Callable[[str], None] = log_warning,
) -> EmissivityCalibration:
    """Find the emissivity of a sample from a session with camera and contact thermometer, or with tape.

    The fit itself is `fieldkit.calibration.emissivity.fit_emissivity`.

    Parameters
    ----------
    session : Session or path
        A recording in which the surface was steady at several temperatures.
    sample : str
        What was measured, such as ``dry-silica-sand``; names the record.
    region, reflected : optional
        Shorthand for the options of these names: ``region="flat", reflected=-42``.
    options : MeasurementOptions, optional
        Regions, instruments, band, path through the air and standard uncertainties.
    settings : mapping, or sequence of ``KEY=VALUE``
        Other values for keys of the configuration, such as ``{"albedo": 0.25}``.
    notify : callable
        Receives warnings, such as damaged samples that were excluded.

    Raises
    ------
    ConfigError
        If region, thermometer or probe is ambiguous.
    CalibrationError
        If the session does not determine an emissivity.

    References
    ----------
    ASTM E1933, Standard Practice for Measuring and Compensating for Emissivity Using Infrared Imaging
    Radiometers.

    Examples
    --------
    >>> options = fieldkit.calibrate.MeasurementOptions(reflected="b05", temperatures=9, duration="15m")
    >>> recorded = fieldkit.calibrate.record_emissivity(
    ...     "sandslope", sample="dry-sand", options=options, settings={"simulation.speed": "max"}
    ... )
    >>> fieldkit.calibrate.emissivity(recorded.path, sample="dry-sand", reflected="b05")
    <EmissivityCalibration: emissivity 0.900 ± 0.032 (k=2)   band 8-14 um, flat   residual 0.03 K   n=4 ...>
    """
    options = options or measurement.MeasurementOptions()
    options = replace(
        options,
        region=region or options.region,
        reflected=options.reflected if reflected is None else reflected,
    )
    with open_to_calibrate(session, settings, notify) as (opened, config):
        estimator, regions = config.estimator_settings(), opened.regions or config.regions
        streams = tuple(opened.streams.values())
        setup = measurement.measurement_setup(opened.path, streams, regions, estimator.probes, options)
        collector = measurement.ReadingCollector(setup)
        for entry in opened.samples():
            collector.add(entry)
        pairs, remarks = steady_pairs.pairs_of(steady_pairs.steady_intervals(_checked_readings(collector)))
        fit, kind = setup.fit(pairs), estimator.kinds.get(setup.sample.name, estimator.kind)
        fit = replace(fit, remarks=(*setup.remarks, *remarks, *fit.remarks))
        record = make_record(
            "emissivity",
            sample,
            fit.value,
            "1",
            fit.budget,
            [opened],
            method=WITH_THERMOMETER if setup.tape is None else WITH_TAPE,
            degrees_of_freedom=fit.freedom,
            band=setup.band.label,
            angle_deg=math.nan if options.angle_deg is None else options.angle_deg,
            instrument=instrument_of(setup.camera),
            details=_details(fit, pairs, setup) | {"surface": f"{kind}, region {setup.sample.name}"},
            settings={"sample": sample, **options.as_settings()},
            remarks=fit.remarks,
        )
        used_by = f'surface.emissivity = "@{sample}"'
        summary = f"{_summary(fit, pairs, setup)}\nholds for {validity(record)}"
        return EmissivityCalibration(record, summary, used_by, config.calibration, fit, pairs, setup)


def _checked_readings(collector: measurement.ReadingCollector) -> steady_pairs.Readings:
    """The readings; raises `CalibrationError` if clocks or probe and region do not fit together."""
    readings, setup = collector.readings(), collector.setup
    if setup.tape is None:
        steady_pairs.refuse_shifted_clocks(readings)
        steady_pairs.refuse_other_bed(readings, collector.other_probes_k(), setup.probe_name)
    return readings


def _details(found: Emissivity, pairs: Pairs, setup: measurement.MeasurementSetup) -> dict[str, Any]:
    """Details of a record of this kind beside value and budget; temperatures in °C."""
    without_foil = "fitted" if setup.is_reflected_fitted else "given"
    return {
        "temperature_range_c": _celsius([pairs.contact_k.min(), pairs.contact_k.max()]),
        "reflected_temperature_c": _celsius([found.reflected_k])[0],
        "reflected_by": "foil, ISO 18434-1" if setup.foil is not None else without_foil,
        "pairs": len(pairs),
        "chi_square": found.chi_square,
        "residual_k": found.residual_k,
        "effective_degrees_of_freedom": effective_freedom(found.budget, found.freedom),
        "contact_c": _celsius(pairs.contact_k),
        "apparent_c": _celsius(pairs.apparent_k),
        "reflected_c": _celsius(pairs.reflected_k),
    }


def _celsius(kelvin: Any) -> list[float]:
    return [round(float(value_k) - CELSIUS_ZERO_K, 3) for value_k in kelvin]


def _summary(found: Emissivity, pairs: Pairs, setup: measurement.MeasurementSetup) -> str:
    coldest, warmest = pairs.contact_k.min() - CELSIUS_ZERO_K, pairs.contact_k.max() - CELSIUS_ZERO_K
    return (
        f"emissivity {found.value:.3f} ± {found.expanded:.3f} (k=2)   band {setup.band.label}   "
        f"residual {found.residual_k:.2f} K   n={len(pairs)}   span {coldest:.1f}→{warmest:.1f} °C"
    )
