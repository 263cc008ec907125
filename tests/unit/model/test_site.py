"""A region with its edges moved inwards, by plane geometry."""

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import Region, RegionKind, as_site
from tests.harness.next_steps import at

RIGHT_TRIANGLE = ((0.0, 0.0), (30.0, 0.0), (0.0, 40.0))
CORNER_PIECE = ((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (10.0, 10.0), (10.0, 20.0), (0.0, 20.0))


def region(*corners: tuple[float, float]) -> Region:
    return Region("bed", RegionKind.TARGET, corners, 15.0, 180.0)


def test_a_triangle_shrinks_towards_the_middle_of_its_inscribed_circle():
    """Sides 30, 40 and 50: the circle has radius 10 about (10, 10), by area over half the perimeter."""
    nearly = region(*RIGHT_TRIANGLE).shrunk(9.999)
    assert all(corner == pytest.approx((10.0, 10.0), abs=0.01) for corner in nearly.points_px)
    assert (nearly.name, nearly.tilt_deg, nearly.azimuth_deg) == ("bed", 15.0, 180.0)
    with pytest.raises(ConfigError, check=at("bed")):
        region(*RIGHT_TRIANGLE).shrunk(10.1)


@pytest.mark.parametrize("corners", [CORNER_PIECE, CORNER_PIECE[::-1], (*CORNER_PIECE, CORNER_PIECE[-1])])
def test_every_edge_moves_inwards_whichever_way_it_was_drawn(corners):
    smaller = region(*corners).shrunk(2.0)
    expected = {(2.0, 2.0), (18.0, 2.0), (18.0, 8.0), (8.0, 8.0), (8.0, 18.0), (2.0, 18.0)}
    assert set(smaller.points_px) == expected


@pytest.mark.parametrize(
    "corners",
    [
        ((0.0, 0.0), (10.0, 0.0), (5.0, 0.0)),
        ((0.0, 0.0), (10.0, 0.0), (0.0, 0.0)),
        ((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)),
    ],
)
def test_what_has_no_inside_does_not_shrink(corners):
    with pytest.raises(ConfigError, match="1 px", check=at("bed")):
        region(*corners).shrunk(1.0)


@pytest.mark.parametrize(
    ("corners", "crosses"),
    [
        ([(0, 0), (9, 0), (9, 9), (0, 9)], False),
        ([(0, 0), (9, 9), (9, 0), (0, 9)], True),  # a bow tie
        ([(0, 0), (9, 0), (4, 5)], False),
        ([(0, 0), (9, 0), (9, 9), (4, 0), (0, 9)], True),  # touches its own edge
        ([(0, 0), (9, 0), (9, 9), (5, 2), (0, 9)], False),  # concave
        ([(0, 0), (0, 0), (9, 0), (9, 9), (0, 9)], False),  # a corner given twice
    ],
)
def test_an_outline_that_crosses_itself_is_seen(corners, crosses):
    assert Region("b", RegionKind.TARGET, tuple(corners)).crosses_itself is crosses


@pytest.mark.parametrize("place", [(91.0, 0.0), (0.0, 200.0), (0.0, 0.0, 1e9), (0.0, 0.0, float("nan"))])
def test_numbers_of_no_place_are_no_site(place):
    with pytest.raises(ConfigError, check=at(Argument("site"))):
        as_site(place)
