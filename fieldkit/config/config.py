"""A checked configuration, as the objects that other rooms use."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomlkit
from tomlkit.items import String, StringType, Trivia

from fieldkit.calibration.calibration_record import CalibrationRecord, from_document
from fieldkit.config.references import calibration_folder, campaign_folder
from fieldkit.config.toml_schema import DeviceTable, LuxTable, Tables
from fieldkit.model.device import DeviceSettings
from fieldkit.model.limits import changed_rows
from fieldkit.model.site import Region, Site
from fieldkit.model.units import CELSIUS_ZERO_K

if TYPE_CHECKING:
    from fieldkit.config.pose import CameraPose
    from fieldkit.estimation.settings import EstimatorSettings
    from fieldkit.physics.energy_balance import SurfaceParameters
    from fieldkit.physics.irradiance import IrradianceModel
    from fieldkit.physics.trajectory import CameraPath

NAN = float("nan")
RECORDINGS = "recordings"
"""Folder of a campaign's sessions."""


@dataclass(frozen=True)
class Config:
    """The configuration of the campaign whose ``fieldkit.toml`` is at `path`."""

    path: Path
    tables: Tables

    @property
    def directory(self) -> Path:
        """The campaign's folder."""
        return self.path.parent

    @property
    def recordings(self) -> Path:
        """Folder of the campaign's sessions."""
        return self.directory / RECORDINGS

    @property
    def results(self) -> Path:
        """Folder for tables of estimates."""
        return self.directory / "results"

    @property
    def calibration(self) -> Path:
        """Folder of the campaign's calibrations."""
        return calibration_folder(self.path)

    def calibrations(self) -> dict[str, CalibrationRecord]:
        """The active records, by the key that refers to them."""
        return {key: from_document(record, key) for key, record in self.tables.calibration.items()}

    @property
    def reports(self) -> Path:
        """Folder for reports."""
        return self.directory / "reports"

    @property
    def site(self) -> Site:
        """Site of the measurement."""
        return Site(**self.tables.site.model_dump(exclude={"horizon"}))

    @property
    def pose(self) -> CameraPose | None:
        """Pose of the camera, if it is configured."""
        from fieldkit.config.pose import CameraPose

        table = None if self.tables.camera is None else self.tables.camera.pose
        return None if table is None else CameraPose(table, campaign_folder(self.path))

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions, in the order of the file; a reference of unknown tilt is horizontal."""
        return tuple(table.region for table in self.tables.region)

    def with_kind(self, region: str, kind: str) -> Config:
        """The configuration with one region of another kind, such as ``foil``."""
        regions = [
            table.model_copy(update={"kind": kind}) if table.name == region else table
            for table in self.tables.region
        ]
        return replace(self, tables=self.tables.model_copy(update={"region": regions}))

    @property
    def devices(self) -> tuple[DeviceSettings, ...]:
        """The instruments: camera, lux, thermometer, then the others in the order of the file."""
        limits = self.limits
        return tuple(replace(_device(name, table), limits=limits) for name, table in self._device_tables())

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Rows of the table of limits that differ here, in SI units."""
        return changed_rows(self.tables.limits.model_dump(exclude_none=True), self.tables.site.body)

    def irradiance_model(self) -> IrradianceModel:
        """Rules that derive direct irradiance from the light meter."""
        from fieldkit.physics.irradiance import IrradianceModel

        values = self.tables.irradiance.model_dump(exclude={"measures", "stream", "factor_sd"})
        values |= {"kind": values.pop("model"), "factor": values.pop("factor") or NAN}
        return IrradianceModel(ground_albedo=self.tables.estimator.ground_albedo, **values)

    def surface_parameters(self) -> SurfaceParameters:
        """Parameters of the energy balance: the beds and the air above them."""
        from fieldkit.physics.energy_balance import SurfaceParameters

        surface, air = self.tables.surface, self.tables.air
        return SurfaceParameters(
            albedo=surface.albedo,
            emissivity=surface.emissivity,
            emissivity_broadband=surface.emissivity_broadband or surface.emissivity,
            heat_capacity_j_kg_k=air.heat_capacity_j_kg_k,
            air_density_kg_m3=air.density_kg_m3,
            exchange_m_s=air.exchange_m_s,
        )

    def estimator_settings(self) -> EstimatorSettings:
        """Settings of the estimator."""
        from fieldkit.estimation.settings import EstimatorSettings
        from fieldkit.physics.slab import Slab

        slab = self.tables.slab.model_dump()
        return EstimatorSettings(
            surface=self.surface_parameters(),
            irradiance=self.irradiance_model(),
            light_stream=self.tables.irradiance.stream,
            measures=self.tables.irradiance.measures,
            limits=self.limits,
            kind=self.tables.surface.kind,
            kinds={
                name: kind
                for name, kind in self._by_region("surface_kind").items()
                if kind != self.tables.surface.kind
            },
            same=self.tables.surface.same,
            level_sds_deg=self._by_region("level_sd_deg"),
            probes={name: tuple(probes) for name, probes in self._by_region("probes").items()},
            horizon=tuple(self.tables.site.horizon),
            horizons={name: tuple(horizon) for name, horizon in self._by_region("horizon").items()},
            reflected_temperature_k=self.tables.surface.reflected_temperature_c + CELSIUS_ZERO_K,
            offsets_k=self._by_region("offset_k"),
            emissivity_sd=self.tables.surface.emissivity_sd,
            own_emissivity_sd=self._by_region("emissivity_sd"),
            factor_sd=self._relative_factor_sd(),
            conductivity_sd=slab.pop("conductivity_sd"),
            capacity_sd=slab.pop("capacity_sd"),
            slab=Slab(**slab),
            prior=self.tables.prior,
            body=self.tables.site.body,
            site=self.site,
            camera_path=self._camera_path(),
            **asdict(self.tables.estimator),
        )

    def _by_region(self, key: str) -> dict[str, Any]:
        """A key of the regions that have it."""
        return {region.name: value for region in self.tables.region if (value := getattr(region, key))}

    def _camera_path(self) -> CameraPath | None:
        """The camera's pose over time, which only regions on the ground need; raises `ConfigError`."""
        if self.pose is None or not any(region.points_m for region in self.tables.region):
            return None
        from fieldkit.config.ground import camera_path

        return camera_path(self.pose, self.site)

    def _relative_factor_sd(self) -> float:
        """Relative standard uncertainty of the light meter's factor; zero where another model is used."""
        table = self.tables.irradiance
        return table.factor_sd / table.factor if table.model == "calibrated" and table.factor else 0.0

    def to_toml(self) -> str:
        """All active values as TOML without comments, as a session stores them.

        Without the words of commands: they may hold a secret, and no pattern knows all of those.
        """
        commands = {table: {"command"} for table in ("alarms", "fail_safe")}
        values = self.tables.model_dump(by_alias=True, exclude_none=True, exclude=commands)
        if self.pose is not None and (text := self.pose.table.trajectory) is not None:
            values["camera"]["pose"]["trajectory"] = _one_line(text)
        return tomlkit.dumps(values)

    def _device_tables(self) -> Iterator[tuple[str, DeviceTable]]:
        named = {"camera": self.tables.camera, "lux": self.tables.lux, "thermometer": self.tables.thermometer}
        yield from ((name, table) for name, table in named.items() if table is not None)
        yield from self.tables.device.items()


def _one_line(text: str) -> String:
    """A long text on one line; tomlkit's own escapes take half a minute for a megabyte."""
    return String(StringType.SLB, text, json.dumps(text, ensure_ascii=False)[1:-1], Trivia())


def _device(name: str, table: DeviceTable) -> DeviceSettings:
    options = dict(table.options)
    if isinstance(table, LuxTable) and table.range_max_lx is not None:
        options["range_max_lx"] = table.range_max_lx
    keys = {"driver", "port", "identity", "every_s", "connect_timeout_s"}
    return DeviceSettings(name, options=options, **table.model_dump(include=keys))
