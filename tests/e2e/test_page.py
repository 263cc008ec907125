"""The page as it is used: live preview, start, mark, stop, report; and what a recording must survive."""

import json
import random
import re
import signal
import socket
import subprocess
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from fieldkit.model.samples import EventKind
from fieldkit.page.keys import Keys
from fieldkit.page.sessions import identifier
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import program
from tests.harness.page import HOST, Answer, Served, campaign, free_port, lost_nothing, served
from tests.harness.waiting import PATIENCE_S, wait_until

ALL_FRAMES = "record.sampling=all"
NO_PIPES = {"stdout": None, "stderr": None}


@dataclass
class OwnProcess(Served):
    """A page in a process of its own, started as a user starts it."""

    process: subprocess.Popen[str]

    @property
    def keys(self) -> Keys:
        return Keys(self.folder / "recordings")

    @property
    def folder(self) -> Path:
        return Path(self.page)  # type: ignore[arg-type]

    @property
    def kilobytes(self) -> int:
        return memory_kb(self.process.pid)


def memory_kb(pid: int) -> int:
    """Memory that only this process uses, kB."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    return sum(int(size) for size in re.findall(r"Private_(?:Clean|Dirty):\s+(\d+)", text))


@contextmanager
def started(folder: Path) -> Iterator[OwnProcess]:
    port = free_port()
    with program("page", "-C", folder, "--port", port, "--set", ALL_FRAMES, stdout=None) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        try:
            assert line.startswith(f"control  http://127.0.0.1:{port}/#"), line
            yield OwnProcess(folder, port, process)  # type: ignore[arg-type]
        finally:
            process.send_signal(signal.SIGTERM)
            process.stderr.close()
            process.wait(PATIENCE_S)


def test_a_day_at_the_beds(tmp_path):
    folder = campaign(tmp_path / "field")
    with served(folder, preview=True, record__sampling="all") as page, page.browser() as browser:
        assert browser.next("hello")["site"]["zone"] == "America/Denver"
        browser.next("state", phase="preview")
        browser.request(do="picture", mode="jpeg")
        header, _ = browser.picture()
        assert (header["rows"], header["cols"], header["mode"]) == (120, 160, "jpeg")
        assert browser.request(do="value", x=80, y=60)["data"]["temperature_c"] == pytest.approx(10, abs=30)
        streams = browser.next("now")["streams"]
        assert {"camera", "lux", "thermometer"} <= streams.keys()

        answer = browser.request(do="start", name="beds", duration="10m")
        assert answer["ok"], answer
        name = answer["data"]["session"]
        assert name.endswith("-beds")
        state = browser.next("state", phase="recording")
        assert (state["session"], state["ours"]) == (name, True)
        assert not browser.request(do="start")["ok"]
        first, _ = browser.picture()
        assert browser.picture()[0]["seq"] > first["seq"]

        answer = browser.request(do="mark", text="a cloud", kind="cloud", at="-2s")
        assert answer["ok"], answer
        answer = browser.request(do="stop", confirm=True)
        assert answer["ok"], answer
        browser.next("state", phase="preview")

        (listed,) = browser.request(do="sessions")["data"]
        assert (listed["state"], listed["id"]) == ("sealed", identifier(Path(f"{name}.h5")))
        answer = browser.request(do="check_session", session=listed["id"])
        assert answer["ok"], answer
        cookie = page.cookie()
        path = folder / "recordings" / f"{name}.h5"
        assert page.ask("GET", listed["download_url"], Cookie=cookie).body == path.read_bytes()
        report = the_report(page, listed["report_url"], cookie)
        assert name.encode() in report.body
        assert "sandbox" in report.headers["content-security-policy"]
    with open_session(path) as session:
        assert session.count("camera") > 2
        marks = [event for event in session.events() if event.kind is EventKind.MARK]
        assert [(mark.text, mark.data["label"]) for mark in marks] == [("a cloud", "cloud")]


def the_report(page: Served, url: str, cookie: str) -> Answer:
    def made() -> bool:
        return page.ask("GET", url, Cookie=cookie).status != 202

    wait_until(made, "the report is not made", PATIENCE_S, every_s=0.5)
    answer = page.ask("GET", url, Cookie=cookie)
    assert answer.status == 200, answer
    return answer


def record(folder: Path, seconds: int) -> subprocess.Popen[str]:
    return program("record", "-C", folder, "--for", f"{seconds}s", "-q", "--set", ALL_FRAMES, **NO_PIPES)


def test_a_recording_of_somebody_else_is_followed_and_finds_the_instruments_free(tmp_path):
    folder = campaign(tmp_path / "field")
    with served(folder, preview=True) as page, page.browser("view") as browser:
        browser.next("state", phase="preview")
        recorder = record(folder, 8)
        state = browser.next("state", phase="recording")
        assert not state["ours"]
        browser.request(do="picture", mode="exact")
        assert browser.picture()[0]["mode"] == "exact"
        browser.next("state", phase="preview")
        assert recorder.wait(PATIENCE_S) == 0


def test_requests_reach_the_recording_and_its_events_answer(tmp_path):
    folder = campaign(tmp_path / "field")
    with served(folder, record__sampling="all") as page, page.browser() as browser:
        assert browser.request(do="start", duration="60s")["ok"]
        (first, *_) = browser.next("regions")["regions"]
        answer = browser.request(do="shutter")
        assert (answer["ok"], answer["event"]["kind"]) == (True, "shutter"), answer
        assert browser.request(do="mark", text="wind")["ok"]
        wait_until(lambda: browser.request(do="marks")["data"], "the mark is not stored")
        answer = browser.request(do="take_back", mark=1)
        assert (answer["ok"], answer["event"]["data"]["takes_back"]) == (True, 1), answer
        answer = browser.request(do="acknowledge", alarm="disk")
        assert (answer["ok"], answer["key"]) == (False, "refused.no_alarm"), answer
        drawn = {"name": "corner", "kind": "target", "points_px": [[2, 2], [20, 2], [20, 16], [2, 16]]}
        answer = browser.request(do="add_region", region=drawn)
        assert (answer["ok"], answer["event"]["data"]["added"]) == (True, ["corner"]), answer
        with page.browser("view") as other:
            drawn_names = {region["name"] for region in other.next("regions")["regions"]}
            assert drawn_names >= {"corner", first["name"]}
        smaller = {**drawn, "points_px": [[2, 2], [18, 2], [18, 16], [2, 16]], "tilt_deg": 12.0}
        found = browser.request(do="check_region", region=smaller, instead_of="corner")["data"]
        assert found["level"] != "FAIL", found
        answer = browser.request(do="edit_region", name="corner", region=smaller)
        assert (answer["ok"], answer["event"]["data"]["changed"]) == (True, ["corner"]), answer
        over = {**drawn, "name": "over", "points_px": first["points_px"]}
        answer = browser.request(do="add_region", region=over)
        assert (answer["ok"], "shares" in answer["text"]) == (False, True), answer
        answer = browser.request(do="remove_region", name="corner", confirm=True)
        assert (answer["ok"], answer["event"]["data"]["removed"]) == (True, ["corner"]), answer
        answer = browser.request(do="skyline", points=[[1, 20], [18, 10]])
        assert (answer["ok"], answer["key"]) == (False, "refused.horizon_kept"), answer
        assert browser.request(do="stop", confirm=True)["ok"]
        browser.next("state", phase="no-instruments")  # its process has ended, too
    (path,) = (folder / "recordings").glob("*.h5")
    with open_session(path) as session:
        kinds = [event.kind for event in session.events() if "request" in event.data]
        assert session.marks() == {}
    assert kinds.count(EventKind.REGION) == 3
    assert EventKind.SHUTTER in kinds


def test_a_page_that_is_killed_leaves_its_recording_alone(tmp_path):
    folder = campaign(tmp_path / "field")
    with started(folder) as page, page.browser() as browser:
        assert browser.request(do="start", duration="10m")["ok"]
        browser.next("state", phase="recording")
        page.process.kill()
        page.process.wait(PATIENCE_S)
    with started(folder) as again, again.browser() as browser:
        browser.next("state", phase="recording")  # which goes on, and is followed
        first_ms = browser.next("now")["time_ms"]
        assert browser.next("now")["time_ms"] > first_ms
        assert browser.request(do="stop", confirm=True)["ok"]
        wait_until(lambda: session_in_progress(folder / "recordings") is None, "the recording did not end")
    lost_nothing(folder)


def test_regions_may_lack_a_reference_until_the_next_change(tmp_path):
    folder = campaign(tmp_path / "field")
    bed = {"name": "bed", "kind": "target", "points_px": [[2, 98], [20, 98], [20, 112], [2, 112]]}
    with served(folder) as page, page.browser() as browser:
        removed = browser.request(do="remove_region", name="flat", confirm=True)
        added = browser.request(do="add_region", region=bed)
        assert [one["ok"] for one in (removed, added)] == [True, True]
        assert (added["key"], added["data"]["name"]) == ("done.added", "bed")
        assert [text["key"] for text in added["data"]["missing"]] == ["error.no_reference"]
        assert [region.name for region in page.page.hub.latest.regions] == ["b05", "b15", "b25", "bed"]
        level = {**bed, "kind": "reference", "tilt_deg": 0.0}
        edited = browser.request(do="edit_region", name="bed", region=level)
        assert (edited["key"], edited["data"]) == ("done.changed", {"name": "bed", "missing": []})


def come_and_go(page: Served, cookie: str, count: int) -> None:
    """Connections that do something different each time, mostly nothing sensible."""
    rng = random.Random(1)
    for number in range(count):
        with suppress(OSError, ConnectionClosed, InvalidStatus, TimeoutError):
            if number % 4 == 0:
                with page.opened(Cookie=cookie) as browser:
                    browser.socket.send(json.dumps({"do": "picture", "mode": rng.choice(["jpeg", "exact"])}))
                    if number % 8 == 0:
                        browser.socket.send(rng.randbytes(rng.randrange(2000)))
                        browser.socket.send(rng.randbytes(20).hex())
            elif number % 4 == 1:
                page.ask("GET", rng.choice(["/", "/role", "/nothing"]))
            else:
                with socket.create_connection((HOST, page.port), PATIENCE_S) as raw:
                    raw.sendall(rng.randbytes(rng.randrange(1, 3000)) if number % 4 == 2 else b"GET / HT")


def storm(folder: Path, seconds: int, connections: int) -> None:
    with started(folder) as page, page.browser() as browser:
        recording = browser.request(do="start", duration=f"{seconds}s")
        assert recording["ok"], recording
        path = folder / "recordings" / f"{recording['data']['session']}.h5"
        browser.request(do="picture", mode="jpeg")
        cookie = page.cookie()
        come_and_go(page, cookie, 24)
        before = page.kilobytes
        deaf = page.opened(Cookie=cookie)  # never reads: what it is sent fills its sockets
        deaf.socket.send(json.dumps({"do": "picture", "mode": "exact"}))
        come_and_go(page, cookie, connections)
        assert path.with_name(f"{path.name}.journal").exists(), "the recording ended before the storm"
        assert browser.picture()
        assert page.kilobytes - before < 10_000
        wait_until(
            lambda: session_in_progress(folder / "recordings") is None,
            "the recording did not end",
            seconds + PATIENCE_S,
        )
        with suppress(ConnectionClosed, OSError):
            deaf.close()
    lost_nothing(folder, seconds)


@pytest.mark.slow
def test_a_thousand_connections_that_come_and_go_cost_a_recording_nothing(tmp_path):
    storm(campaign(tmp_path / "field"), 120, 1000)


def test_a_past_session_is_drawn_on_and_estimated_anew(tmp_path):
    folder = campaign(tmp_path / "field")
    with record(folder, 4) as recorder:
        assert recorder.wait(PATIENCE_S) == 0
    with served(folder) as page, page.browser() as browser:
        (listed,) = browser.request(do="sessions")["data"]
        with page.browser("view") as looking:
            assert looking.request(do="sessions")["data"][0]["picture_url"] is None
            assert not looking.request(do="estimate_session", session=listed["id"])["ok"]
        assert page.ask("GET", listed["picture_url"], Cookie=page.cookie("view")).status == 403
        picture = page.ask("GET", listed["picture_url"], Cookie=page.cookie()).body
        size = int.from_bytes(picture[:2], "little")
        header = json.loads(picture[2 : 2 + size])
        assert (header["rows"], header["cols"], header["mode"]) == (120, 160, "exact")
        assert len(zlib.decompress(picture[2 + size :])) == 120 * 160 * 2
        drawn = {"name": "corner", "kind": "target", "points_px": [[2, 2], [20, 2], [20, 16], [2, 16]]}
        found = browser.request(do="check_region", region=drawn, session=listed["id"])["data"]
        assert (found["level"] != "FAIL", found["spread_c"] > 0) == (True, True), found
        assert browser.request(do="add_region", region=drawn)["ok"]
        answer = browser.request(do="estimate_session", session=listed["id"])
        assert answer["ok"], answer
        assert "corner" in {slope["region"] for slope in answer["data"]}
