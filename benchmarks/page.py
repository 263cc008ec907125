"""The field page: CPU of its server, traffic, first picture and size, against Flask with an MJPEG stream.

`fieldkit record` keeps every picture of the simulated camera (160x120, 8.7 Hz) in a process of its own;
measured is the process that serves. `benchmarks.mjpeg_page` is the other side. CPU is that of the server's
process, in rounds that alternate. First pictures are those of the system's Chromium, from the start of
loading to the frame after the picture is drawn.
"""

from __future__ import annotations

import gzip
import http.client
import json
import math
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright
from websockets.sync.client import connect
from websockets.typing import Origin

from benchmarks.result import Result, Row
from benchmarks.sides import seconds, share
from fieldkit.model.samples import Frame
from fieldkit.page.document import document
from fieldkit.page.keys import Keys
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.status_request import feed_path
from fieldkit.views.feed import FeedReader

HOST = "127.0.0.1"
SECONDS, SETTLED_S, ROUNDS = 10.0, 1.0, 3
"""How long one look lasts; bytes of its first second are not counted."""
DELAYS_S = 60.0
STARTS_WITHIN_S = 60.0
FIRST_PICTURE = """new Promise((resolve) => {
    const look = () => document.getElementById("low").textContent
        ? requestAnimationFrame(() => resolve(performance.now())) : requestAnimationFrame(look);
    look();
})"""
WATCH_PICTURES = """
    window.drawn = [];
    let taken = null;
    const Original = WebSocket;
    window.WebSocket = class extends Original {
        constructor(...words) {
            super(...words);
            this.addEventListener("message", ({ data }) => {
                if (typeof data === "string") return;
                const size = new DataView(data).getUint16(0, true);
                taken = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 2, size))).time_ms;
            });
        }
    };
    const put = CanvasRenderingContext2D.prototype.putImageData;
    CanvasRenderingContext2D.prototype.putImageData = function (...words) {
        put.apply(this, words);
        const stamp = taken;
        if (this.canvas.id === "pixels") requestAnimationFrame(() => window.drawn.push([stamp, Date.now()]));
    };
"""
"""Notes of every picture the camera's time and that of the screen's next frame, in milliseconds."""
SERVER = "CPU of the serving process; 160x120 at 8.7 Hz recorded in another"
OVER_FLASK_3 = Row("flask-3", "server's CPU over Flask with MJPEG, 3 viewers", "<= 0.2", included=SERVER)
OVER_FLASK_8 = Row("flask-8", "server's CPU over Flask with MJPEG, 8 viewers", "<= 0.2", included=SERVER)
CPU = Row("cpu", "server's CPU, 8 viewers", "<= 5", "% of a core", SERVER)
TRAFFIC = Row("traffic", "traffic of a viewer", "<= 25", "kB/s")
HIDDEN = Row("hidden", "traffic of a viewer with the tab hidden", "<= 1", "kB/s")
DRAWN = "from the start of loading to the frame after it is drawn"
FIRST = Row("first", "first frame in Chromium, loopback", "<= 300", "ms", DRAWN)
FIRST_SLOW = Row("first-slow", "first frame, CPU 4x slower and 1.6 Mbit/s", "<= 1500", "ms", DRAWN)
DELAY = Row("delay", "camera to the screen's next frame, median", "<= 80", "ms", "three browsers")
DELAY_SLOWEST = Row(
    "delay-slowest", "camera to the screen's next frame, 99 %", "<= 250", "ms", "three browsers"
)
METRICS = Row("metrics", "`GET /metrics`, median", "<= 5", "ms", "beside a recording; on the clock")
SIZE = Row("size", "the page, gzip", "<= 40", "kB")
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


def run() -> list[Result]:
    """All of it; takes about three minutes."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as running:
        campaign = Path(folder) / "field"
        init_campaign(campaign, simulated=True)
        running.enter_context(
            _running("-P", "-m", "fieldkit", "record", "--set", "record.sampling=all", at=campaign)
        )
        ours, theirs = _free_port(), _free_port()
        words = ("-P", "-m", "fieldkit", "page", "--port", str(ours))
        page = running.enter_context(_running(*words, at=campaign))
        flask = running.enter_context(_running("-m", "benchmarks.mjpeg_page", str(theirs), at=Path.cwd()))
        for port in (ours, theirs):
            _wait_for(port)
        time.sleep(5.0)  # the recording has begun
        cookies = [_cookie(campaign, ours) for _ in range(8)]

        def view(count: int, mode: str = "jpeg") -> tuple[float, float]:
            return _load(page, [partial(_socket, ours, cookie, mode) for cookie in cookies[:count]])

        def view_flask(count: int) -> tuple[float, float]:
            return _load(flask, [partial(_stream, theirs)] * count)

        three, eight = ([(view(n), view_flask(n)) for _ in range(ROUNDS)] for n in (3, 8))
        hidden = view(1, "off")
        metrics_s = _median(seconds(partial(_metrics, ours, cookies[0])) for _ in range(50))
        pictures = _in_chromium(campaign, ours)
    size = len(gzip.compress(document("0" * 32).encode(), 9)) / 1000.0
    return [
        _ratio(OVER_FLASK_3, three),
        _ratio(OVER_FLASK_8, eight),
        CPU.result(100 * _median(ours[0] for ours, _ in eight)),
        TRAFFIC.result(
            _median(ours[1] for ours, _ in three) / 1000,
            f"Flask {_median(other[1] for _, other in three) / 1000:.0f} kB/s",
        ),
        HIDDEN.result(hidden[1] / 1000),
        *pictures,
        METRICS.result(1000 * metrics_s),
        SIZE.result(size),
    ]


def _ratio(row: Row, rounds: Sequence[tuple[tuple[float, float], tuple[float, float]]]) -> Result:
    return share(row, [(100 * ours[0], 100 * flask[0]) for ours, flask in rounds], "% of a core")


def _median(values: Iterable[float]) -> float:
    return float(statistics.median(values))


def _in_chromium(campaign: Path, port: int) -> list[Result]:
    """Delays that people see; nothing without the system's Chromium."""
    chromium = shutil.which("chromium")
    if chromium is None:
        return []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        results = [*_first_pictures(browser, campaign, port), *_delays(browser, campaign, port)]
        browser.close()
    return results


def _tab(browser: Browser, campaign: Path, port: int, script: str = "") -> Page:
    """A phone of its own that has used a link, and shows a picture."""
    tab = browser.new_context(viewport={"width": 360, "height": 740}).new_page()
    tab.add_init_script(script)
    tab.goto(f"http://{HOST}:{port}/#" + Keys(campaign / "recordings").new_link("view"))
    tab.evaluate(FIRST_PICTURE)
    return tab


def _first_pictures(browser: Browser, campaign: Path, port: int) -> list[Result]:
    """Five loads on loopback, and one on a slow phone in a slow network."""
    tab, address = _tab(browser, campaign, port), f"http://{HOST}:{port}/"
    loads = []
    for _ in range(5):
        tab.goto(address)
        loads.append(tab.evaluate(FIRST_PICTURE))
    devtools = tab.context.new_cdp_session(tab)
    devtools.send("Emulation.setCPUThrottlingRate", {"rate": 4})
    rates = dict.fromkeys(("downloadThroughput", "uploadThroughput"), 1.6e6 / 8)
    devtools.send("Network.emulateNetworkConditions", {"offline": False, "latency": 0, **rates})
    tab.goto(address)
    slow = tab.evaluate(FIRST_PICTURE)
    tab.context.close()
    return [FIRST.result(_median(loads)), FIRST_SLOW.result(slow)]


def _delays(browser: Browser, campaign: Path, port: int) -> list[Result]:
    """How long after the camera's frame a picture is on the screen, for one of three browsers that look."""
    tab, *_ = [_tab(browser, campaign, port, WATCH_PICTURES) for _ in range(3)]
    offset_ms = _clock_offset_ms(campaign)
    delays = [on_screen - taken - offset_ms for taken, on_screen in tab.evaluate("drawn.slice(20)")]
    note = f"{len(delays)} pictures, 3 browsers on this computer"
    return [
        DELAY.result(_median(delays), note),
        DELAY_SLOWEST.result(statistics.quantiles(delays, n=100)[-1]),
    ]


def _clock_offset_ms(campaign: Path) -> float:
    """The clock of this computer minus that of the simulated field, by the fastest frame of a while.

    Frames reach this follower of the recording a little after the camera's time, so delays come out too short
    by as much.
    """
    (session,) = (campaign / "recordings").glob("*.h5")
    reader, end = FeedReader(feed_path(session)), time.monotonic() + DELAYS_S
    offsets = [math.inf]
    for item in reader.items():
        if isinstance(item, Frame):
            offsets.append(time.time() * 1e3 - item.time_ns * 1e-6)
        if time.monotonic() > end:
            break
    reader.close()
    return min(offsets)


@contextmanager
def _running(*words: str, at: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process that is ended afterwards."""
    process = subprocess.Popen(
        [sys.executable, *words], cwd=at, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def _load(server: subprocess.Popen[bytes], viewers: Sequence[Callable[[float], int]]) -> tuple[float, float]:
    """Share of a core that a server takes while viewers look, and bytes a second of each."""
    received: list[int] = []
    end = time.monotonic() + SECONDS
    threads = [threading.Thread(target=lambda v=v: received.append(v(end))) for v in viewers]
    before = _cpu_s(server.pid)
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return (_cpu_s(server.pid) - before) / SECONDS, sum(received) / len(viewers) / (SECONDS - SETTLED_S)


def _cpu_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICK_S


def _socket(port: int, cookie: str, mode: str, end: float) -> int:
    """Bytes of a viewer's WebSocket until a time, once it has settled."""
    headers, origin = {"Cookie": cookie}, Origin(f"http://{HOST}:{port}")
    with connect(
        f"ws://{HOST}:{port}/socket", origin=origin, additional_headers=headers, compression=None
    ) as viewer:
        viewer.send(json.dumps({"do": "picture", "mode": mode, "id": 1}))
        total, first = 0, time.monotonic() + SETTLED_S
        while (left := end - time.monotonic()) > 0:
            try:
                message = viewer.recv(timeout=left)
            except TimeoutError:
                break
            if time.monotonic() > first:
                total += len(message)
        return total


def _stream(port: int, end: float) -> int:
    """Bytes of an MJPEG stream until a time, once it has settled."""
    connection = http.client.HTTPConnection(HOST, port)
    connection.request("GET", "/stream")
    answer, total, first = connection.getresponse(), 0, time.monotonic() + SETTLED_S
    while (now := time.monotonic()) < end:
        total += len(answer.read(4096)) * (now > first)
    connection.close()
    return total


def _cookie(campaign: Path, port: int) -> str:
    """The cookie that a browser has after it has opened a link."""
    connection = http.client.HTTPConnection(HOST, port)
    key = Keys(campaign / "recordings").new_link("view")
    headers = {"Origin": f"http://{HOST}:{port}", "Content-Type": "application/json"}
    connection.request("POST", "/key", json.dumps({"key": key}), headers)
    return (connection.getresponse().headers["set-cookie"] or "").partition(";")[0]


def _metrics(port: int, cookie: str) -> None:
    """All that a station's monitor asks for."""
    connection = http.client.HTTPConnection(HOST, port)
    connection.request("GET", "/metrics", headers={"Cookie": cookie})
    assert connection.getresponse().read().endswith(b"# EOF\n")
    connection.close()


def _free_port() -> int:
    with socket.socket() as listener:
        listener.bind((HOST, 0))
        return int(listener.getsockname()[1])


def _wait_for(port: int) -> None:
    deadline = time.monotonic() + STARTS_WITHIN_S
    while time.monotonic() < deadline:
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) == 0:
                return
        time.sleep(0.1)
    raise TimeoutError(f"nothing listens on port {port}")
