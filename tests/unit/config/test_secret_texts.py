"""No password, token or topic gets into a configuration, from which it would get into every session."""

import json
from typing import Any

import pytest
import tomlkit

from fieldkit.config import ConfigMistakesError, load_config

SITE = "[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\n"
SECRET = "s3cr3t"
TOKEN = f"tk_{SECRET}{'x' * 23}"

REFUSED: list[tuple[str, Any, str]] = [
    ("alarms.services", f"mqtt://user:{SECRET}@10.0.0.1/sand", "services_file"),
    ("alarms.services", f"tgram://{SECRET}/1", "services_file"),
    ("alarms.services", f"https://example/{SECRET}", "services_file"),
    ("alarms.services_file", f"tgram://{SECRET}/1", "that file's name"),
    ("alarms.services_file", TOKEN, "that file's name"),
    ("alarms.mqtt_password", SECRET, "a file of its own"),
    ("camera.port", f"rtsp://admin:{SECRET}@10.0.0.2/stream", "a file of its own"),
    ("camera.options.password", SECRET, "a file of its own"),
    ("camera.options.login.auth_token", SECRET, "a file of its own"),
    ("camera.options.api_key", 31415926, "a file of its own"),
    ("campaign.description", f"alarms: https://ntfy.sh/{SECRET}", "a file of its own"),
    ("campaign.description", f"calls matrixs://{SECRET}@host/room", "a file of its own"),
    ("campaign.references", f"https://{SECRET}@example.org/paper", "a file of its own"),
    ("campaign.references", f"https://example.org/a?x=1&X-Amz-Signature={SECRET}", "a file of its own"),
]

ACCEPTED: list[tuple[str, Any]] = [
    ("alarms.services_file", "~/.config/fieldkit/services.txt"),
    ("campaign.description", "mail: me@example.org; token of thanks; at 12:30 @ the field"),
    ("campaign.references", "https://doi.org/10.1000/1?page=2, https://medium.com/@me/sand"),
]


def names(cases: list[Any]) -> list[str]:
    return [f"{case[0]} {number}" for number, case in enumerate(cases)]


def toml(key: str, value: Any) -> str:
    """A campaign with this key."""
    document = tomlkit.parse(f'{SITE}[camera]\ndriver = "purethermal"\n[alarms]\n[campaign]\n')
    *tables, last = key.split(".")
    table: Any = document
    for name in tables:
        table = table.setdefault(name, {})
    table[last] = value
    return tomlkit.dumps(document)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "fieldkit.toml"
    path.write_text(f'{SITE}[camera]\ndriver = "purethermal"\n', encoding="utf-8")
    return path


@pytest.mark.parametrize(("key", "value", "fix"), REFUSED, ids=names(REFUSED))
def test_a_secret_is_refused_with_the_fix_and_without_the_secret(file, key, value, fix):
    as_setting = [f"{key}={json.dumps(value)}"]
    name = f"FIELDKIT_{key.upper().replace('.', '__')}"
    text = toml(key, value)
    for environment, settings, written in (
        ({}, as_setting, None),
        ({name: json.dumps(value)}, [], None),
        ({}, [], text),
    ):
        if written is not None:
            file.write_text(written, encoding="utf-8")
        with pytest.raises(ConfigMistakesError) as caught:
            load_config(file, settings=settings, environment=environment)
        (mistake,) = caught.value.mistakes
        assert f" {key}: " in mistake
        assert fix in mistake
        assert SECRET not in str(caught.value)
        assert "31415926" not in str(caught.value)


@pytest.mark.parametrize(("key", "value"), ACCEPTED, ids=names(ACCEPTED))
def test_what_only_resembles_a_secret_is_accepted(file, key, value):
    load_config(file, settings=[f"{key}={json.dumps(value)}"], environment={})


def test_a_setting_that_is_wrong_in_another_way_does_not_show_its_secret(file):
    address = f"mqtt://user:{SECRET}@host"
    for setting in (
        f'alarms.services = {{url = "{address}"}}',
        f'alarms = {{services = "{address}"}}',
        f"alarms.services={address}",
    ):
        with pytest.raises(ConfigMistakesError) as caught:
            load_config(file, settings=[setting, "surface.albedo=9"], environment={})
        assert SECRET not in str(caught.value)
        assert "surface.albedo" in str(caught.value)
