"""Requests of browsers: one JSON object each, strict, small, without a path.

`parse` is the only way in. Whatever else arrives is a `BadRequestError`.
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from fieldkit.config.toml_schema import RegionOutline
from fieldkit.page.phrases import PageError
from fieldkit.page.pictures import Mode

MAX_BYTES = 16_384
"""A region of 64 corners takes three thousand."""

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
_HALF = re.compile(r"\\u[dD][89a-fA-F]")
"""Half of a letter beyond 16 bits, as JSON writes it: alone it makes a message invalid."""
_ID = re.compile(r'"id"\s*:\s*(\d{1,16})\b')

TYPED = ("empty", "too_long", "not_text", "greater_than_equal", "less_than_equal")
"""Mistakes of what a person typed, as keys of their texts; others are of a page of another version."""


def _plain(text: str) -> str:
    if _CONTROL.search(text):
        raise PydanticCustomError("not_text", "is not text")
    return text


def _not_empty(text: str) -> str:
    if not text:
        raise PydanticCustomError("empty", "is empty")
    return text


Text = Annotated[str, AfterValidator(_plain)]
"""Without control characters but tabs and line breaks: names of files and programs cannot have them."""
Word = Annotated[Text, AfterValidator(_not_empty), Field(max_length=80)]
Note = Annotated[Text, AfterValidator(_not_empty), Field(max_length=2000)]
Pixel = Annotated[float, Field(ge=-1, le=65_535, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]


class BadRequestError(PageError):
    """A message that is no request; `id` is its number where it has one."""

    def __init__(self, key: str, id: int | None = None) -> None:
        super().__init__(key)
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


class DrawnRegion(RegionOutline):
    """An outline whose name is being typed; the campaign's file refuses what no region may be called."""

    name: Word


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


class SessionSlopes(_Request):
    """Slopes of a past session as they were recorded."""

    do: Literal["slopes"]
    session: Word


class Marks(_Request):
    """The marks of a past session with this id, or of the running recording."""

    do: Literal["marks"]
    session: Word | None = None


class TakeBack(_Request):
    """Take back the mark of this number; the session keeps it as it was made."""

    do: Literal["take_back"]
    mark: Annotated[int, Field(ge=1)]
    session: Word | None = None


class EditMark(_Request):
    """Another text, kind or time for the mark of this number; one taken back counts again. None stays."""

    do: Literal["edit_mark"]
    mark: Annotated[int, Field(ge=1)]
    text: Note | None = None
    kind: Annotated[Text, Field(max_length=80)] | None = None
    at: Word | None = None
    session: Word | None = None


class Start(_Request):
    """Start a recording, for a `duration` such as ``3h`` or `until` a time of day ``HH:MM``.

    It begins now, or `include_last` earlier with what the preview still has.
    """

    do: Literal["start"]
    name: Annotated[Text, Field(max_length=80)] = ""
    duration: Word | None = None
    until: Word | None = None
    include_last: Word | None = None
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
    text: Note
    kind: Annotated[Text, Field(max_length=80)] = ""
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


class SuggestRegions(_Request):
    """Regions found in the picture, or in that of the past session with this id."""

    do: Literal["suggest_regions"]
    session: Word | None = None


Redrawing = AddRegion | EditRegion | RemoveRegion
ForAnyone = Picture | Value | CheckRegion | Sessions | CheckSession | SessionSlopes | Marks
ForControl = (
    EstimateSession
    | Start
    | Stop
    | AddMark
    | TakeBack
    | EditMark
    | Shutter
    | Acknowledge
    | Redrawing
    | Skyline
    | SuggestRegions
)
Request = ForAnyone | ForControl
FOR_ANYONE: tuple[type[_Request], ...] = get_args(ForAnyone)
"""Requests that change nothing; all others are for those who may control."""
FOR_CONTROL: tuple[type[_Request], ...] = get_args(ForControl)

_adapter: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def parse(text: str) -> Request:
    """The request in a message; raises `BadRequestError`."""
    if len(text) > MAX_BYTES:
        raise BadRequestError("too_long")
    try:
        return _adapter.validate_json(text)
    except ValidationError as error:
        raise _refusal(error, text) from None


def _refusal(error: ValidationError, text: str) -> BadRequestError:
    first = error.errors(include_url=False, include_input=False)[0]
    number = _ID.search(text)  # also of a message that is not JSON: its browser waits for an answer
    id = int(number[1]) if number else None
    kind = "not_text" if first["type"] == "json_invalid" and _HALF.search(text) else first["type"]
    return BadRequestError(kind if kind in TYPED else "reload", id)
