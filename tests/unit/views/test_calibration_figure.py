from itertools import pairwise

import numpy as np
import pytest

from fieldkit.calibration.band import FLAT
from fieldkit.calibration.emissivity import Pairs, SharedUncertainties, fit_emissivity
from fieldkit.physics.radiance import brightness_temperature_k


@pytest.mark.parametrize("reflected", ["fixed", "free"])
def test_every_word_and_number_of_the_picture_lies_inside_it_and_beside_the_others(reflected):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    from fieldkit.views.calibration_figure import emissivity_figure

    surface, sky, sd = np.linspace(278.0, 323.0, 12), np.full(12, 240.0), np.full(12, 0.1)
    pairs = Pairs(brightness_temperature_k(surface, 0.85, sky), surface, sky, sd, sd)
    found = fit_emissivity(pairs, SharedUncertainties(), reflected=reflected)
    figure = emissivity_figure(found, pairs, FLAT)
    FigureCanvasAgg(figure).draw()
    said = {one.get_text().partition(",")[0] for one in figure.findobj(Text)}
    assert {line.name for line in found.budget} <= said
    drawn, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert (drawn.x0 >= 0.0, drawn.y0 >= 0.0, drawn.x1 <= width, drawn.y1 <= height) == (True,) * 4
    for axes in figure.axes:
        low, high = axes.get_xlim()
        ticks = [one for one in axes.get_xticklabels() if low <= one.get_position()[0] <= high]
        boxes = [one.get_window_extent() for one in ticks]
        assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
