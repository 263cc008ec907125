"""The commands about instruments: devices, doctor, decode, selftest."""

import json
from datetime import UTC, datetime

import pytest
from click.testing import CliRunner

from fieldkit.calibration.calibration_record import CalibrationRecord, save
from fieldkit.cli import main
from fieldkit.drivers import discovery
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.model.errors import DeviceError
from tests.harness.command_line import document, fieldkit, invoke, succeed
from tests.harness.connected import plugged_in
from tests.harness.plugins import install

LUX = "02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D"
SMP = "01 04 10 00 01 00 01 00 01 20 F5 20 C7 00 03 01 39 00 79 48 A8"


def test_a_recording_without_its_instruments_must_be_wanted(tmp_path):
    site = "latitude_deg = 35.6\nlongitude_deg = 139.4\nelevation_m = 9.0\n"
    meter = '[lux]\ndriver = "lutron"\nport = "/dev/no-such-port"\nconnect_timeout_s = 0.1\n'
    (tmp_path / "fieldkit.toml").write_text(f"schema = 1\n[site]\n{site}{meter}")
    words = ("record", "-C", tmp_path, "--for", "1s")
    with pytest.raises(DeviceError, match="/dev/no-such-port"):
        invoke(*words)
    succeed(*words, "--allow-missing")


def test_decode_has_the_promised_form():
    assert document("decode", "lutron", *LUX.split(), "02", "34") == {
        "schema": 1,
        "readings": [{"value": 98760.0, "unit": "lx", "channel": "1", "flags": []}],
        "rejected": [],
        "rest": 2,
        "notes": [],
    }


@pytest.mark.parametrize(
    ("hexadecimal", "records"),
    [
        *((text, 1) for text in (LUX, LUX.replace(" ", ""), LUX.replace(" ", ":"), LUX.lower())),
        *((records * LUX.replace(" ", ""), records) for records in (20, 200, 3000)),  # beyond a file's name
    ],
)
def test_hexadecimal_may_be_written_as_one_likes(hexadecimal, records):
    readings = document("decode", "lutron", hexadecimal)["readings"]
    assert [reading["value"] for reading in readings] == [98760.0] * records


def test_no_value_is_null_with_its_flag():
    frame = "02 80 06 00 00 00 00 00 EF" + " 00" * 30 + " 0E 00 00 00 00 03"
    readings = document("decode", "center-309", frame)["readings"]
    assert [reading["value"] for reading in readings] == [23.9, None, None, None]
    assert readings[1]["flags"] == ["no_value", "overload"]


def test_rejected_bytes_have_a_reason_and_a_place():
    found = document("decode", "lutron", "FF FF " + LUX)
    (rejected,) = found["rejected"]
    assert rejected.pop("reason").endswith("02")
    assert rejected == {"offset": 0, "length": 2}


def test_file_and_standard_input_are_read(tmp_path):
    path = tmp_path / "bytes.bin"
    path.write_bytes(bytes.fromhex(LUX) * 3)
    assert len(document("decode", "lutron", str(path))["readings"]) == 3
    piped = CliRunner().invoke(main, ["decode", "lutron", "-", "--json"], input=bytes.fromhex(LUX))
    assert len(json.loads(piped.stdout)["readings"]) == 1


def test_modbus_without_a_map_gives_raw_registers():
    raw = document("decode", "modbus", SMP)["readings"]
    assert [reading["value"] for reading in raw] == [1, 1, 1, 8437, 8391, 3, 313, 121]
    mapped = document("decode", "modbus", "--option", "map=kipp-smp", SMP)["readings"]
    assert mapped[0]["value"] == pytest.approx(843.7)
    assert "void_data" in mapped[0]["flags"]


def test_sentences_may_be_typed_as_they_are():
    sentence = "$GPGGA,021530.00,3541.3668,N,13945.3012,E,2,11,0.86,38.4,M,39.5,M,,0000*66"
    readings = {
        reading["channel"]: reading["value"] for reading in document("decode", "nmea", sentence)["readings"]
    }
    assert (readings["altitude"], readings["fix"], readings["satellites"]) == (38.4, 2, 11)
    assert readings["latitude"] == pytest.approx(35.689447, abs=1e-6)


def test_pictures_are_summed_up_in_kelvin(tmp_path):
    path = tmp_path / "frame.raw"
    path.write_bytes(b"\x20\x80" * (256 * 192) + (18890).to_bytes(2, "little") * (256 * 192))
    readings = document("decode", "p2pro", str(path))["readings"]
    assert [reading["channel"] for reading in readings] == ["minimum", "mean", "maximum"]
    assert (readings[1]["value"], readings[1]["unit"]) == (pytest.approx(18890 / 64), "K")
    assert "295.15625 K (22.01 °C)" in succeed("decode", "p2pro", path).stdout


def test_options_of_the_driver_can_be_given():
    counts = "4B 73 " * (80 * 60)
    assert document("decode", "y16", counts)["readings"][0]["unit"] == "counts"
    kelvin = document("decode", "y16", counts, "--option", "kelvin_per_count=0.01")["readings"][0]
    assert (kelvin["unit"], kelvin["value"]) == ("K", pytest.approx(295.15))


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("lutron", "02 3"), 3, "'02 3': "),
        (("lutron", "hello"), 3, "'hello': "),
        (("lutrn", "02"), 3, "lutron?"),
        (("modbus", "01", "--option", "map=nothing"), 3, "nothing: "),
        (("lutron", "02", "--option", "x"), 2, "'x': "),
    ],
)
def test_mistakes_are_explained(words, code, message):
    answer = fieldkit("decode", *words)
    assert answer.exit_code == code
    assert message in answer.stderr


@pytest.fixture
def plugged(monkeypatch):
    camera = ("/dev/video0", UsbIdentity(0x0408, 0x5362, "", "1-5", "Webcam"))
    adapter = ("/dev/ttyUSB0", UsbIdentity(0x10C4, 0xEA60, "A7", "1-2", "CP2102"))
    plugged_in(monkeypatch, cameras=[camera], serial_ports=[adapter])


def test_devices_lists_everything_with_its_identity(plugged):
    by_identity = {device["identity"]: device for device in document("devices")["devices"]}
    assert by_identity["10c4:ea60:A7"]["port"] == "/dev/ttyUSB0"
    assert {"lutron", "center-309", "pce-174", "modbus"} <= set(by_identity["10c4:ea60:A7"]["drivers"])
    assert by_identity["0408:5362"]["drivers"] == []
    assert "10c4:ea60:A7" in succeed("devices").stdout


def test_devices_tells_of_a_driver_that_cannot_be_loaded(tmp_path, monkeypatch):
    install(tmp_path, "broken-meter", "broken", "no_such_module:Driver")
    monkeypatch.syspath_prepend(tmp_path)
    plugged_in(monkeypatch)
    assert "broken: " in succeed("devices").stderr


def doctor(folder):
    """The checks by what they are of."""
    checks = json.loads(fieldkit("doctor", "--json", "-C", folder).stdout)["checks"]
    return {check["what"]: check for check in checks}


def test_doctor_says_what_is_missing_and_how_to_mend_it(plugged, monkeypatch, tmp_path):
    # root may open every node
    monkeypatch.setattr(discovery.os.path, "exists", lambda path: True)
    monkeypatch.setattr(discovery.os, "access", lambda path, mode: "tty" not in str(path))
    assert fieldkit("doctor", "-C", tmp_path).exit_code == DeviceError.exit_code
    checks = doctor(tmp_path)
    assert checks["/dev/ttyUSB0 (CP2102)"]["level"] == "fail"
    assert "usermod -aG dialout" in checks["/dev/ttyUSB0 (CP2102)"]["fix"]
    assert checks["/dev/video0 (Webcam)"]["level"] == "ok"
    assert "fieldkit init" in checks["configuration"]["fix"]


def configuration_checks(folder, text):
    folder.mkdir(exist_ok=True)
    (folder / "fieldkit.toml").write_text("[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\n" + text)
    return doctor(folder)


def test_doctor_tells_a_wrong_driver_beside_the_other_mistakes(tmp_path):
    text = '\n[lux]\ndriver = "lutrn"\n[record]\nevery_s = -1\n'
    found = configuration_checks(tmp_path / "hill", text)["configuration"]
    assert found["level"] == "fail"
    assert "lutron?" in found["text"]
    assert "record.every_s" in found["text"]


def test_doctor_misses_instruments_and_a_port_of_the_campaign(tmp_path):
    found = configuration_checks(tmp_path / "hill", "")["configuration"]
    assert (found["level"], found["text"][:13]) == ("warn", "0 instruments")
    assert "fieldkit devices" in found["fix"]
    lux = '\n[lux]\ndriver = "lutron"\nport = "/dev/ttyUSB-none"\noptions.range_max_lx = 4e5\n'
    thermometer = f'[thermometer]\ndriver = "center-309"\nport = "{tmp_path}"\n'
    found = configuration_checks(tmp_path / "hill", lux + thermometer)
    assert (found["configuration"]["level"], found["lux"]["level"]) == ("ok", "fail")
    assert "/dev/ttyUSB-none" in found["lux"]["text"]
    assert "thermometer" not in found


def test_doctor_doubts_an_old_calibration(tmp_path):
    made = datetime(2020, 1, 1, tzinfo=UTC)
    for kind, name, year in (("emissivity", "sand", 2021), ("irradiance", "roof", 9999)):
        expires = datetime(year, 1, 1, tzinfo=UTC)
        record = CalibrationRecord(kind, name, made, 0.93, 0.01, "1", "test", expires=expires)
        save(record, tmp_path / "hill/calibration")
    text = '\n[surface]\nemissivity = "@sand"\n[irradiance]\nmodel = "calibrated"\nfactor = "@roof"\n'
    checks = configuration_checks(tmp_path / "hill", text)
    assert checks["surface.emissivity"]["level"] == "warn"
    assert "2021-01-01" in checks["surface.emissivity"]["text"]
    assert checks["surface.emissivity"]["fix"].endswith("calibrate emissivity")
    assert checks["irradiance.factor"]["level"] == "ok"


def test_doctor_misses_an_instrument_of_the_campaign_and_names_the_others(plugged, tmp_path):
    meters = '\n[lux]\ndriver = "lutron"\nidentity = "0403:6001:GONE"\noptions.range_max_lx = 4e5\n'
    meters += '\n[thermometer]\ndriver = "center-309"\nidentity = "10c4:ea60"\n'
    checks = configuration_checks(tmp_path / "hill", meters)
    assert (checks["lux"]["level"], checks["thermometer"]["level"]) == ("fail", "ok")
    printed = succeed("doctor", "--udev", "-C", tmp_path / "hill").stdout
    assert 'ATTRS{serial}=="GONE", SYMLINK+="fieldkit/lux"' in printed


FAILING = """
from fieldkit.drivers.meters.lutron import Lutron

class Failing(Lutron):
    name = "failing"

    def find(self):
        return 1 / 0
"""


def test_selftest_passes_our_drivers_and_exits_accordingly(tmp_path, monkeypatch):
    assert document("selftest", "lutron")["passed"] is True
    install(tmp_path, "failing-meter", "failing", "failing_meter:Failing")
    (tmp_path / "failing_meter.py").write_text(FAILING)
    monkeypatch.syspath_prepend(tmp_path)
    answer = fieldkit("selftest", "failing")
    assert answer.exit_code == 4
    assert "ZeroDivisionError" in answer.stdout


def test_selftest_of_an_instrument_that_is_not_there_names_it():
    answer = fieldkit("selftest", "lutron", "--identity", "10c4:ea60:0001")
    assert answer.exit_code == 4
    assert "10c4:ea60:0001" in answer.stdout
