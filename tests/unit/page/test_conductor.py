"""A recording is started once, however many browsers ask for it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fieldkit.config import load_config
from fieldkit.model.errors import RefusedError
from fieldkit.page import conductor
from fieldkit.page.conductor import Conductor
from fieldkit.page.hub import Hub
from fieldkit.recording.campaign import init_campaign


class SlowToBegin:
    """A recording whose process takes a while to begin."""

    has_ended = False

    def __init__(self, campaign: Path, options: Sequence[str]) -> None:
        time.sleep(0.2)  # as on a small computer

    def await_start(self, recordings: Path) -> Path:
        return recordings / "day.h5"


def test_two_browsers_that_start_at_once_begin_one_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    init_campaign(tmp_path / "field", simulated=True)
    config = load_config(tmp_path / "field/fieldkit.toml")
    monkeypatch.setattr(conductor, "BackgroundRecording", SlowToBegin)
    starting = Conductor(config, Hub(config), preview=False)
    with ThreadPoolExecutor() as browsers:
        asked = [browsers.submit(starting.start, "", (), allow_missing=False) for _ in range(2)]
    begun, refused = sorted(asked, key=lambda one: one.exception() is not None)
    assert begun.result().name == "day.h5"
    with pytest.raises(RefusedError, match="is being recorded already"):
        refused.result()
