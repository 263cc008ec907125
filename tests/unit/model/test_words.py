"""Words of loggers, boards and archives of radiation: units, where they stand in a label, components.

Units: the BIPM's brochure on the SI, section 5.4, and what programs write in place of its signs. Names of
components: the lists of variables of the archives named beside them, with the meanings given there.
"""

import pytest

from fieldkit.model.channels import air_quantities
from fieldkit.model.component_names import component_named, may_measure
from fieldkit.model.device import StreamInfo
from fieldkit.model.quantities import quantity_named, split_label, unit_of

SPELLINGS = {
    "°C": (
        "C|c|ºC|° C|˚C|oC|*C|(*C)|'C|?C|℃|C°|degC|deg_C|deg C|Deg. C|degrees C|DEGREE C|Celsius|"
        "°Celsius|degrees celsius|Centigrade|Grad C|Â°C|\ufffdC|\u0421"
    ),
    "°F": "F|°F|ºF|*F|deg F|℉|Fahrenheit",
    "K": "K|Kelvin|°K",
    "lx": "lx|lux|Lux|LUX|lm/m2|lm m⁻²|lumens/m²",
    "klx": "klx|kLux|kilolux",
    "fc": "fc|Ft-cd|foot-candles|foot candles|lm/ft2",
    "W/m²": (
        "W/m2|W/m²|W/㎡|W m-2|W m⁻²|W·m⁻²|W⋅m-2|W.m-2|Wm-2|W m^-2|W m**-2|W/m^2|W/m**2|W m^{-2}|"
        "$W/m^2$|Watts/m2|watts per square meter|W per m2|W/sqm|W/qm|Wm2|w_m2|W/mÂ²"
    ),
    "kW/m²": "kW/m2|kW m⁻²|kW m-2",
    "mW/cm²": "mW/cm2|mW/cm^2|mW cm⁻²",
    "µW/cm²": "µW/cm²|μW cm-2|uW/cm2",
    "m/s": "m/s|m s-1|m s⁻¹|m·s⁻¹|m_s|meters/second",
    "km/h": "km/h|km h⁻¹|kph",
    "hPa": "hPa|mbar",
    "": "l/h|mW|Wh/m2|MJ/m²|J/cm2|µmol/m2/s|x|1|",
}


@pytest.mark.parametrize(
    ("written", "shown"), [(text, shown) for shown, texts in SPELLINGS.items() for text in texts.split("|")]
)
def test_a_unit_is_known_however_it_is_written(written, shown):
    unit = unit_of(written)
    assert (unit.shown if unit else "") == shown


@pytest.mark.parametrize(
    ("unit", "number", "stored"),
    [("km/h", 36.0, 10.0), ("mph", 1.0, 0.44704), ("kn", 1.0, 1852 / 3600), ("inHg", 29.92, 101_320.0)],
)
def test_numbers_of_a_unit_become_those_of_the_stream(unit, number, stored):
    """NIST Special Publication 811, appendix B."""
    row = unit_of(unit)
    assert (number + row.add) / row.by == pytest.approx(stored, rel=1e-4)


WITHOUT_A_UNIT = (
    "Sensor C|Ch K|Thermocouple K|TC K|T_a|G(h)|Temp(1)|T (shade)|batteryV|temp_min|"
    "Global CMP22 (vent/cor)|WS_ms|note"
)


@pytest.mark.parametrize(
    ("label", "name", "unit"),
    [
        ("T1 [C]", "T1", "C"),
        ("Temp, (*F)", "Temp", "*F"),
        ("RH, (%)", "RH", "%"),
        ("Temperature (°C) Sensor 2", "Temperature Sensor 2", "°C"),
        ("[°C] bed", "bed", "°C"),
        ("温度(℃)", "温度", "℃"),
        ("Solar Rad - W/m^2", "Solar Rad", "W/m^2"),
        ("Wind Speed - m/s", "Wind Speed", "m/s"),
        ("T/K", "T", "K"),
        ("Light, lux", "Light", "lux"),
        ("Temp in °C", "Temp", "°C"),
        ("Temperature_°C", "Temperature", "°C"),
        ("Humidity_%", "Humidity", "%"),
        ("VPD_kPa", "VPD", "kPa"),
        ("Temperature°C", "Temperature", "°C"),
        ("Humidity%RH", "Humidity", "%RH"),
        ("temp_deg_C", "temp", "deg_C"),
        ("bed_c", "bed", "c"),
        ("tempF", "temp", "F"),
        ("T_C_Avg", "T", "C"),
        ("ghi_w_m2", "ghi", "w_m2"),
        ("sky.lux", "sky", "lux"),
        ("lux", "lux", "lux"),
        *((label, label, "") for label in WITHOUT_A_UNIT.split("|")),
    ],
)
def test_a_unit_is_found_wherever_a_label_has_it(label, name, unit):
    assert split_label(label) == (name, unit)


COMPONENTS = {
    "dni": (
        "DNI|Direct Normal [W/m^2]|Direct NIP|Direct CHP1-1|Direct Normal (calc)|BNI|Gb(n)|"
        "DIR [W/m**2]|direct_n|direct|beam|direct_normal_irradiance|direct_normal_irradiance_instant|"
        "ALLSKY_SFC_SW_DNI|short_direct_normal|Direct Normal Radiation|I_dir_Avg|pyrheliometer"
    ),
    "ghi": (
        "GHI|Global Horizontal [W/m^2]|Global Horiz (platform)|Global CMP22 (vent/cor)|"
        "Global PSP|G(h)|SWD [W/m**2]|dw_solar|dw_psp|shortwave_radiation|shortwave_radiation_instant|"
        "SW_IN_1_1_1|SWDown|Pyranometer SW down|"
        "ALLSKY_SFC_SW_DWN|down_short_hemisp|Global Horizontal Radiation|Globalstrahlung|"
        "ghi_w_m2|ghi_1min|全天日射量"
    ),
    "dhi": (
        "DHI|Diffuse CM22-1 (vent/cor)|Diffuse Horiz (band_corr)|Gd(h)|DIF [W/m**2]|diffuse|"
        "diffuse_radiation|ALLSKY_SFC_SW_DIFF|down_short_diffuse_hemisp|Diffuse Horizontal Radiation|SW_DIF|"
        "散乱日射量"
    ),
    "gti": "GTI|poa_global|POA|G(i)|global_tilted_irradiance|GtiFixedTilt|Plane of array",
    "longwave_down": (
        "LWD [W/m**2]|dw_ir|Downwelling IR PIR|IR(h)|longwave_down|LW_IN|LWin_Avg|"
        "Pyrgeometer LW down|down_long_hemisp|"
        "ALLSKY_SFC_LW_DWN|Horizontal Infrared Radiation Intensity"
    ),
    "longwave_up": "LWU|uw_ir|Upwelling IR PIR|longwave_up|LW_OUT|up_long_hemisp",
    "": (
        "sun|Solar Rad|pyranometer 2|Pyranometer D|direct_radiation|terrestrial_radiation|"
        "Clear sky GHI|Clearsky GHI|ghi_clear|dni_extra|TOA|BHI|uw_solar|SWU|SW_OUT|netsolar|NETRAD|"
        "poa_direct|poa_sky_diffuse|Gb(i)|Gd(i)|Gr(i)|"
        "ETR|CLRSKY_SFC_SW_DWN|Global 40-South LI-200|Global Normal|swd_std|swd_max|Global UVA|"
        "Pyrgeometer|up_short_hemisp|reflected shortwave|GHI no corr|Ghi90|Beam horizontal|High Solar Rad"
    ),
}


@pytest.mark.parametrize(
    ("label", "component"),
    [(label, name) for name, labels in COMPONENTS.items() for label in labels.split("|")],
)
def test_a_component_of_radiation_is_known_by_the_names_of_the_archives(label, component):
    assert component_named(label) == component


@pytest.mark.parametrize(
    ("label", "component", "may_be"),
    [
        ("Pyrgeometer", "ghi", False),
        ("Pyrgeometer", "longwave_down", True),
        ("Pyranometer 2", "longwave_up", False),
        ("sun", "gti", True),
        ("sun", "longwave_up", True),
    ],
)
def test_no_instrument_measures_the_other_side_of_the_spectrum(label, component, may_be):
    assert may_measure(label, component) is may_be


@pytest.mark.parametrize(
    "label", ["T_air", "Air Temp - °C", "air_temp_f", "Air Temperature [deg C]", "t2m", "temperature_2m"]
)
def test_the_air_is_named_with_or_without_a_unit(label):
    info = StreamInfo("logger", "temperature", "K", (2,), channels=("bed", label))
    assert air_quantities(info) == ("", "air_temperature")


@pytest.mark.parametrize("label", ["WS_ms_S_WVT", "WS_ms_WVc(1)", "WS_ms_Avg"])
def test_the_wind_is_named_as_campbells_wind_vector_names_it(label):
    assert quantity_named(label, "m s-1") == "wind_speed"
    assert quantity_named("WindDir_D1_WVT", "degree") == "wind_direction"
