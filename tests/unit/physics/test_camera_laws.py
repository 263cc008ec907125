import numpy as np
import pytest

from fieldkit.physics.camera_laws import (
    LAWS,
    Planck,
    ht301_fpa_c,
    ht301_parameters,
    linear,
    path_transmission,
    planck_counts,
    planck_table,
    temperature_k,
)

E60 = Planck(r1=16528.178, b=1427.5, f=1.0, o=-1307.0, r2=0.012258549)
"""Constants printed in a public program for a FLIR One."""


def test_linear_law_is_scale_and_offset():
    counts = np.array([[0, 29515, 65535]], np.uint16)
    assert linear(counts, 0.01)[0] == pytest.approx([0.0, 295.15, 655.35], abs=3e-5)
    assert linear(counts, 0.04, 10.0)[0] == pytest.approx([10.0, 1190.6, 2631.4], abs=3e-4)
    assert temperature_k("linear", counts, counts[:0], {}, 0.01).dtype == np.float32


def test_unknown_law_is_named():
    counts = np.zeros((1, 1), np.uint16)
    with pytest.raises(ValueError, match="no camera law is called 'cubic'; there are linear, ht301, planck"):
        temperature_k("cubic", counts, counts, {})
    assert set(LAWS) == {"ht301", "planck"}


@pytest.mark.parametrize("temperature_k", [250.0, 293.15, 400.0])
def test_planck_law_and_its_inverse_agree(temperature_k):
    counts = planck_counts(temperature_k, E60)
    low, high = planck_table(E60)[[int(counts), int(counts) + 1]]
    assert low <= temperature_k <= high


def test_path_of_no_length_changes_nothing():
    assert path_transmission(E60) == pytest.approx(1.0)
    through_air = Planck(**{**{name: getattr(E60, name) for name in Planck.__slots__}, "distance_m": 50.0})
    assert path_transmission(through_air) < 1.0


def test_emissivity_below_one_makes_a_warm_object_warmer():
    fields = {name: getattr(E60, name) for name in Planck.__slots__}
    count = int(planck_counts(320.0, E60))
    grey = planck_table(Planck(**{**fields, "emissivity": 0.9, "reflected_k": 280.0}))[count]
    assert grey > planck_table(E60)[count] + 2.0


@pytest.mark.parametrize(
    ("width", "raw", "celsius"), [(640, 6867, 20.0), (384, 7620, 25.0), (256, 8617, 20.0)]
)
def test_sensor_temperature_of_the_ht301_family(width, raw, celsius):
    assert ht301_fpa_c(width, raw) == pytest.approx(celsius)


@pytest.mark.parametrize("shape", [(4, 160), (3, 384), (0, 0)])
def test_rows_of_another_camera_are_refused(shape):
    with pytest.raises(ValueError, match="no metadata of the HT-301 family"):
        ht301_parameters(np.zeros(shape, np.uint16))
