"""Home Assistant finds a recording by MQTT, through a real broker (Mosquitto).

Topics, keys, device classes and units: Home Assistant's documentation of "MQTT discovery", "MQTT sensor",
"MQTT binary sensor" and "Sensor: device class" (home-assistant.io).
"""

import json
import re
import shutil
import subprocess
import time
from typing import Any

import pytest
from paho.mqtt import client as client_module

from fieldkit.model.errors import ConfigError
from tests.harness.page import free_port
from tests.harness.simulated import record_simulated

UNITS = {"temperature": "°C", "illuminance": "lx", "irradiance": "W/m²", "wind_speed": "m/s", None: "°"}
"""A unit that Home Assistant takes for each device class; none: an angle."""
FAULT = 'simulation.faults=["moved"]'


@pytest.fixture
def broker(tmp_path):
    """The port of a broker that lets anybody in."""
    program = shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin:/usr/bin")
    if program is None:
        pytest.skip("no mosquitto here: apt-get install mosquitto")
    port = free_port()
    (tmp_path / "mosquitto.conf").write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
    with subprocess.Popen([program, "-c", tmp_path / "mosquitto.conf"], stderr=subprocess.DEVNULL) as process:
        yield port
        process.terminate()


def retained(port: int) -> dict[str, str]:
    """Every text that the broker keeps, by topic."""
    from paho.mqtt.enums import CallbackAPIVersion

    found: dict[str, str] = {}
    client = client_module.Client(CallbackAPIVersion.VERSION2)
    client.on_connect = lambda connected, *_: connected.subscribe("#")
    client.on_message = lambda _client, _data, message: found.update(
        {message.topic: message.payload.decode(errors="replace")}
    )
    client.connect("127.0.0.1", port)
    client.loop_start()
    count, deadline = -1, time.monotonic() + 60.0
    while len(found) != count and time.monotonic() < deadline:  # until no more come
        count = len(found)
        time.sleep(0.5)  # a broker does not say which of what it keeps is the last
    client.disconnect()
    client.loop_stop()
    return found


def test_a_recording_is_found_with_its_meters_regions_and_alarms(broker, tmp_path):
    services = tmp_path / "services.txt"
    services.write_text(f"mqtt://127.0.0.1:{broker}/my field\n", encoding="utf-8")
    services.chmod(0o600)
    outputs = ("alarms.send=info", f"alarms.services_file={services}", "alarms.home_assistant=true")
    record_simulated(tmp_path / "field", 20, *outputs, FAULT)
    found = retained(broker)
    configs = {topic: json.loads(text) for topic, text in found.items() if topic.startswith("homeassistant/")}
    for topic, config_ in configs.items():
        is_found_and_understood(topic, config_, found)
    sensors = {one["unique_id"] for one in configs.values()}
    assert {"fieldkit_my_field_region_b15_tilt", "fieldkit_my_field_stream_lux"} <= sensors
    assert any(topic.startswith("homeassistant/binary_sensor/my_field/alarm_moved") for topic in configs)
    assert found["my field/recorder"] == "ended"
    assert "homeassistant/image/my_field/image_camera/config" in configs
    assert found["my field/image/camera"][1:4] == "PNG"
    tilt = float(found["my field/region/b15/tilt"])
    assert tilt == pytest.approx(15.0, abs=5.0)  # of the simulated bed
    assert 10_000 < float(found["my field/stream/lux"]) < 200_000


def is_found_and_understood(topic: str, config: dict[str, Any], found: dict[str, str]) -> None:
    assert re.fullmatch(r"homeassistant/((binary_)?sensor|image)/[a-zA-Z0-9_-]+/[a-zA-Z0-9_-]+/config", topic)
    assert config.get("state_topic", config.get("image_topic")) in found
    assert config["availability"][0]["topic"] in found
    assert config["device"]["identifiers"]
    if topic.startswith("homeassistant/image"):
        assert config["content_type"] == "image/png"
    elif topic.startswith("homeassistant/binary_sensor"):
        assert config["device_class"] == "problem"
        assert json.loads(found[config["state_topic"]])["phase"] in ("raised", "acknowledged", "cleared")
    else:
        assert config["unit_of_measurement"] == UNITS[config.get("device_class")]
        assert found[config["state_topic"]] == "None" or float(found[config["state_topic"]])


def test_without_a_broker_the_recording_does_not_begin(tmp_path):
    with pytest.raises(ConfigError, match=r"alarms\.home_assistant") as refused:
        record_simulated(tmp_path / "field", 1, "alarms.home_assistant=true")
    assert "alarms.services_file" in (refused.value.fix or "")
