"""fieldkit: terrain slope from surface temperature, from instruments to report.

Everything that the command line does is a function here. Nothing heavy is imported before it is used.

>>> import fieldkit
>>> with fieldkit.open_session("recordings/20261211T030000Z.h5") as session:          # doctest: +SKIP
...     session.estimate(model="full")["b15"].tilt_deg
"""

from importlib import import_module as _import_module
from inspect import isfunction as _isfunction
from typing import TYPE_CHECKING as _TYPE_CHECKING

from fieldkit.model.version import __version__ as __version__

if _TYPE_CHECKING:
    from fieldkit import calibrate as calibrate
    from fieldkit.drivers.discovery import find_devices as find_devices
    from fieldkit.drivers.instrument import open_device as open_device
    from fieldkit.estimation.estimator import Minute as Minute
    from fieldkit.model.errors import FieldkitError as FieldkitError
    from fieldkit.model.site import Region as Region
    from fieldkit.model.site import Site as Site
    from fieldkit.recording.campaign import Campaign as Campaign
    from fieldkit.recording.campaign import init_campaign as init_campaign
    from fieldkit.recording.campaign import open_campaign as open_campaign
    from fieldkit.recording.catalogue import catalogue as catalogue
    from fieldkit.recording.doctor import doctor as doctor
    from fieldkit.recording.in_progress import mark as mark
    from fieldkit.recording.in_progress import status as status
    from fieldkit.recording.in_progress import stop as stop
    from fieldkit.recording.plan import PlanOptions as PlanOptions
    from fieldkit.recording.plan import plan as plan
    from fieldkit.recording.predict import predict as predict
    from fieldkit.recording.preview import live as live
    from fieldkit.recording.record import record as record
    from fieldkit.recording.replay import replay as replay
    from fieldkit.recording.simulate import simulate as simulate
    from fieldkit.recording.suggesting import suggest_regions as suggest_regions
    from fieldkit.results.check import check as check
    from fieldkit.results.comparison import compare as compare
    from fieldkit.results.estimate import estimate as estimate
    from fieldkit.results.export import export as export
    from fieldkit.results.importing import ImportOptions as ImportOptions
    from fieldkit.results.importing import import_into as import_into
    from fieldkit.results.importing import import_recording as import_recording
    from fieldkit.results.report import ReportOptions as ReportOptions
    from fieldkit.results.report import report as report
    from fieldkit.results.session import Session as Session
    from fieldkit.results.session import open_session as open_session
    from fieldkit.results.slope_map import slope_map as slope_map
    from fieldkit.results.sun_angles import sun as sun
    from fieldkit.results.together import estimate_together as estimate_together

_HOMES = {
    "fieldkit.drivers.discovery": ("find_devices",),
    "fieldkit.drivers.instrument": ("open_device",),
    "fieldkit.estimation.estimator": ("Minute",),
    "fieldkit.model.errors": ("FieldkitError",),
    "fieldkit.model.site": ("Region", "Site"),
    "fieldkit": ("calibrate",),
    "fieldkit.recording.campaign": ("Campaign", "init_campaign", "open_campaign"),
    "fieldkit.recording.catalogue": ("catalogue",),
    "fieldkit.results.check": ("check",),
    "fieldkit.results.comparison": ("compare",),
    "fieldkit.results.estimate": ("estimate",),
    "fieldkit.results.export": ("export",),
    "fieldkit.results.importing": ("ImportOptions", "import_into", "import_recording"),
    "fieldkit.recording.doctor": ("doctor",),
    "fieldkit.recording.in_progress": ("mark", "status", "stop"),
    "fieldkit.recording.plan": ("PlanOptions", "plan"),
    "fieldkit.recording.predict": ("predict",),
    "fieldkit.recording.preview": ("live",),
    "fieldkit.recording.record": ("record",),
    "fieldkit.recording.replay": ("replay",),
    "fieldkit.results.report": ("ReportOptions", "report"),
    "fieldkit.results.session": ("Session", "open_session"),
    "fieldkit.recording.simulate": ("simulate",),
    "fieldkit.recording.suggesting": ("suggest_regions",),
    "fieldkit.results.slope_map": ("slope_map",),
    "fieldkit.results.sun_angles": ("sun",),
    "fieldkit.results.together": ("estimate_together",),
}
"""Where each public name is defined; the module is imported when the name is first used."""

_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}
__all__ = ["__version__", *_MODULE_OF]  # noqa: PLE0604 (a test compares it with the imports above)


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        from fieldkit.model.spelling import nearest

        near = None if name.startswith("_") else nearest(name, __all__)
        hint = f"; did you mean {near!r}?" if near else ""
        raise AttributeError(f"module 'fieldkit' has no attribute {name!r}{hint}")
    module = _import_module(_MODULE_OF[name])
    value = _import_module(f"{module.__name__}.{name}") if name == "calibrate" else getattr(module, name)
    if _isfunction(value):
        value = _import_module("fieldkit.model.door").checked(value)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
