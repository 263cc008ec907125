"""What a notebook passes to a public function is of the right kind, or refused with the argument as place."""

import inspect
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

import fieldkit
from fieldkit.config import config_from_text
from fieldkit.model.door import kinds_of
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import RegionKind
from fieldkit.results.batch import EstimatedSessions
from fieldkit.weather import packaged_day
from tests.harness.next_steps import at

RESULTS = {"Minute", "FieldkitError", "Calibration", "Session", "Campaign", "calibrate", "__version__"}
"""Classes that fieldkit makes itself, and what is none."""


def doors():
    """Public functions, constructors of what they take, methods of sessions and campaigns."""
    for module in (fieldkit, fieldkit.calibrate):
        for name in sorted({*module.__all__} - RESULTS):  # alike in every process that runs tests
            door = getattr(module, name)
            yield name, door.__init__ if isinstance(door, type) else door
    for kind in (fieldkit.Session, fieldkit.Campaign):
        for name, method in vars(kind).items():
            if inspect.isfunction(method) and not name.startswith("_"):
                yield f"{kind.__name__}.{name}", method


ARGUMENTS = [(name, argument) for name, door in doors() for argument in kinds_of(inspect.unwrap(door))]
CONFIG = config_from_text("[site]\nlatitude_deg = 1\nlongitude_deg = 1\n", Path("x.h5"))
NUMBERS, TEXTS = (1.5, 0, 2j, (1, 1), [(1, 1)], [], ()), ("x", "station", b"x", Path("x"), ["x"])
VALUES = (object(), None, {}, {"a": object()}, datetime.now(UTC), *NUMBERS, *TEXTS, RegionKind.TARGET, CONFIG)
VALUES += (packaged_day(), EstimatedSessions((), {}, {}, (), False))


def accepts(kind, value) -> bool:
    try:
        kind.validate_python((value,))
    except ValidationError:
        return False
    return True


def test_every_argument_has_a_kind_that_is_checked():
    assert len(ARGUMENTS) > 150
    unchecked = [
        (name, parameter.name)
        for name, door in doors()
        for parameter in inspect.signature(door).parameters.values()
        if parameter.name not in ("self", *kinds_of(inspect.unwrap(door)))
        and parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL)
    ]
    assert unchecked == []


def call(door, values: dict):
    """Call it with values by name, also of arguments that have a place alone."""
    parameters = inspect.signature(door).parameters.values()
    alone = [parameter.name for parameter in parameters if parameter.kind is parameter.POSITIONAL_ONLY]
    places = [values.pop(name) for name in alone if name in values]
    return door(*places, **values)


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_a_value_of_another_kind_is_refused_with_its_argument(name, argument):
    door = dict(doors())[name]
    kinds = kinds_of(inspect.unwrap(door))
    parameters = inspect.signature(door).parameters.values()
    needed = [parameter.name for parameter in parameters if parameter.default is parameter.empty]
    right = {
        one: next(value for value in VALUES if one not in kinds or accepts(kinds[one], value))
        for one in needed
    }
    wrong = [value for value in VALUES if not accepts(kinds[argument], value)]
    assert wrong
    for value in wrong:
        with pytest.raises(ConfigError, check=at(Argument(argument))) as caught:
            call(door, {**right, argument: value})
        assert caught.value.fix


def test_a_misspelt_argument_is_answered_with_the_one_that_was_meant():
    for name, door in doors():
        parameters = inspect.signature(door).parameters.values()
        if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
            continue
        for parameter in parameters:
            if parameter.name != "self" and parameter.kind is not parameter.POSITIONAL_ONLY:
                misspelt = parameter.name + "s"
                with pytest.raises(ConfigError, check=at(Argument(misspelt))) as caught:
                    door(**{misspelt: 1})
                assert f"{parameter.name}" in str(caught.value.fix), name


PLACE, NOON = (37.7, -105.92, 2317.0), "2026-12-11T12:00:00+00:00"


@pytest.mark.parametrize(
    ("attempt", "place", "fix"),
    [
        (lambda: fieldkit.Site(137.0, -105.92), "latitude_deg", "latitude first"),
        (lambda: fieldkit.Site(37.7, 254.08), "longitude_deg", "east"),
        (lambda: fieldkit.Site(37.7, -105.92, 90_000.0), "elevation_m", "metres"),
        (lambda: fieldkit.plan(fieldkit.Site(*PLACE, "America/Denvr")), "timezone", "America/Denver"),
        (lambda: fieldkit.plan(fieldkit.Site(*PLACE, body="Marz")), "site.body", "mars"),
        (lambda: fieldkit.plan({"latitude_deg": 37.7}), "site", "site=(37.7"),
        (lambda: fieldkit.plan(PLACE, facets=(15.0, 180.0)), "facets", "facets=[(15.0, 180.0)]"),
        (lambda: fieldkit.plan(PLACE, options={"step_min": 5}), "options", "fieldkit.PlanOptions"),
        (lambda: fieldkit.sun(PLACE, 20), "at", "+09:00"),
        (lambda: fieldkit.sun(PLACE, NOON, [(500.0, 180.0)]), "facets", "0 to 90"),
        (lambda: fieldkit.estimate("a.h5", regions=["b15"]), "regions", "fieldkit.Region"),
        (lambda: fieldkit.estimate("a.h5", model="learnt"), "model", "learned"),
        (lambda: fieldkit.export("a.h5", "cvs"), "to='cvs'", "csv"),
        (lambda: fieldkit.estimate_together("a.h5"), "sessions", "sessions=['a.h5']"),
        (lambda: fieldkit.estimate_together(Path("a.h5")), "sessions", "a.h5"),
        (lambda: fieldkit.ImportOptions(columns="light"), "columns", "columns=['light']"),
        (lambda: fieldkit.calibrate.surface("a.h5", beds="b15"), "beds", "beds=['b15']"),
        (lambda: fieldkit.slope_map("a.h5", {"minutes": 20}), "window", "20m"),
    ],
)
def test_a_wrong_argument_is_answered_with_a_right_one(attempt, place, fix):
    with pytest.raises(fieldkit.FieldkitError, check=at(place)) as caught:
        attempt()
    assert fix in str(caught.value.fix)


@pytest.mark.parametrize(
    "time",
    [np.datetime64("2026-12-11T12:00"), pd.Timestamp(NOON), datetime.fromisoformat(NOON), NOON],
    ids=["numpy", "pandas", "datetime", "text"],
)
def test_times_and_numbers_of_other_libraries_are_what_they_mean(time):
    site, facets = np.array(PLACE, np.float32), pd.DataFrame({"tilt": [15], "azimuth": [180]}).to_numpy()
    (row,) = fieldkit.sun(site, time, facets)
    assert (row["time"], row["facets"][0]["tilt_deg"]) == (NOON, 15)
    days = pd.DatetimeIndex([NOON, NOON])
    assert [one["time"] for one in fieldkit.sun(PLACE, days)] == [NOON, NOON]
    assert (
        fieldkit.plan(PLACE, pd.Timestamp(NOON)).to_frame().equals(fieldkit.plan(PLACE, NOON[:10]).to_frame())
    )
