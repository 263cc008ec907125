"""What is known about a session before its first sample, and what the file has room for."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from fieldkit.device import StreamInfo
from fieldkit.errors import ConfigError, SessionError
from fieldkit.site import Region, RegionKind, Site

MAX_VERTICES = 64
MAX_REGIONS = 256
RESERVED_NAMES = frozenset(
    {"entry", "irradiance", "estimates", "regions", "events", "clock", "health", "calibration"}
    | {"config", "integrity", "time_map"}
)
"""Groups of the file itself; no stream may have such a name."""


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """What is known about a session before its first sample.

    `config_toml` is the configuration as it was used; `license` and `references` say how
    the data may be used and cited.
    """

    title: str
    site: Site
    streams: tuple[StreamInfo, ...]
    regions: tuple[Region, ...] = ()
    config_toml: str = ""
    command_line: str = ""
    operator: str = ""
    description: str = ""
    license: str = ""
    references: str = ""

    def __post_init__(self) -> None:
        names = [info.name for info in self.streams]
        if len(set(names)) < len(names):
            raise ValueError(f"two streams have the same name: {', '.join(names)}")
        for name in names:
            if not name or name in RESERVED_NAMES or "/" in name or name.startswith("."):
                raise ValueError(f"{name!r} cannot be the name of a stream")
        for region in self.regions:
            check_region(region)

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions, each once, in order: the columns of the estimates."""
        return tuple(dict.fromkeys(region.name for region in self.regions))

    def stream(self, name: str) -> StreamInfo:
        """What was declared of one stream; raises `KeyError`."""
        return next(info for info in self.streams if info.name == name)

    def to_json(self) -> str:
        """The header as text, every number exact."""
        return json.dumps(asdict(self), default=str)

    @classmethod
    def from_json(cls, text: str) -> SessionHeader:
        """The header that `to_json` wrote; raises `SessionError` where the text is none."""
        try:
            plain = json.loads(text)
            plain["site"] = Site(**plain["site"])
            plain["streams"] = tuple(_stream(item) for item in plain["streams"])
            plain["regions"] = tuple(region_from(item) for item in plain["regions"])
            return cls(**plain)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise SessionError(f"the session's header makes no sense: {error}") from error


def _stream(plain: dict[str, Any]) -> StreamInfo:
    tuples = {key: tuple(plain[key]) for key in ("shape", "metadata_shape", "channels")}
    tuples["measures"] = tuple(plain.get("measures", ()))  # older sessions do not have it
    return StreamInfo(**{**plain, **tuples})


def region_from(plain: dict[str, Any]) -> Region:
    """A region from its plain (JSON) form."""
    vertices = tuple((float(x), float(y)) for x, y in plain["vertices"])
    return Region(**{**plain, "kind": RegionKind(plain["kind"]), "vertices": vertices})


def check_new(header: SessionHeader) -> None:
    """Raise `ConfigError` if a new file has no room for so many regions; old journals may have more."""
    if (count := len(header.region_names)) > MAX_REGIONS:
        raise ConfigError(
            f"{count} regions; a session has room for {MAX_REGIONS}", fix="remove some: fieldkit roi"
        )


def check_region(region: Region) -> None:
    """Raise `ValueError` if the file has no room for this outline."""
    if not 3 <= len(region.vertices) <= MAX_VERTICES:
        raise ValueError(
            f"region {region.name!r} has {len(region.vertices)} corners; 3 to {MAX_VERTICES} fit"
        )
