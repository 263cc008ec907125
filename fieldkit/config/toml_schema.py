"""The schema of ``fieldkit.toml``: one strict pydantic model per table, and what each key accepts in words.

The description of a field appears in the commented template, on the reference page and in error messages.
Defaults of physical parameters are those of the paper's Tables 1 and 3.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict, Field, model_validator
from pydantic.json_schema import SkipJsonSchema
from pydantic.main import create_model

from fieldkit.config.defaults import with_defaults_of_kind, with_defaults_of_world
from fieldkit.config.files import KeyPath
from fieldkit.estimation.estimator_keys import LEVEL_SD_DEG, EstimatorKeys
from fieldkit.estimation.prior import Prior
from fieldkit.estimation.surface_kinds import SAND, Kind
from fieldkit.model.alarm import Condition
from fieldkit.model.durations import times_of_day
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.light_meter import ConfiguredKind, Diffuse, Mounting
from fieldkit.model.quantities import LIMITS, Component, Quantity
from fieldkit.model.site import ELEVATIONS_M, Region, RegionKind

Degrees = Annotated[float, Field(ge=0, le=360)]
Tilt = Annotated[float, Field(ge=0, le=90)]
Fraction = Annotated[float, Field(ge=0.01, le=1)]
Relative = Annotated[float, Field(ge=0, le=1)]
HeldSeconds = Annotated[float, Field(ge=0, le=604_800)]
Cosine = Annotated[float, Field(ge=-1.001, le=1.001)]
Coefficient = Annotated[float, Field(ge=-1e6, le=1e6)]
Easting = Annotated[float, Field(ge=-1e8, le=1e8)]
Height = Annotated[float, Field(ge=ELEVATIONS_M[0], le=ELEVATIONS_M[1])]
Value = Annotated[float, Field(ge=-1e9, le=1e9)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=32)]
Probe = Annotated[str, Field(pattern=r"^[^:]+:[^:]+$", description="stream:channel, such as thermometer:T1")]
Pixel = Annotated[float, Field(ge=-100_000, le=100_000)]
Point = Annotated[list[Pixel], Field(min_length=2, max_length=2)]
GroundPoint = Annotated[list[Easting], Field(min_length=2, max_length=3)]
HorizonPoint = Annotated[tuple[Degrees, Annotated[float, Field(gt=-90, lt=90)]], Field(strict=False)]

Fault = Annotated[FaultKind, Field(strict=False, description="")]
ConditionName = Annotated[Condition, Field(strict=False, description="")]
SeverityWord = Literal["info", "warning", "error"]

NAN = math.nan
TABLE_1 = "(paper, Table 1)"


def _key(default: Any, description: str, **limits: Any) -> Any:
    """A key with a default."""
    return Field(default=default, description=description, **limits)


def _needed(example: Any, description: str, **limits: Any) -> Any:
    """A key that must be given."""
    return Field(examples=[example], description=description, **limits)


def _unset(example: Any, description: str, **limits: Any) -> Any:
    """A key that has no default."""
    return Field(default=None, examples=[example], description=description, **limits)


class Table(BaseModel):
    """A table of the configuration: no unknown keys, no silent conversions, no NaN."""

    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False
    )


class CampaignTable(Table):
    """Facts about the campaign that every session stores."""

    title: str = _key("", "subject of this campaign")
    operator: str = _key("", "name of the operator")
    orcid: str = _key("", "ORCID of the operator", pattern=r"^((\d{4}-){3}\d{3}[\dX])?$")
    description: str = _key("", "notes for later readers")
    license: str = _key("", "licence of the data, such as CC-BY-4.0")
    references: str = _key("", "papers or pages to cite")
    exact_place: bool = _key(True, "whether an RO-Crate has the session and exact place; else to 0.1 degrees")


class SiteTable(Table):
    """Location of the measurement, from which the sun is computed."""

    latitude_deg: float = _needed(35.558675, "degrees, north positive", ge=-90, le=90)
    longitude_deg: float = _needed(139.395232, "degrees, east positive", ge=-180, le=180)
    elevation_m: Height = _key(0.0, "metres above sea level, elsewhere above the datum")
    body: Literal["earth", "mars", "moon"] = _key(
        "earth", "the world; latitude and longitude are planetographic, east positive"
    )
    timezone: str = _key("UTC", "IANA name such as Asia/Tokyo; only for display")
    horizon: list[HorizonPoint] = _key(
        [], "pairs [azimuth, elevation] in degrees, or a CSV file of them, beside this file"
    )


class DeviceTable(Table):
    """One instrument: its driver and its port or identity."""

    driver: str = _needed("purethermal", "name of the driver, as `fieldkit devices` prints it", min_length=1)
    port: str = _key("", "its port, such as /dev/ttyUSB0, its address, such as 10.0.0.5:4001, or simulated")
    identity: str = _key("", "`vendor:product[:serial][-interface]` or a USB path")
    connect_timeout_s: float = _key(
        30.0, "seconds after which opening the instrument is given up", gt=0, le=3600
    )
    options: dict[str, Any] = _key({}, "options of this driver")


class PoseTable(Table):
    """Pose of the camera and the ground before it; also a file of its own.

    Give a place with angles or a quaternion, or a trajectory; and level ground or a DEM.
    """

    crs: str = _needed("EPSG:32613", "projected reference system in metres, of all places")
    east_m: Easting | None = _unset(412000.0, "the camera's easting")
    north_m: Easting | None = _unset(4172000.0, "its northing")
    height_m: Height | None = _unset(2305.0, "its height")
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] | None = _unset(
        0.0, "azimuth of the optical axis, from true north, clockwise"
    )
    pitch_deg: Annotated[float, Field(ge=-90, le=90)] | None = _unset(
        -30.0, "its elevation, negative downwards"
    )
    roll_deg: Annotated[float, Field(ge=-180, le=180)] | None = _unset(
        0.0, "turn about it, clockwise as the camera sees; default: 0"
    )
    quaternion: Annotated[list[Cosine], Field(min_length=4, max_length=4)] | None = _unset(
        [-0.5, 0.5, -0.5, 0.5], "x, y, z, w instead of angles, from right, down, forward to east, north, up"
    )
    trajectory: str | None = _unset(
        "run.csv", "a CSV or TUM file of poses over time, beside this file; a session holds its text"
    )
    hfov_deg: float = _needed(50.0, "horizontal field of view, from edge to edge", gt=0, lt=180)
    distortion: Annotated[list[Coefficient], Field(min_length=5, max_length=5)] | None = _unset(
        [-0.3, 0.1, 0.0, 0.0, 0.0], "k1, k2, p1, p2, k3 of the lens, as OpenCV gives them"
    )
    range_m: float = _needed(60.0, "farther ground is omitted", gt=0, le=10_000)
    ground_m: Height | None = _unset(2300.0, "height of level ground")
    dem: str | None = _unset("dem.tif", "a GeoTIFF of heights, beside this file")


class CameraTable(DeviceTable):
    """The thermal camera."""

    width_px: int | None = _unset(160, "frame width, to check regions against", gt=0, le=20_000)
    height_px: int | None = _unset(120, "frame height, to check regions against", gt=0, le=20_000)
    pose: PoseTable | None = _unset(
        {}, "where it stands and looks: a TOML file beside this one, or the table [camera.pose]"
    )


class MeterTable(DeviceTable):
    """A meter that is polled at an interval, or sends at its own."""

    every_s: float = _key(
        1.0,
        "seconds between two polls of the meter, or two records of one that sends by itself",
        ge=0.001,
        le=3600,
    )


class LuxTable(MeterTable):
    """The illuminometer."""

    range_max_lx: float | None = _unset(
        100000.0, "upper end of the meter's range; readings there are flagged", ge=100, le=1_000_000
    )


class IrradianceTable(Table):
    """Measurement of direct sunlight: by a stream of dni, else ghi, else gti, else by the light meter."""

    measures: dict[str, Component] = _key(
        {}, 'by stream in W/m2: what it measures, such as {sun = "ghi"}; gti: on the plane below'
    )
    stream: str = _key("", "stream of the light meter; default: the first of dni, ghi, gti, lux")
    model: ConfiguredKind = _key("eq10", "lux to W/m2; eq10 is the paper's eq. (10), divided by par_fraction")
    par_fraction: Fraction = _key(
        0.44, "share of sunlight between 400 and 700 nm; 1.0 is the paper to the letter"
    )
    efficacy_lm_w: float = _key(105.0, "lumen per watt of direct sunlight, for efficacy", ge=10, le=683)
    factor: float | None = _unset(
        0.0091, 'W/m2 per unit of the reading, for calibrated; or "@name"', ge=1e-6, le=1e6
    )
    factor_sd: float = _key(0.0, "standard uncertainty of factor; a record brings its own", ge=0, le=1e6)
    mounting: Mounting = _key("horizontal", "how the light meter, or that of gti, is mounted")
    plane_tilt_deg: Tilt = _key(0.0, "tilt of the meter, for in-plane")
    plane_azimuth_deg: Degrees = _key(0.0, "azimuth of the meter from north, for in-plane")
    diffuse: Diffuse = _key(
        "fraction", "how diffuse light is subtracted from the reading; none: a baffled tube"
    )
    diffuse_fraction: float = _key(0.15, "diffuse share of the reading, for diffuse = fraction", ge=0, lt=1)


class SurfaceTable(Table):
    """The surface of the regions."""

    kind: Kind = _key(
        SAND, "gives the defaults of exchange, albedo, slab and tilt that differ from those of sand"
    )
    same: bool = _key(
        False, "whether all beds are of one heap, laid at one time: they differ less, and slopes are sharper"
    )
    albedo: float = _key(0.20, f"A of the balance {TABLE_1}", ge=0, lt=1)
    emissivity: Fraction = _key(0.90, 'in the camera\'s band, 8-14 um; or "@name" of a calibration')
    emissivity_sd: float = _key(
        0.0, "standard uncertainty of emissivity; a record brings its own", ge=0, lt=1
    )
    emissivity_broadband: Fraction | None = _unset(
        0.90, "for the energy balance, all wavelengths; default: emissivity"
    )
    reflected_temperature_c: float = _key(
        -40.0, "reflected temperature: that of the sky in the camera's band", ge=-120, le=100
    )


class AirTable(Table):
    """The air over the ground and its heat exchange."""

    heat_capacity_j_kg_k: float = _key(1000.0, f"c_p {TABLE_1}", ge=500, le=2500)
    density_kg_m3: float = _key(1.21, f"rho {TABLE_1}", ge=0.001, le=2)
    exchange_m_s: float = _key(0.015, f"C_H U {TABLE_1}; 0 without air", ge=0, le=1)


class SlabTable(Table):
    """Heat storage of the sand, for full; the learned model starts from it."""

    depth_m: float = _key(0.03, 'depth of the sand above the insulating sheet; or "@name"', ge=0.001, le=2)
    conductivity_w_m_k: float = _key(0.25, '0.2 to 0.35 for dry loose sand; or "@name"', ge=0.0005, le=10)
    heat_capacity_j_m3_k: float = _key(1.3e6, "density times specific heat", ge=1e5, le=5e6)
    conductivity_sd: Relative = _key(0.2, "relative standard uncertainty")
    capacity_sd: Relative = _key(0.1, "relative standard uncertainty")


def _times_of_day(text: str) -> str:
    times_of_day(text)
    return text


class RecordTable(Table):
    """Choice of the frames that are kept; who may follow."""

    sampling: Literal["all", "bursts"] = _key("bursts", "all frames, or a burst every every_s seconds")
    every_s: float = _key(60.0, "seconds from burst to burst", ge=0.1, le=86_400)
    burst_frames: int = _key(3, "frames in a burst", ge=1, le=1000)
    shutter_before_burst: bool = _key(True, "run the shutter correction before each burst")
    split: Annotated[str, AfterValidator(_times_of_day)] = _key(
        "",
        "when a session ends and the next begins, at the site: every 1d or 6h from midnight on, "
        "or at a time of day such as 09:00",
        examples=["1d"],
    )
    metrics: str = _key(
        "",
        "file for the numbers of the recording in OpenMetrics, such as of a node exporter's textfile folder",
        examples=["/var/lib/node_exporter/fieldkit.prom"],
    )


class TriggerTable(Table):
    """A threshold at which a recording starts, stops or is marked; in the unit that `fieldkit live` shows."""

    do: Literal["start", "stop", "mark"] = _needed("start", "start is of fieldkit record --on-trigger")
    channel: str = _needed("lux", "a meter's stream, or stream:channel, such as thermometer:T1", min_length=1)
    above: Value | None = _unset(20000.0, "acts when the value is above; this or below is needed")
    below: Value | None = _unset(5.0, "acts when the value is below")
    hold_s: HeldSeconds = _key(0.0, "seconds that the value must stay there")
    before_s: float = _key(
        120.0, "of a start: seconds before it that are recorded too, as far as memory has them", ge=0, le=300
    )


class FailSafeTable(Table):
    """An output that falls back, within 5 s, when the recording ends or dies in any way."""

    line: str = _key("", "serial port whose DTR is up while a recording lives", examples=["/dev/ttyUSB1"])
    command: list[str] = _key(
        [], "program and arguments to run when it does not any more", examples=[["/home/pi/heater-off.sh"]]
    )


class LimitsTable(Table):
    """Limits of a region's temperature and tilt."""

    temperature_min_c: float | None = _unset(0.0, "alarm below; default: none", ge=-100, le=200)
    temperature_max_c: float | None = _unset(60.0, "alarm above; default: none", ge=-100, le=200)
    temperature_rate_k_min: float | None = _unset(
        2.0, "alarm if a minute mean differs by more from the one before; default: none", gt=0, le=100
    )
    tilt_min_deg: Tilt | None = _unset(5.0, "alarm if the estimated tilt is below; default: none")
    tilt_max_deg: Tilt | None = _unset(30.0, "alarm if the estimated tilt is above; default: none")
    tilt_probability: Annotated[float, Field(gt=0, lt=1)] | None = _unset(
        0.05, "alarm if P(tilt > tilt_max_deg) is above, from the likelihood region; default: none"
    )


class AlarmsTable(LimitsTable):
    """Conditions and outputs of alarms while recording; the limits are those of all regions."""

    disk_reserve_mb: float = _key(64.0, "frames are no longer stored when less is free", ge=1, le=10_000_000)
    off: list[ConditionName] = _key([], "conditions that raise no alarm", examples=[["cloud", "shade"]])
    hold_s: dict[ConditionName, HeldSeconds] = _key(
        {}, "by condition, seconds it must last to raise its alarm, such as {lost = 30}"
    )
    clear_s: dict[ConditionName, HeldSeconds] = _key(
        {}, "by condition, seconds it must be over to clear its alarm"
    )
    severity: dict[ConditionName, SeverityWord] = _key(
        {}, 'by condition: info, warning or error, such as {cloud = "warning"}'
    )
    garbled_per_min: int = _key(
        5, "invalid records of an instrument in a minute that are an alarm", ge=1, le=100_000
    )
    region: dict[Name, LimitsTable] = _key(
        {}, "limits of single regions, in place of those above, by the region's name"
    )
    bell: bool = _key(True, "ring the terminal's bell")
    send: SeverityWord = _key("warning", "least severity for bell, command and services")
    command: list[str] = _key(
        [],
        "program and arguments to run for every alarm; FIELDKIT_TEXT and others describe it",
        examples=[["/home/pi/alarm.sh"]],
    )
    services_file: str = _key(
        "",
        "private file outside the campaign, an address such as mqtt://HOST/TOPIC on each line; "
        "needs fieldkit-slope[alarms]",
        examples=["~/.config/fieldkit/services.txt"],
    )
    image: bool = _key(True, "send the camera's image with an alarm, where the service takes one")
    home_assistant: bool = _key(
        False, "announce meters, regions, alarms and the image to Home Assistant, by the broker of services"
    )


class SimulationTable(Table):
    """The simulated field, for devices whose port is simulated."""

    weather: str = _key(
        "alamosa-2016-01-01", "the packaged day, clear, or a file of SURFRAD or BSRN", min_length=1
    )
    start: AwareDatetime | None = _unset("2016-01-01T12:00:00-07:00", "start time with its offset from UTC")
    speed: Annotated[float, Field(ge=0.001, le=1_000_000)] | Literal["max"] = _key(
        1.0, "simulated seconds per second; max: as fast as possible"
    )
    seed: int = _key(1, "random seed; the same seed gives the same session", ge=0, le=2**63 - 1)
    drawn: bool = _key(
        False, "the seed also draws sand, heat exchange, gusts, sky and the light meter's error"
    )
    faults: list[Fault] = _key([], f"faults to simulate: any of {', '.join(FaultKind)}")
    sand_depth_m: float = _key(0.02, "depth of the sand above the insulating sheet", ge=0.001, le=1)
    albedo: float = _key(0.20, "true albedo of the sand", ge=0, lt=1)
    emissivity: Fraction = _key(0.90, "true emissivity of the sand")
    drift_px: Point = _key(
        [0.0, 0.0], "right and down: shift of the camera's frame by the end of the session"
    )
    pan_deg: float = _key(0.0, "turn of the camera to the left by the end of the session", ge=-30, le=30)
    jitter_px: float = _key(0.0, "shake of the camera, at most, in x and in y", ge=0, le=20)
    camera_offset_k: dict[Name, Annotated[float, Field(ge=-20, le=20)]] = _key(
        {}, "by camera, how much too warm it shows everything, such as {second = 0.4}"
    )
    terrain: bool = _key(False, "sand in the relief of camera.pose's dem instead of level ground")


class RegionOutline(Table):
    """A region's outline and measured properties: what campaign file, page, request and JSON share.

    A `Region`, and its row in a session, has fields of the same names, with NaN for what is unknown.
    """

    name: Name = _needed("b15", "letters, digits, - and _")
    kind: Literal["reference", "target", "blackbody", "foil"] = _key(
        "target",
        "reference: of known slope, flat and, better, also a bed that was measured; blackbody: of known "
        "temperature by its probes, such as a can of water; foil: aluminium, to see what the ground reflects",
    )
    points_px: list[Point] = _needed(
        [[29, 29], [66, 28], [66, 53], [24, 56]],
        "corners [x, y]; x to the right, y down, the first pixel is [0, 0]",
        min_length=3,
        max_length=64,
    )
    points_m: list[GroundPoint] = _key(
        [],
        "instead, corners [east, north] or [east, north, height] on the ground of camera.pose",
        max_length=64,
    )
    tilt_deg: Tilt | None = _unset(15.0, "measured tilt from horizontal; reference: 0")
    azimuth_deg: Degrees | None = _unset(180.0, "measured azimuth of the normal from north, clockwise")
    emissivity: Fraction | None = _unset(
        0.93, 'in the camera\'s band, where it differs from surface.emissivity; or "@name"'
    )
    camera: str = _key("", "the camera it lies in, such as second of [device.second]; default: the first")

    @classmethod
    def of(cls, region: Region) -> Self:
        """The statement of a region; None for what is unknown."""
        stated = {
            key: None if math.isnan(value := getattr(region, key)) else value
            for key in ("tilt_deg", "azimuth_deg", "emissivity")
        }
        # not validated: names and corners in a session need not be those that a new campaign may have
        return cls.model_construct(
            name=region.name,
            kind=region.kind.name.lower(),
            points_px=[list(corner) for corner in region.points_px],
            points_m=[list(corner[: 2 if math.isnan(corner[2]) else 3]) for corner in region.points_m],
            camera=region.camera,
            **stated,
        )

    @property
    def region(self) -> Region:
        """The region as it is estimated; a reference of unknown tilt is horizontal."""
        reference = self.kind == "reference"
        tilt_deg = self.tilt_deg if self.tilt_deg is not None else 0.0 if reference else NAN
        azimuth_deg = self.azimuth_deg if self.azimuth_deg is not None else 0.0 if tilt_deg == 0.0 else NAN
        return Region(
            name=self.name,
            kind=RegionKind[self.kind.upper()],
            points_px=tuple((x, y) for x, y in self.points_px),
            tilt_deg=tilt_deg,
            azimuth_deg=azimuth_deg,
            emissivity=NAN if self.emissivity is None else self.emissivity,
            points_m=tuple((at[0], at[1], at[2] if len(at) > 2 else NAN) for at in self.points_m),
            camera="" if self.camera == "camera" else self.camera,
        )


class RegionOutlines(Table):
    """Outlines that are drawn on a session."""

    region: list[RegionOutline]


class RegionTable(RegionOutline):
    """A region: a polygon of the frame."""

    emissivity_sd: float = _key(
        0.0, "standard uncertainty of emissivity; a record brings its own", ge=0, lt=1
    )
    level_sd_deg: Annotated[float, Field(ge=0.01, le=10)] | None = _unset(
        0.5, f"standard uncertainty of a reference's slope, by its level; default: {LEVEL_SD_DEG}"
    )
    surface_kind: Kind | None = _unset(
        "rock", "its kind of surface, where it differs from surface.kind; a target's, for learned"
    )
    offset_k: float = _key(
        0.0, 'how much too warm the camera shows it; or "@name" of a uniformity', ge=-10, le=10
    )
    probes: list[Probe] = _key(
        [], 'contact thermometers in it, as "stream:channel", such as ["thermometer:T1"]'
    )
    horizon: list[HorizonPoint] = _key([], "its own horizon instead of the site's: pairs or a CSV file")


def _rising(ends: list[float]) -> list[float]:
    if ends[0] >= ends[1]:
        raise ValueError("give the least value, then the greatest")
    return ends


def _possible(row: Quantity) -> tuple[Any, Any]:
    """Type and field of the limits of a quantity, whose ends have limits of their own."""
    low, high = row.shown_limits
    least, greatest = row.possible_limits
    end = Annotated[float, Field(ge=least, le=greatest)]
    ends = Annotated[list[end], Field(min_length=2, max_length=2), AfterValidator(_rising)]
    text = f"{row.words}, least and greatest; default: {low:.4g} to {high:.4g}"
    return ends | None, _unset([float(f"{low:.4g}"), float(f"{high:.4g}")], text)


_RANGES: dict[str, Any] = {row.limits_key: _possible(row) for row in LIMITS.values()}
_Possible: type[Table] = create_model("PossibleTable", __base__=Table, **_RANGES)


class PossibleTable(_Possible):  # type: ignore[misc, valid-type]
    """Limits of each quantity, where they differ, such as on a hot plate; a value beyond is not used."""


class Tables(Table):
    """The whole of ``fieldkit.toml``; tables that are dataclasses are strict field by field."""

    model_config: ClassVar[ConfigDict] = ConfigDict(strict=False)

    schema_: Literal[1] = _key(1, "version of this layout", alias="schema")
    campaign: CampaignTable = CampaignTable()
    site: SiteTable
    camera: CameraTable | None = None
    lux: LuxTable | None = None
    thermometer: MeterTable | None = _key(None, "The contact thermometer.")
    device: dict[Name, MeterTable] = Field(default={})
    irradiance: IrradianceTable = IrradianceTable()
    surface: SurfaceTable = SurfaceTable()
    air: AirTable = AirTable()
    estimator: EstimatorKeys = EstimatorKeys()
    slab: SlabTable = SlabTable()
    prior: Prior = Prior()
    record: RecordTable = RecordTable()
    trigger: dict[Name, TriggerTable] = Field(default={})
    fail_safe: FailSafeTable = FailSafeTable()
    alarms: AlarmsTable = AlarmsTable()
    limits: PossibleTable = PossibleTable()
    simulation: SimulationTable | None = None
    calibration: SkipJsonSchema[dict[str, dict[str, Any]]] = {}  # active records, written by fieldkit only
    region: list[RegionTable] = Field(default=[])

    @model_validator(mode="before")
    @classmethod
    def _defaults_of_world_and_kind(cls, document: Any) -> Any:
        if not isinstance(document, Mapping):
            return document
        return with_defaults_of_kind(with_defaults_of_world(document))


# What each key accepts, in words: the template, the error messages and the reference page read it from here.

Node = dict[str, Any]
"""A piece of a JSON schema, without references and without the ``null`` of optional keys."""


@functools.cache
def json_schema() -> Node:
    """The JSON schema of ``fieldkit.toml``, for editors that complete and check."""
    schema = Tables.model_json_schema()
    for table in schema["$defs"].values():
        if "description" in table:  # a dataclass explains its fields there to other programs
            table["description"] = table["description"].partition("\n\nAttributes\n")[0]
    return schema


def node_at(path: KeyPath) -> Node | None:
    """The schema of the value that `path` leads to, or None if there is no such key."""
    node: Node | None = resolve(json_schema())
    for part in path:
        if node is None:
            return None
        node = _step(node, part)
    return node


def known_keys(path: KeyPath) -> list[str]:
    """The keys of the table that `path` leads to."""
    return list((node_at(path) or {}).get("properties", ()))


def resolve(node: Node) -> Node:
    """The node with references followed; of an optional key, what it is when given."""
    if "$ref" in node:
        return {**json_schema()["$defs"][node["$ref"].rsplit("/", 1)[1]], **node, "$ref": None}
    branches = [branch for branch in node.get("anyOf", ()) if branch.get("type") != "null"]
    if len(branches) == 1:
        return {**resolve(branches[0]), **{key: node[key] for key in node if key != "anyOf"}}
    return node


def describe_value(node: Node | None) -> str:
    """Values that a key accepts: ``a number from -90 to 90 (degrees, north positive)``."""
    if node is None:
        return "something else"
    about = node.get("description", "")
    return f"{kind(node)} ({about})" if about else kind(node)


def _step(node: Node, part: str | int) -> Node | None:
    if isinstance(part, int):
        below = dict(enumerate(node.get("prefixItems", ()))).get(part, node.get("items"))
    else:
        named = node.get("patternProperties", {"": node.get("additionalProperties")})
        below = node.get("properties", {}).get(part, *named.values())
    return resolve(below) if isinstance(below, dict) else None


def kind(node: Node) -> str:
    """The kind of value, without its description: ``a number from -90 to 90``."""
    if "anyOf" in node:
        return " or ".join(kind(resolve(branch)) for branch in node["anyOf"])
    if "enum" in node:
        return "one of " + ", ".join(f'"{value}"' for value in node["enum"])
    if "const" in node:
        return repr(node["const"]).replace("'", '"')
    if node.get("format") == "date-time":
        return "a time with its offset from UTC, such as 2016-01-01T12:00:00-07:00"
    if node["type"] == "array":
        least, most = node.get("minItems"), node.get("maxItems")
        return "a list" + (f" of {'' if least == most else 'at least '}{least} values" if least else "")
    words = {"number": "a number", "integer": "a whole number", "string": "text", "boolean": "true or false"}
    return words.get(node["type"], "a table") + _range(node)


def _range(node: Node) -> str:
    if "minimum" in node and "maximum" in node:
        return f" from {node['minimum']:.10g} to {node['maximum']:.10g}"
    limits = {
        "exclusiveMinimum": "above",
        "minimum": "at least",
        "exclusiveMaximum": "below",
        "maximum": "at most",
    }
    words = [f"{word} {node[limit]:.10g}" for limit, word in limits.items() if limit in node]
    return " " + " and ".join(words) if words else ""
