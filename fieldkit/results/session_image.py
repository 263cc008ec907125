"""One image of a session for a slide; see `fieldkit.views.session_image`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.model.samples import is_usable
from fieldkit.palettes import INFERNO
from fieldkit.physics.sun import sun_vectors
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.slope_map import slope_map
from fieldkit.results.sources import Settings
from fieldkit.sessions.formats.images_out import require_palette
from fieldkit.views import formatting, frame_image, plotting
from fieldkit.views.session_image import ShownFrame, session_image

if TYPE_CHECKING:
    from collections.abc import Callable

    from fieldkit.sessions.reader import SessionReader


def image_of(
    session: SessionReader,
    known: SessionMinutes,
    notify: Callable[[str], None],
    *,
    settings: Settings = (),
    present: bool = False,
    palette: str = INFERNO,
) -> bytes:
    """A PNG file of a session whose minutes are known, its frames in the colours of a palette.

    Raises `ConfigError` without matplotlib, such a palette or a usable frame; a map that cannot be made is
    reported to `notify` and left out.
    """
    if not plotting.available():
        raise ConfigError("an image needs matplotlib", fix="pip install 'fieldkit[lab]'")
    require_palette(palette)
    frames = list(_frames(session, known))
    if not frames:
        raise ConfigError(f"{session.path} has no usable frame", fix=f"fieldkit check {session.path}")
    try:
        found = slope_map(session, settings=settings, present=present)
        mapped = None if found.along_sun is not None else found.slopes
    except FieldkitError as error:
        notify(f"the image has no map: {error.message}")
        mapped = None
    site, start, end = known.site, session.start_ns, session.end_ns
    day, until = formatting.local_time(start, site), formatting.clock_time(end, site)
    subtitle = f"{day:%Y-%m-%d %H:%M} to {until} {formatting.zone_name(end, site)}   {formatting.place(site)}"
    estimates = list(known.estimates().final.values())
    regions = known.schedule.latest
    return session_image(session.path.stem, subtitle, frames, regions, mapped, estimates, palette)


def _frames(session: SessionReader, known: SessionMinutes) -> Iterator[ShownFrame]:
    """The first usable frame, the one nearest to the highest sun, the last."""
    camera = next((info for info in session.streams.values() if info.is_camera), None)
    if camera is None:
        return
    reader = session.stream(camera.name)
    usable = np.flatnonzero(is_usable(reader.flags()))
    if not usable.size:
        return
    times = session.times_ns(camera.name)[usable]
    highest = int(np.argmax(sun_vectors(times, known.site)[:, 2]))
    rows = {"first": usable[0], "highest sun": usable[highest], "last": usable[-1]}
    by_row = {
        int(row): name for name, row in reversed(rows.items())
    }  # one that is two of them is the earlier
    for row in sorted(by_row):
        frame = reader.frame(row)
        words = f"{by_row[row]}, {formatting.clock_time(frame.time_ns, known.site)}"
        yield ShownFrame(words, frame_image.values(frame, camera), frame_image.unit(camera))
