"""Connected instruments written into fieldkit.toml: real drivers on pseudo-terminals."""

import json
import os
import pty
import tomllib

import pytest

import fieldkit
from fieldkit.cli import main
from fieldkit.config import load_config
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.meters.modbus import pack_request
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action
from fieldkit.recording.adding import add_devices
from fieldkit.recording.doctor import doctor
from tests.harness import command_line
from tests.harness.connected import plugged_in
from tests.harness.network import NetworkAdapter
from tests.harness.next_steps import steps
from tests.unit.drivers.conftest import Wire

LUX = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
SMP = bytes.fromhex("01 04 10 00 01 00 00 00 00 03 E5 03 E5 00 00 00 F8 00 EA 66 12")
OF_NO_TYPE = bytes.fromhex("01 84 02 C2 C1")


@pytest.fixture
def plug(tmp_path, monkeypatch):
    """Connects serial adapters called by their serial number; their far ends."""
    wires, present = [], []
    plugged_in(monkeypatch, serial_ports=present)

    def connect(serial):
        wires.append(Wire(tmp_path / serial))
        present.append((wires[-1].path, UsbIdentity(0x10C4, 0xEA60, serial, f"1-{len(wires)}", "CP2102")))
        return wires[-1]

    yield connect
    for wire in wires:
        wire.cut()
        for thread in wire.threads:
            thread.join(2)


@pytest.fixture
def file(tmp_path):
    return fieldkit.init_campaign(tmp_path / "hill", (37.7, -105.92, 2317.0)).config.path


def run(file, *words):
    return command_line.fieldkit("devices", "--add", "-C", file.parent, *words)


def test_what_is_connected_is_added_and_every_comment_stays(plug, file):
    plug("A7").talk(LUX)
    before = file.read_text()
    asked = []
    done = add_devices(file, ask=lambda question: asked.append(question) or question.proposal)
    assert [(one.name, one.quantity, one.unit) for one in done.added] == [("lux", "illuminance", "lx")]
    assert [(one.key, one.proposal, "98760 lx" in str(one)) for one in asked] == [("driver", "lutron", True)]
    assert file.read_text() == before + '\n[lux]\ndriver = "lutron"\nidentity = "10c4:ea60:A7"\n'
    with fieldkit.open_campaign(file.parent).open_devices() as devices:
        assert devices["lux"].read().value == 98760.0


def test_what_is_configured_is_left_alone_and_named(plug, file):
    plug("A7").talk(LUX)
    assert run(file, "--instrument", "10c4:ea60:A7=lutron").exit_code == 0
    before = file.read_text()
    again = run(file, "--json")
    assert json.loads(again.stdout)["configured"] == {"10c4:ea60:A7": "lux"}
    assert "10c4:ea60:A7" in again.stderr
    assert file.read_text() == before


def test_a_second_one_of_a_quantity_has_a_table_of_its_own(plug, file):
    for serial in ("A7", "A8"):
        plug(serial).talk(LUX)
    stated = ("10c4:ea60:A7=lutron", "10c4:ea60:A8=lutron,range_max_lx=2e5")
    answer = run(file, "--json", *(word for one in stated for word in ("--instrument", one)))
    assert [one["name"] for one in json.loads(answer.stdout)["added"]] == ["lux", "lutron"]
    second = tomllib.loads(file.read_text())["device"]["lutron"]
    assert second == {"driver": "lutron", "identity": "10c4:ea60:A8", "options": {"range_max_lx": 2e5}}


def test_without_input_what_is_recognised_is_added_with_its_values(plug, file):
    plug("A7").talk(LUX)
    answer = run(file, "--no-input")
    assert answer.exit_code == 0
    assert "98760 lx" in answer.stderr
    assert load_config(file).devices[0].driver == "lutron"


def test_without_input_what_is_not_known_is_an_error_with_the_option_that_states_it(plug, file):
    plug("A7").talk(b"LUX 980.2\r\n")
    before = file.read_text()
    answer = run(file, "--no-input")
    assert answer.exit_code == 3
    assert "driver" in answer.stderr
    assert "LUX 980.2" in answer.stderr
    assert "neither a sign" in answer.stderr
    assert "--instrument 10c4:ea60:A7=X" in answer.stderr
    assert file.read_text() == before


def test_on_a_terminal_it_is_asked_for(plug, file, monkeypatch, capsys):
    plug("A7").talk(LUX)
    near, far = pty.openpty()
    with os.fdopen(far) as terminal, monkeypatch.context() as patch:
        patch.setattr("sys.stdin", terminal)  # click's runner has none
        os.write(near, b"lutrn\nlutron\n")
        assert not main(["devices", "--add", "-C", str(file.parent)], standalone_mode=False)
    os.close(near)
    assert "10c4:ea60:A7" in capsys.readouterr().err
    assert load_config(file).devices[0].driver == "lutron"


def test_one_that_fails_keeps_no_other_out(plug, file):
    plug("A7").talk(LUX)
    plug("A8")
    answer = run(file, "--instrument", "10c4:ea60:A7=lutron", "--json")
    found = json.loads(answer.stdout)
    assert answer.exit_code == 3
    assert [one["name"] for one in found["added"]] == ["lux"]
    assert "10c4:ea60:A8" in found["failures"][0]["message"]


def test_one_that_is_stated_and_not_connected_is_an_error_by_its_identity(plug, file):
    plug("A7").talk(LUX)
    answer = run(file, "--instrument", "10c4:ea60:A7=lutron", "--instrument", "10c4:ea60:A9=lutron")
    assert answer.exit_code == 4
    assert "added lux" in answer.stderr
    assert "10c4:ea60:A9" in answer.stderr


def test_a_board_whose_lines_have_no_unit_is_asked_for_it_once(plug, file):
    plug("B1").talk(b"21.5\r\n")
    stated = {"10c4:ea60:B1": {"driver": "text"}}
    refused = add_devices(file, stated).failures[0]
    assert "10c4:ea60:B1" in str(refused.place)
    assert steps(refused) == [Action.ADD_DEVICES(stated={"10c4:ea60:B1": {"driver": "text", "unit": "X"}})]
    asked = []
    done = add_devices(file, stated, lambda question: asked.append(question.key) or "C")
    assert asked == ["unit"]
    assert (done.added[0].name, done.added[0].unit) == ("thermometer", "K")
    assert load_config(file).devices[0].options == {"unit": "C"}


def test_a_register_map_and_what_its_radiation_measures_are_asked_for(plug, file):
    plug("M1").reply({pack_request(1, 4, 2, 8): SMP, pack_request(1, 4, 0, 1): OF_NO_TYPE})
    answers = {"map": "kipp-smp", "measures": "dni"}
    stated = {"10c4:ea60:M1": {"driver": "modbus"}}
    done = add_devices(file, stated, lambda question: answers.pop(question.key))
    assert (done.failures, answers) == ([], {})
    assert done.added[0].name == "modbus"
    config = load_config(file)
    assert config.devices[0].options == {"map": "kipp-smp"}
    assert config.tables.irradiance.measures == {"modbus": "dni"}


def test_an_adapter_of_something_else_is_skipped(plug, file):
    plug("A7")
    answer = run(file, "--instrument", "10c4:ea60:A7=skip")
    assert answer.exit_code == 0
    assert "skipped 10c4:ea60:A7" in answer.stderr


def test_instruments_are_not_added_to_simulated_ones(plug, tmp_path):
    plug("A7")
    file = fieldkit.init_campaign(tmp_path / "sim", simulated=True).config.path
    with pytest.raises(ConfigError, match=r"sim/fieldkit\.toml"):
        add_devices(file)


@pytest.mark.parametrize(
    ("words", "said"), [(("--instrument", "lutron"), "is not IDENTITY=DRIVER"), ((), "")]
)
def test_a_campaign_without_instruments_connected_stays_as_it_is(plug, file, words, said):
    before = file.read_text()
    answer = run(file, *words)
    assert answer.exit_code == (2 if said else 0)
    assert said in answer.stderr
    assert file.read_text() == before


def test_record_refuses_a_stream_whose_unit_is_not_known(plug, file):
    wire = plug("B1")
    wire.talk(b"21.5\r\n")
    with file.open("a") as config:
        config.write(f'\n[thermometer]\ndriver = "text"\nport = "{wire.path}"\n')
    with pytest.raises(ConfigError, match=r"(?s)thermometer.*options\.unit") as caught:
        fieldkit.record(file.parent, duration="1s")
    assert 'options.unit = "C"' in caught.value.fix
    checks = {one.what: one for one in doctor(file.parent)}
    assert (checks["thermometer"].level, checks["thermometer"].fix) == ("fail", caught.value.fix)
    wire.talk(b"T=21.5 C\r\n")
    assert "thermometer" not in {one.what for one in doctor(file.parent)}


def test_an_address_is_added_and_the_option_that_states_more_needs_no_other_argument(file):
    far = NetworkAdapter(talk=b"21.5\r\n")
    refused = add_devices(file, addresses=[far.port]).failures[0]
    (step,) = steps(refused)
    stated = {far.port: {**step.arguments[0].value[far.port], "unit": "C"}}
    (added,) = add_devices(file, stated).added
    far.unplug()
    assert (added.driver, added.port, added.options) == ("text", far.port, {"unit": "C"})
