"""Who gets what from the page: each test first shows the attack against a page without the guard."""

import http.client
import json
import os
import re
import socket
import stat
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Close

from fieldkit.page import answers, checks, requests, viewer
from fieldkit.page import server as page_server
from fieldkit.page.checks import CHECKS, known_host, same_origin
from fieldkit.page.hub import MAX_VIEWERS
from fieldkit.page.keys import MOST_KEPT, Keys
from fieldkit.page.server import listening
from fieldkit.page.sessions import identifier
from fieldkit.phrases import phrases
from fieldkit.recording.background import RecordOptions
from fieldkit.views.metrics import MEDIA_TYPE
from tests.harness.command_line import succeed
from tests.harness.disk import full_disk
from tests.harness.page import HOST, Browser, Served, campaign, served
from tests.harness.waiting import PATIENCE_S, wait_until

HOSTILE = "http://evil.example"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("page") / "field")


@pytest.fixture(scope="module")
def page(folder):
    with served(folder) as running:
        yield running


@pytest.fixture(scope="module")
def unguarded(folder):
    """A page without one of its checks."""
    return lambda left_out: served(folder, checks=[check for check in CHECKS if check is not left_out])


def closing(browser: Browser) -> Close:
    """How the server ends a connection."""
    with pytest.raises(ConnectionClosed) as closed:
        browser.next("never")
    assert closed.value.rcvd is not None
    return closed.value.rcvd


def refused(open_it: Callable[[], object]) -> int:
    with pytest.raises(InvalidStatus) as error:
        open_it()
    return error.value.response.status_code


def raw_socket(page: Served, cookie: str, host: str = "") -> socket.socket:
    """A WebSocket whose frames a test writes itself, with a host that no client library would send."""
    host = host or page.host
    raw = socket.create_connection((HOST, page.port), PATIENCE_S)
    raw.sendall(
        f"GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
        f"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        f"Sec-WebSocket-Version: 13\r\nCookie: {cookie}\r\n\r\n".encode()
    )
    return raw


# --- 1. only this computer unless an address is named


def test_it_listens_on_loopback_alone_unless_an_address_is_named():
    from fieldkit.cli.page import LOOPBACK, command

    default = next(option.default for option in command.params if option.name == "address")
    assert default == LOOPBACK == HOST == "127.0.0.1"
    with pytest.raises(OSError, match="Errno 99"):  # an empty one does not mean all networks
        listening("", 0)


# --- 2. host allow-list


def test_a_name_that_was_rebound_to_this_computer_gets_nothing(page, unguarded):
    def upgrade(running: Served, host: str) -> bytes:
        with raw_socket(running, running.cookie(), host) as raw:
            return raw.recv(12)

    with unguarded(known_host) as open_page:
        name = f"evil.example:{open_page.port}"  # resolves to 127.0.0.1 by now; origin and host agree
        assert open_page.ask("GET", "/", Host=name).status == 200
        key = open_page.page.keys.new_link("control")
        answer = open_page.ask("POST", "/key", {"key": key}, Host=name, Origin=f"http://{name}")
        assert answer.status == 200
        assert upgrade(open_page, "evil.example") == b"HTTP/1.1 101"
    name = f"evil.example:{page.port}"
    for path in ("/", "/role", "/session/x/report"):
        assert page.ask("GET", path, Host=name, Cookie=page.cookie()).status == 403
    key = page.page.keys.new_link("control")
    assert page.ask("POST", "/key", {"key": key}, Host=name, Origin=f"http://{name}").status == 403
    assert page.page.keys.is_link(key)
    assert upgrade(page, page.host) == b"HTTP/1.1 101"
    assert upgrade(page, "evil.example") == b"HTTP/1.1 403"


OWN_NAMES = ("127.0.0.1", "localhost", "LOCALHOST", socket.gethostname())
OTHERS = ("127.0.0.1.evil.example", "localhost.evil.example", "10.0.0.1", "[::1]", "", "127.1", "2130706433")


@pytest.mark.parametrize("name", OWN_NAMES + OTHERS)
def test_its_own_names_are_known_and_no_others(page, name):
    status = page.ask("GET", "/", Host=f"{name}:{page.port}").status
    assert status == (200 if name in OWN_NAMES else 403)


@pytest.mark.parametrize(
    ("name", "is_known"), [("127.0.0.1", True), ("localhost", True), ("[::1]", False), ("127.0.0.2", False)]
)
def test_ipv4_is_known_on_a_socket_of_both_kinds(page, name, is_known):
    scope = {"type": "http", "headers": [(b"host", name.encode())], "server": ("::ffff:127.0.0.1", 8765)}
    assert (known_host(scope, page.page.keys) is None) == is_known


# --- 3. origin of every upgrade and every POST


def test_a_hostile_page_opens_no_socket_with_the_browsers_cookie(page, unguarded):
    with unguarded(same_origin) as open_page, open_page.opened(HOSTILE, Cookie=open_page.cookie()) as browser:
        assert browser.next("hello")["role"] == "control"
    cookie = page.cookie()
    # a page on another port of this host is of the same site, so the browser sends the cookie along
    for origin in (
        HOSTILE,
        f"http://{HOST}:{page.port + 1}",
        f"https://{page.host}",
        "null",
        f"{page.origin}.evil",
    ):
        assert refused(lambda origin=origin: page.opened(origin, Cookie=cookie)) == 403


def test_a_hostile_page_cannot_use_up_or_try_keys(page, unguarded):
    with unguarded(same_origin) as open_page:
        key = open_page.page.keys.new_link("view")
        assert open_page.ask("POST", "/key", {"key": key}, Origin=HOSTILE).status == 200
    key = page.page.keys.new_link("view")
    assert page.ask("POST", "/key", {"key": key}, Origin=HOSTILE).status == 403
    assert page.ask("POST", "/key", {"key": key}, Origin="null").status == 403
    assert page.page.keys.is_link(key)


def test_without_an_origin_only_a_program_with_a_key_is_served(page, unguarded):
    with unguarded(same_origin) as open_page, open_page.opened(None, Cookie=open_page.cookie()) as browser:
        assert browser.next("hello")["role"] == "control"
    cookie = page.cookie()
    assert refused(lambda: page.opened(None, Cookie=cookie)) == 403
    assert refused(lambda: page.opened(None, Authorization="Bearer wrong")) == 403
    assert refused(lambda: page.opened(None, Cookie=cookie, Authorization="Bearer wrong")) == 403
    session = cookie.partition("=")[2]
    with page.opened(None, Authorization=f"Bearer {session}") as program:
        assert program.next("hello")["role"] == "control"
    key = page.page.keys.new_link("view")
    assert page.ask("POST", "/key", {"key": key}).status == 403
    assert page.ask("POST", "/key", {"key": key}, Authorization="Bearer wrong").status == 403
    answer = page.ask("POST", "/key", {}, Authorization=f"Bearer {key}")
    assert (answer.status, answer.json) == (200, {"role": "view"})


# --- 4. keys


def test_a_link_has_128_bits_works_once_and_its_cookie_is_for_this_page_alone(page):
    key = page.page.keys.new_link("control")
    assert len(key) == 22  # 16 bytes in base64
    answer = page.ask("POST", "/key", {"key": key}, Origin=page.origin)
    words = {word.strip().lower() for word in answer.headers["set-cookie"].split(";")[1:]}
    assert {"httponly", "samesite=strict", "path=/"} <= words
    assert key not in answer.headers["set-cookie"]
    again = page.ask("POST", "/key", {"key": key}, Origin=page.origin)
    assert again.status == 403
    assert "set-cookie" not in again.headers


def test_no_key_stands_in_the_file(folder):
    keys = Keys(folder / "recordings")
    link = keys.new_link("control")
    session, _ = keys.exchange(keys.new_link("control")) or ("", "")
    text = keys.path.read_text(encoding="utf-8")
    assert session
    assert link not in text
    assert session not in text
    assert stat.S_IMODE(keys.path.stat().st_mode) == 0o600


def tries(running: Served, count: int) -> float:
    """Seconds that so many wrong keys take."""
    began = time.monotonic()
    for number in range(count):
        assert running.ask("POST", "/key", {"key": f"{number}"}, Origin=running.origin).status == 403
    return time.monotonic() - began


def test_wrong_keys_are_answered_ever_more_slowly_and_right_ones_at_once(folder):
    with served(folder) as slow:
        assert tries(slow, page_server.WRONG_TRIES_FREE) < 1.0
        assert tries(slow, 2) >= 2.0
        began = time.monotonic()
        slow.cookie()
        assert time.monotonic() - began < 0.9


BODIES = ["x", "[]", '{"key": 3}', '{"key": null}', "{}", '{"key": "' + "x" * 5000 + '"}']
BODIES += [json.dumps({"key": key}) for key in ("\ud800", "\x00", "ü", "\U0001f321")]


@pytest.mark.parametrize("body", BODIES)
def test_what_is_no_key_is_refused(page, body, caplog):
    connection = http.client.HTTPConnection(HOST, page.port, timeout=PATIENCE_S)
    connection.request("POST", "/key", body, {"Content-Type": "application/json", "Origin": page.origin})
    assert connection.getresponse().status in (403, 429)
    connection.close()
    page.cookie()  # a right key: the next wrong one is not delayed
    assert not [record for record in caplog.records if record.exc_info]


# --- 5. two roles


CONTROL_ONLY = (
    {"do": "start", "name": "x", "duration": "1m"},
    {"do": "stop", "confirm": True},
    {"do": "mark", "text": "x"},
    {"do": "shutter"},
    {"do": "acknowledge", "alarm": "x"},
    {"do": "remove_region", "name": "b15", "confirm": True},
    {"do": "skyline", "points": [[1, 20], [30, 2]]},
    {"do": "suggest_regions"},
)


@pytest.mark.parametrize("what", CONTROL_ONLY, ids=lambda what: str(what["do"]))
def test_who_may_look_may_not_control(folder, page, what, monkeypatch):
    before = (folder / "fieldkit.toml").read_bytes()
    with page.browser("view") as browser:
        assert browser.next("hello")["role"] == "view"
        assert not browser.request(**what)["ok"]
        # without the guard the request goes through to what would do it
        # (which would start a recording: what it does is the other files' claim)
        everything = (*requests.FOR_ANYONE, *requests.FOR_CONTROL)
        monkeypatch.setattr(requests, "FOR_ANYONE", everything)
        monkeypatch.setattr(page.page.answers, "_carry_out", done_by_nobody)
        assert browser.request(**what)["text"] == "done"
    assert (folder / "fieldkit.toml").read_bytes() == before


async def done_by_nobody(_: object, request: requests.Request) -> answers.Done:
    return answers.Done("done")


def test_who_looks_does_not_hold_up_who_controls(page, monkeypatch):
    listed = threading.Event()
    monkeypatch.setattr(page.page.past, "rows", lambda _: [listed.wait()])  # as long as of a slow disk
    with ExitStack() as opened, page.browser() as control:
        for looking in [opened.enter_context(page.browser("view")) for _ in range(5)]:
            for _ in range(page_server.ANSWERS_AT_ONCE - 1):
                looking.socket.send('{"do": "sessions"}')
            looking.request(do="value", x=1, y=1)
        given_up = threading.Timer(5.0, listed.set)
        given_up.start()
        assert not control.request(do="mark", text="x")["ok"]  # nothing is recorded
        assert not listed.is_set(), "it waits behind their lists"
        given_up.cancel()
        listed.set()


def test_who_may_look_receives_no_files(page):
    for path in ("/session/0123456789abcdef/report", "/session/0123456789abcdef/download"):
        assert page.ask("GET", path).status == 403
        assert page.ask("GET", path, Cookie=page.cookie("view")).status == 403
        assert page.ask("GET", path, Cookie=page.cookie("control")).status == 404


def test_without_a_key_there_is_only_the_empty_document(page):
    answer = page.ask("GET", "/")
    assert answer.status == 200
    assert page.page.config.tables.campaign.title.encode() not in answer.body
    assert page.ask("GET", "/role").json == {"role": None}
    assert refused(page.opened) == 403
    assert refused(lambda: page.opened(Cookie=f"{page.page.cookie}=wrong")) == 403
    page.cookie()  # a right key: the next wrong one is not delayed


# --- 6. no trust in addresses


def test_a_program_reads_the_numbers_with_its_key_for_a_year_and_nothing_else(folder, page):
    assert page.ask("GET", "/metrics").status == 403
    assert page.ask("GET", "/metrics", Authorization="Bearer wrong").status == 403
    key = succeed("page", "--key", "-C", folder).stdout.strip()
    answer = page.ask("GET", "/metrics", Authorization=f"Bearer {key}")
    assert (answer.status, answer.headers["content-type"]) == (200, MEDIA_TYPE)
    families = {family.name for family in text_string_to_metric_families(answer.body.decode())}
    assert {"fieldkit_recording", "fieldkit_samples", "fieldkit_channel_value"} <= families
    assert page.page.keys.session(key)[1] - time.time() > 365 * 86_400
    for _ in range(MOST_KEPT + 1):
        page.page.keys.exchange(page.page.keys.new_link("control"))
    assert page.ask("GET", "/metrics", Authorization=f"Bearer {key}").status == 200
    assert page.ask("GET", "/session/x/download", Authorization=f"Bearer {key}").status == 403


@pytest.mark.parametrize(
    "header", ["X-Forwarded-For", "X-Forwarded-Host", "Forwarded", "X-Real-IP", "X-Forwarded-Proto"]
)
def test_what_a_proxy_says_changes_nothing(page, header):
    # no version without this guard can be shown: nothing in the page reads these headers, nor an address
    value = "for=127.0.0.1;host=localhost" if header == "Forwarded" else "127.0.0.1"
    more = {header.replace("-", "_"): value}
    assert page.ask("GET", "/role", **more).json == {"role": None}
    assert page.ask("GET", "/", Host="evil.example", **more).status == 403
    key = page.page.keys.new_link("view")
    assert page.ask("POST", "/key", {"key": key}, Origin=HOSTILE, **more).status == 403


# --- 7. no change of state by GET


def test_nothing_changes_by_get(folder, page):
    key = page.page.keys.new_link("control")
    config = (folder / "fieldkit.toml").read_bytes()
    for path in (f"/key?key={key}", f"/?key={key}", "/socket", "/start", "/stop", "/mark?text=x"):
        assert page.ask("GET", path, Cookie=page.cookie()).status in (200, 404, 405)
    assert page.page.keys.is_link(key)
    assert (folder / "fieldkit.toml").read_bytes() == config
    assert not list((folder / "recordings").glob("*.h5*"))


def test_a_form_of_another_page_is_no_request(page):
    key = page.page.keys.new_link("control")
    answer = page.ask("POST", "/key", {"key": key}, Origin=page.origin, Content_Type="text/plain")
    assert answer.status == 403
    assert page.page.keys.is_link(key)
    page.cookie()  # a right key: the next wrong one is not delayed


# --- 8. sessions end


def test_sessions_end(folder, monkeypatch):
    with served(folder) as page:
        cookie = page.cookie()
        assert page.ask("GET", "/role", Cookie=cookie).json == {"role": "control"}
        with page.opened(Cookie=cookie) as browser:
            browser.next("hello")
            later = time.time() + 25 * 3600
            monkeypatch.setattr("time.time", lambda: later)  # a day later
            assert "ended" in closing(browser).reason
        assert page.ask("GET", "/role", Cookie=cookie).json == {"role": None}


def test_links_end_unused(folder, monkeypatch):
    keys = Keys(folder / "recordings")
    key = keys.new_link("control")
    later = time.time() + 25 * 3600
    monkeypatch.setattr("time.time", lambda: later)  # a day later
    assert keys.exchange(key) is None


def test_browsers_stay_known_when_the_page_is_restarted(folder):
    with served(folder) as before:
        cookie, port = before.cookie(), before.port
    began = time.monotonic()
    with served(folder, port=port) as after, after.opened(Cookie=cookie) as browser:
        assert browser.next("hello")["role"] == "control"
    assert time.monotonic() - began < 2.0


# --- 9. what every answer says


def test_every_answer_carries_its_policy(page):
    answer = page.ask("GET", "/")
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    nonce = policy.partition("script-src 'nonce-")[2].partition("'")[0]
    assert len(nonce) == 22
    assert f'nonce="{nonce}"'.encode() in answer.body
    assert nonce.encode() not in page.ask("GET", "/").body
    for path in ("/", "/role", "/session/x/report", "/nothing"):
        headers = page.ask("GET", path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cache-control"] == "no-store"
        assert "server" not in headers


# --- 10. limits


def test_a_long_message_ends_its_connection(page):
    with page.browser() as browser:
        browser.socket.send("x" * (requests.MAX_BYTES + 1))
        assert closing(browser).code == 1009


def test_too_many_requests_end_their_connection(page):
    with page.browser() as browser:
        with suppress(ConnectionClosed):
            for _ in range(4 * viewer.BURST):
                browser.socket.send('{"do": "value", "x": 1, "y": 1}')
        assert closing(browser).reason == "too_many"


def test_viewers_are_counted_and_who_controls_takes_the_place_of_one_who_looks(folder):
    with served(folder) as page:
        browsers = [page.browser("view") for _ in range(MAX_VIEWERS)]
        for browser in browsers:
            browser.next("hello")
        with page.browser("view") as one_more:
            assert closing(one_more).code == page_server.FULL
        with page.browser("control") as control:
            assert control.next("hello")["role"] == "control"
            with pytest.raises(ConnectionClosed):
                browsers[0].next("never")
            assert browsers[1].next("now")
        for browser in browsers:
            browser.close()


def test_a_browser_that_takes_nothing_gives_up_its_place(folder, monkeypatch):
    monkeypatch.setattr(page_server, "ACKNOWLEDGED_WITHIN_S", 0.5)  # a shorter wait
    with served(folder) as page, raw_socket(page, page.cookie()):
        hub = page.page.hub
        wait_until(lambda: hub.viewers, "it does not connect")
        for number in range(20):  # more than its kernel and ours hold for it
            hub.become(problem=f"{number}" * 1_000_000)
        wait_until(lambda: not hub.viewers, "it keeps its place", 30.0)


def lasts(page: Served, *parts: bytes, at_most_s: float = 3.0) -> float:
    """Seconds until the server ends a connection that sends this and nothing more."""
    with socket.create_connection((HOST, page.port), PATIENCE_S) as slow:
        for part in parts:
            slow.sendall(part)
            time.sleep(0.2)  # so that the server reads one part after the other
        began = time.monotonic()
        slow.settimeout(at_most_s)
        with suppress(ConnectionResetError, TimeoutError):
            while slow.recv(1000):
                pass
        return time.monotonic() - began


def test_late_headers_end_their_connection(folder, monkeypatch):
    with served(folder) as page:
        host = f"Host: {page.host}\r\nOrigin: {page.origin}\r\n".encode()
        whole, half = b"GET /role HTTP/1.1\r\n" + host + b"\r\n", b"GET / HTTP/1.1\r\nHost: "
        about = host + b"Content-Type: application/json\r\nContent-Length: 9\r\n\r\n"
        assert lasts(page, half, at_most_s=1.0) >= 1.0  # within the time it may be late
        monkeypatch.setattr(checks, "REQUEST_WITHIN_S", 0.5)  # a shorter wait
        for late in ((b"",), (half,), (b"POST /key HTTP/1.1\r\n" + about + b"{",), (whole, half)):
            assert lasts(page, *late) < 2.5


HALF_OPEN = {
    "nothing": b"",
    "half a request": b"GET / HTTP/1.1\r\nHost: ",
    "half a key": b"POST /key HTTP/1.1\r\nHost: HOST\r\nContent-Type: application/json\r\nOrigin: http://HOST\r\n"
    b"Content-Length: 99\r\n\r\n{",
    "a request whose answer is not read": b"GET / HTTP/1.1\r\nHost: HOST\r\n\r\n",
}


@pytest.mark.parametrize("begun", HALF_OPEN.values(), ids=HALF_OPEN)
def test_half_open_connections_keep_out_nobody(folder, begun):
    with served(folder) as page, ExitStack() as opened:
        cookie = page.cookie()
        with page.opened(Cookie=cookie) as browser:
            for _ in range(110):
                one = opened.enter_context(socket.socket())
                one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
                one.connect((HOST, page.port))
                with suppress(ConnectionError):
                    one.sendall(begun.replace(b"HOST", page.host.encode()))
            with socket.create_connection((HOST, page.port), 5.0) as newcomer:
                newcomer.sendall(f"GET /role HTTP/1.1\r\nHost: {page.host}\r\n\r\n".encode())
                assert newcomer.recv(100).startswith(b"HTTP/1.1 200")
            assert browser.request(do="value", x=1, y=1)["ok"]  # who was there already, stays


def test_a_request_broken_off_counts_as_a_wrong_key_and_leaves_no_traceback(folder, caplog):
    with served(folder) as page:
        for _ in range(page_server.WRONG_TRIES_FREE - 1):
            with socket.create_connection((HOST, page.port), PATIENCE_S) as broken:
                broken.sendall(HALF_OPEN["half a key"].replace(b"HOST", page.host.encode()))
                broken.shutdown(socket.SHUT_WR)
                assert broken.recv(1) == b""  # the server has seen the end
        assert tries(page, 1) < 1.0  # the last free one
        assert tries(page, 1) >= 1.0
    assert not [record for record in caplog.records if record.exc_info]


def test_a_key_that_cannot_be_kept_is_answered_with_the_reason(folder):
    with served(folder) as page:
        key = page.page.keys.new_link("view")
        with full_disk(0):
            answer = page.ask("POST", "/key", {"key": key}, Origin=page.origin)
    assert answer.status == 507
    assert answer.json["key"] == "refused.storage"


@pytest.mark.parametrize(
    ("key", "value", "example"),
    [
        *(("duration", value, "90m") for value in ("soon", "3", "1e5s", "9" * 70 + "h", "--help")),
        ("until", "25:99", "15:05"),
        ("until", "noon", "15:05"),
        ("name", "a/b", "slash"),
    ],
)
def test_a_wrong_start_of_a_recording_is_answered_with_an_example(page, key, value, example):
    with page.browser() as browser:
        answer = browser.request(do="start", **{key: value})
    assert not answer["ok"]
    assert f"'{value[:20]}'" in answer["text"]
    assert example in answer["text"] + str(answer.get("fix"))


def test_a_long_duration_reaches_the_recorder():
    start = requests.parse('{"do": "start", "duration": "300h"}')
    assert isinstance(start, requests.Start)
    assert answers.record_options(start) == RecordOptions(duration_s=300 * 3600.0)


def test_a_request_that_fails_in_any_other_way_is_answered(page, monkeypatch, caplog):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("unlisted")

    monkeypatch.setattr(page.page.past, "rows", fail)  # only a mistake of ours does
    with page.browser() as browser:
        answer = browser.request(do="sessions")
    assert (answer["ok"], answer["key"]) == (False, "refused.failed")
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize(
    "name",
    ["..%2f..%2ffieldkit.toml", "%2fetc%2fpasswd", "../fieldkit.toml", "fieldkit.toml", "....//", "%00", "*"],
)
def test_no_path_of_a_browser_is_ever_opened(page, name):
    # without the comparison with the list, joining the name to the folder would reach the file
    assert (page.page.config.recordings / "../fieldkit.toml").exists()
    cookie = page.cookie()
    for what in ("download", "report"):
        answer = page.ask("GET", f"/session/{name}/{what}", Cookie=cookie)
        assert answer.status == 404
        assert b"schema" not in answer.body
    with page.opened(Cookie=cookie) as browser:
        assert not browser.request(do="check_session", session=name)["ok"]


def test_nothing_that_leads_out_of_the_folders_is_offered(tmp_path):
    folder = campaign(tmp_path / "field")
    recordings, reports = folder / "recordings", folder / "reports"
    recordings.mkdir(exist_ok=True)
    reports.mkdir(exist_ok=True)
    (recordings / "evil.h5").symlink_to("/etc/passwd")
    os.mkfifo(recordings / "pipe.h5")
    (recordings / "plain.h5").write_bytes(b"not a session")
    (reports / "plain.html").symlink_to("/etc/passwd")
    with served(folder) as page:
        cookie = page.cookie()
        with page.opened(Cookie=cookie) as browser:
            (listed,) = browser.request(do="sessions")["data"]
        assert listed["title"] == "plain"
        assert page.ask("GET", listed["download_url"], Cookie=cookie).body == b"not a session"
        report = page.ask("GET", listed["report_url"], Cookie=cookie)
        assert (report.status, b"is a link" in report.body, b"root:" in report.body) == (404, True, False)
        for name in ("evil.h5", "pipe.h5"):
            for what in ("download", "report", "picture"):
                path = f"/session/{identifier(recordings / name)}/{what}"
                assert page.ask("GET", path, Cookie=cookie).status == 404


def test_files_of_any_name_are_listed_and_a_session_without_a_file_is_explained(tmp_path):
    folder = campaign(
        tmp_path / "m\udce4rz"
    )  # a folder of a Latin-1 system, after which the campaign is named
    toml = folder / "fieldkit.toml"
    toml.write_text(re.sub(r"(?m)^title.*", "", toml.read_text(encoding="utf-8")), encoding="utf-8")
    latin, left = (folder / "recordings" / name for name in ("m\udce4rz.h5", "left.h5"))
    left.with_name("left.h5.journal").mkdir(parents=True)
    latin.write_bytes(b"not a session")
    with served(folder) as page:
        cookie = page.cookie()
        with page.opened(Cookie=cookie) as browser:
            assert browser.next("hello")["campaign"] == "m\udce4rz"
            assert {one["id"] for one in browser.request(do="sessions")["data"]} == set(
                map(identifier, (latin, left))
            )
            assert "m\udce4rz.h5" in browser.request(do="marks", session=identifier(latin))["text"]
        answers = {
            (path, what): page.ask("GET", f"/session/{identifier(path)}/{what}", Cookie=cookie)
            for path in (latin, left)
            for what in ("download", "report", "picture", "thumbnail")
        }
        assert answers[latin, "download"].body == b"not a session"
        assert [answers[latin, what].status for what in ("report", "picture", "thumbnail")] == [202, 404, 404]
        for what in ("download", "report", "picture", "thumbnail"):
            assert answers[left, what].body.startswith(b"left ")


def test_a_file_that_cannot_be_served_for_any_other_reason_is_explained(page, monkeypatch):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("no file at all")

    monkeypatch.setattr(page.page.past, "sealed_path", fail)  # only a mistake of ours does
    answer = page.ask("GET", "/session/0123456789abcdef/download", Cookie=page.cookie())
    assert (answer.status, answer.body.decode()) == (500, phrases()["refused.failed"])
