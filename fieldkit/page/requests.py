"""What a browser may ask for: one JSON object each, strict, small, without a path.

`parse` is the only way in. Whatever else arrives is a `BadRequestError`.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from fieldkit.model.errors import FieldkitError
from fieldkit.page.pictures import Mode

MAX_BYTES = 16_384
"""A region of 64 corners takes three thousand."""

Word = Annotated[str, Field(min_length=1, max_length=80)]
Pixel = Annotated[float, Field(ge=-1, le=65_535, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]


class BadRequestError(FieldkitError):
    """A message that is no request; `id` is its number where it has one."""

    def __init__(self, message: str, id: int | None = None) -> None:
        super().__init__(message, fix="reload the page: it may be of another version")
        self.id = id


class _Request(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True, frozen=True)

    id: Annotated[int, Field(ge=0, le=2**53)] | None = None


class Picture(_Request):
    """Send pictures of this kind, or none while the page is hidden."""

    do: Literal["picture"]
    mode: Mode


class Value(_Request):
    """The temperature of one pixel."""

    do: Literal["value"]
    x: Pixel
    y: Pixel


class DrawnRegion(BaseModel):
    """A region as drawn: corners in pixels, angles in degrees, None where unknown."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True, frozen=True)

    name: Word
    role: Literal["reference", "target"]
    vertices: Annotated[list[tuple[Pixel, Pixel]], Field(min_length=3, max_length=64)]
    tilt_deg: Number | None = None
    azimuth_deg: Number | None = None
    emissivity: Number | None = None


class CheckRegion(_Request):
    """How good a region would be; with `shrink` moved inwards by so many pixels.

    `instead_of` is the name of the region that is being redrawn; `session` the id of the past session on
    whose frame it is drawn, against the campaign's regions.
    """

    do: Literal["check_region"]
    region: DrawnRegion
    instead_of: Word | None = None
    session: Word | None = None
    shrink: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] = 0.0


class Sessions(_Request):
    """The campaign's sessions."""

    do: Literal["sessions"]


class CheckSession(_Request):
    """Check a session; `session` is its id in the list."""

    do: Literal["check_session"]
    session: Word


class EstimateSession(_Request):
    """Slopes of a past session with the campaign's regions as they are now."""

    do: Literal["estimate_session"]
    session: Word


class Start(_Request):
    """Start a recording, for a `duration` such as ``3h`` or `until` a time of day ``HH:MM``."""

    do: Literal["start"]
    name: Annotated[str, Field(max_length=80)] = ""
    duration: Word | None = None
    until: Word | None = None
    allow_missing: bool = False

    @model_validator(mode="after")
    def _one_end(self) -> Start:
        if self.duration and self.until:
            raise ValueError("give a duration or an end, not both")
        return self


class Stop(_Request):
    """Stop and seal the running recording."""

    do: Literal["stop"]
    confirm: Literal[True]


class AddMark(_Request):
    """A note on the recording at a time, or from `at` to `to`."""

    do: Literal["mark"]
    text: Annotated[str, Field(min_length=1, max_length=2000)]
    kind: Annotated[str, Field(max_length=80)] = ""
    at: Word = "-0s"
    to: Word | None = None


class Shutter(_Request):
    """A shutter correction of the camera now."""

    do: Literal["shutter"]


class Acknowledge(_Request):
    """Somebody has seen this alarm."""

    do: Literal["acknowledge"]
    alarm: Word


class AddRegion(_Request):
    """Add a region to the campaign."""

    do: Literal["add_region"]
    region: DrawnRegion


class EditRegion(_Request):
    """Replace the region of this name."""

    do: Literal["edit_region"]
    name: Word
    region: DrawnRegion


class RemoveRegion(_Request):
    """Remove a region from the campaign."""

    do: Literal["remove_region"]
    name: Word
    confirm: Literal[True]


class Skyline(_Request):
    """The skyline as drawn becomes the site's horizon; corners in pixels."""

    do: Literal["skyline"]
    points: Annotated[list[tuple[Pixel, Pixel]], Field(min_length=2, max_length=64)]


class Link(_Request):
    """A one-time link for another browser."""

    do: Literal["link"]
    role: Literal["view", "control"]


ForAnyone = Picture | Value | CheckRegion | Sessions | CheckSession
ForControl = (
    EstimateSession
    | Start
    | Stop
    | AddMark
    | Shutter
    | Acknowledge
    | AddRegion
    | EditRegion
    | RemoveRegion
    | Skyline
    | Link
)
Request = ForAnyone | ForControl
FOR_ANYONE: tuple[type[_Request], ...] = get_args(ForAnyone)
"""Requests that change nothing; all others are for those who may control."""
FOR_CONTROL: tuple[type[_Request], ...] = get_args(ForControl)

_adapter: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def parse(text: str) -> Request:
    """The request in a message; raises `BadRequestError`."""
    if len(text) > MAX_BYTES:
        raise BadRequestError(f"a message of {len(text)} characters is too long")
    try:
        return _adapter.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise BadRequestError(f"{where or 'the message'}: {first['msg']}", _id_of(text)) from None


def _id_of(text: str) -> int | None:
    """The number of a message that is invalid for another reason."""
    try:
        return _Numbered.model_validate_json(text).id
    except ValidationError:
        return None


class _Numbered(BaseModel):
    id: Annotated[int, Field(strict=True, ge=0, le=2**53)]
