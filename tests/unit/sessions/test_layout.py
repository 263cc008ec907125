"""Names that a session or a stream must not have."""

import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.site import Site
from fieldkit.sessions.layout import RESERVED_NAMES, SessionHeader

SITE = Site(35.0, 139.0)


def header(*names: str) -> SessionHeader:
    return SessionHeader("x", SITE, tuple(StreamInfo(name, "illuminance", "lx", (1,)) for name in names))


@pytest.mark.parametrize("name", [*sorted(RESERVED_NAMES), "", "a/b", ".hidden"])
def test_a_stream_cannot_take_the_name_of_a_table(name):
    with pytest.raises(ValueError, match="name of a stream"):
        header("lux", name)


def test_two_streams_cannot_have_one_name():
    with pytest.raises(ValueError, match="lux, lux"):
        header("lux", "lux")
