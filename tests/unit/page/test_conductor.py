"""A recording is started once, however many browsers ask for it; a preview needs no reference."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fieldkit.config import Config, load_config
from fieldkit.config.edit import editing, remove_region
from fieldkit.model.errors import RefusedError
from fieldkit.page import conductor
from fieldkit.page.conductor import Conductor
from fieldkit.page.hub import Hub
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.campaign import init_campaign
from tests.harness.waiting import wait_until


class SlowToBegin:
    """A recording whose process takes a while to begin."""

    exit_code = None

    def __init__(self, campaign: Path, options: RecordOptions) -> None:
        time.sleep(0.2)  # as on a small computer

    def await_start(self, config: Config) -> Path:
        return config.recordings / "day.h5"


@pytest.fixture
def config(tmp_path):
    init_campaign(tmp_path / "field", simulated=True)
    return load_config(tmp_path / "field/fieldkit.toml")


def test_two_browsers_that_start_at_once_begin_one_recording(config, monkeypatch):
    monkeypatch.setattr(conductor, "BackgroundRecording", SlowToBegin)
    starting = Conductor(config, Hub(config), preview=False)
    with ThreadPoolExecutor() as browsers:
        asked = [browsers.submit(starting.start, RecordOptions()) for _ in range(2)]
    begun, refused = sorted(asked, key=lambda one: one.exception() is not None)
    assert begun.result().name == "day.h5"
    assert isinstance(refused.exception(), RefusedError)


def test_the_picture_on_which_a_removed_reference_is_drawn_anew_is_shown(config):
    with editing(config.path) as draft:
        remove_region(draft, "flat")
    hub = Hub(config)
    conducting = Conductor(config, hub)
    thread = threading.Thread(target=conducting.run)
    thread.start()
    try:
        wait_until(lambda: hub.latest.frame is not None, f"there is none: {hub.state}", 60.0)
        assert hub.state.phase == "preview"
        assert "no reference" in hub.state.problem
    finally:
        conducting.close()
        thread.join()
