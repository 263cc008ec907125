"""What is known about a session before its first sample, and what the file has room for."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.model.site import Region, Site
from fieldkit.sessions.plain import build

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
        for info in self.streams:
            _check_stream(info)
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
        """The header that `to_json` of any version wrote; raises `SessionError` where the text is none."""
        try:
            return build(cls, json.loads(text))
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise SessionError(f"the session's header makes no sense: {error}") from error


def _check_stream(info: StreamInfo) -> None:
    """Raise `ValueError` where no samples could be of a stream as it is declared."""
    sides = (*info.shape, *(side for side in info.metadata_shape if side))
    if len(info.shape) not in (1, 2) or min(sides) < 1:
        raise ValueError(f"stream {info.name!r} is declared with samples of shape {info.shape}")
    if not (0.0 <= info.rate_hz < math.inf and info.raw_bytes >= 0):
        raise ValueError(f"stream {info.name!r} is declared with {info.rate_hz} Hz, {info.raw_bytes} bytes")


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
