from dataclasses import replace

import numpy as np
import pytest

from fieldkit.physics.slab import SlabStep
from fieldkit.simulation import ClearSky, Facet, sand_slopes
from fieldkit.simulation.drawn_field import Spread, drawn_field, drawn_scene

SEEDS = range(300)


def test_exchange_of_every_field_is_at_least_that_of_measured_ground():
    """Fits to radiometers find 3 + 1.8 U and 4 + 1.7 U W m-2 K-1: 12 and 12.5 at 5 m/s; the paper has 18."""
    at_five = [float(drawn_field(seed).exchange.at(np.array(5.0))) for seed in SEEDS]
    assert min(at_five) > 10.0
    assert np.mean(np.array(at_five) < 18.15) == pytest.approx(0.5, abs=0.15)


def test_inertia_covers_measured_ground():
    """380 to 590 J m-2 K-1 s-1/2 on cinder and clay."""
    inertia = [drawn_field(seed).sand[0].thermal_inertia for seed in SEEDS]
    assert min(inertia) < 390.0
    assert max(inertia) > 590.0


def test_a_fifth_of_the_fields_has_no_bottom():
    deep = [len(drawn_field(seed).sand) == 2 for seed in SEEDS]
    assert np.mean(deep) == pytest.approx(0.2, abs=0.06)


def test_deep_sand_warms_as_a_half_space():
    """A flux q warms a half-space by 2 q sqrt(t / pi) / Gamma (Carslaw and Jaeger, 1959, 2.9)."""
    sand = drawn_field(1, Spread(deep_share=1.0)).sand
    step = SlabStep.of([sand], 10.0)
    nodes = np.full((1, 1 + sum(slab.layers for slab in sand)), 290.0)
    for number in range(1, 1081):
        nodes = step.after(nodes, 100.0, 0.0, 0.0, 1e-9)
        if number in (60, 360, 1080):
            expected = 200.0 * np.sqrt(10.0 * number / np.pi) / sand[0].thermal_inertia
            assert nodes[0, 0] - 290.0 == pytest.approx(expected, rel=0.01)


def test_damp_beds_are_darker_and_a_crust_lies_on_them():
    field = drawn_field(3, Spread(damp_share=1.0, own_albedo_sd=0.0, albedo_sd=0.0))
    bed = field.bed(Facet("b05", ()))
    crust, damp, *_ = bed.stack
    assert bed.albedo == pytest.approx(0.17)
    assert crust.depth_m < 0.015
    assert damp.thermal_inertia > 1.5 * crust.thermal_inertia
    assert sum(slab.depth_m for slab in bed.stack) == pytest.approx(sum(slab.depth_m for slab in field.sand))


def test_a_bed_keeps_its_sand_whichever_beds_lie_beside_it():
    field, bed = drawn_field(4), Facet("b05", (), 5.0, 180.0)
    assert field.bed(bed) == field.bed(bed)
    assert field.bed(replace(bed, name="b15")) != replace(field.bed(bed), name="b15")


def test_haze_belongs_to_skies_by_formula():
    drawn = drawn_field(5)
    sky = drawn.sky(ClearSky())
    assert sky.sky.linke_turbidity == drawn.linke_turbidity


def test_scene_of_a_seed_is_another_field_under_the_same_sky():
    usual = sand_slopes(duration_s=1200.0, seed=2)
    drawn = drawn_scene(usual)
    assert [facet.tilt_deg for facet in drawn.facets] == [facet.tilt_deg for facet in usual.facets]
    one, other = (scene.at(scene.start_ns + 600_000_000_000) for scene in (usual, drawn))
    assert other.dni_w_m2 == one.dni_w_m2
    assert np.all(np.abs(other.surface_k[:-1] - one.surface_k[:-1]) > 0.05)
    lux = drawn.lux_reading(drawn.start_ns) / usual.lux_reading(usual.start_ns)
    assert lux == pytest.approx(drawn_field(2).light_factor, rel=1e-9)
