"""Past sessions for browsers: the list, a check, the file, and what is made of it: report, image, time-lapse.

A session is named by an id from the list, which is compared with the list anew; nothing that a browser sends
ever becomes part of a path. Files are made and checked in processes of their own, one at a time and yielding
to everything else: a recording that runs must not notice them.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import sys
import time
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from fieldkit.config import Config
from fieldkit.disk import is_regular
from fieldkit.model.arrays import FloatArray
from fieldkit.model.device import find_camera
from fieldkit.page import outgoing
from fieldkit.page.phrases import PageError
from fieldkit.page.pictures import thumbnail
from fieldkit.page.viewer import Role
from fieldkit.recording.background import command_error
from fieldkit.recording.recordings import sessions_in
from fieldkit.recording.regions import first_frames_k
from fieldkit.results.describe import describe_briefly, recorded_slopes
from fieldkit.results.report import default_path
from fieldkit.sessions.lock import is_locked, journal_path
from fieldkit.sessions.reader import open_session

PRODUCTS = {"report": ".html", "image": ".png", "timelapse": ".mp4"}
"""Files that are made of a session in the folder of its report: one image of the day, the day as a film."""
FILES = (*PRODUCTS, "download", "picture", "thumbnail")
FILM_FRAMES = 300
"""Frames of a time-lapse, 12 s: a small computer takes about a second for ten."""
SHOWN = 200
"""The latest sessions of a campaign; more are listed by ``fieldkit ls``."""


def identifier(path: Path) -> str:
    """The id of a session: letters and digits that tell nothing of its path."""
    return hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]


@dataclass
class PastSessions:
    """The sessions of a campaign, its latest first."""

    config: Config
    _one_job: asyncio.Lock = field(default_factory=asyncio.Lock)
    _one_check: asyncio.Lock = field(default_factory=asyncio.Lock)
    _frames: dict[Path, FloatArray] = field(default_factory=dict)
    _thumbnails: dict[tuple[Path, int], bytes] = field(default_factory=dict)
    _making: dict[Path, asyncio.Task[str]] = field(default_factory=dict)
    _asked_s: dict[Path, float] = field(default_factory=dict)

    def paths(self) -> dict[str, Path]:
        """Files by id."""
        latest = sessions_in(self.config.recordings)[::-1][:SHOWN]
        return {identifier(path): path for path in latest}

    def path(self, identity: str) -> Path:
        """The file of a session in the list; raises `PageError` for anything else."""
        path = self.paths().get(identity)
        if path is None:
            raise PageError("no_session")
        return path

    def sealed_path(self, identity: str) -> Path:
        """The same for one that has a file; raises `PageError` while it is being recorded."""
        path = self.path(identity)
        if is_locked(journal_path(path)):
            raise PageError("being_recorded", session=path.stem)
        if not path.exists():
            raise PageError("interrupted", session=path.stem)
        return path

    def rows(self, role: Role) -> list[dict[str, Any]]:
        """The list for a browser; links to files only where it may control."""
        return [self._entry(name, path, role) for name, path in self.paths().items()]

    def _entry(self, name: str, path: Path, role: Role) -> dict[str, Any]:
        brief = describe_briefly(path)
        start = brief.get("start")
        started_ms = datetime.fromisoformat(start).timestamp() * 1000 if start else None
        has_files = role == "control" and path.exists() and not is_locked(journal_path(path))
        links = {f"{file}_url": f"/session/{name}/{file}" if has_files else None for file in FILES}
        about = {"id": name, "title": brief.get("title") or path.stem, "state": brief["state"]}
        extent = {"started_ms": started_ms, "duration_s": brief.get("length_s"), "bytes": brief["bytes"]}
        return about | extent | links

    async def check(self, identity: str) -> tuple[bool, int, list[dict[str, Any]]]:
        """Whether a session is without failures, the number of checks, and what they found wrong."""
        path = self.sealed_path(identity)
        async with self._one_check, self._one_job:  # a report waits for one check at most
            _, output, errors = await _fieldkit("check", str(path))
        try:
            findings = json.loads(output)["sessions"][0]["findings"]
        except (ValueError, KeyError, IndexError):
            raise command_error(errors, PageError("failed")) from None
        issues = [finding for finding in findings if finding["level"] != "ok"]
        is_clean = not any(finding["level"] == "fail" for finding in findings)
        return is_clean, len(findings), issues

    def frame_k(self, identity: str) -> FloatArray:
        """The mean of a session's first good frames in kelvin, to draw on."""
        path = self.sealed_path(identity)
        if path not in self._frames:
            self._frames = {path: first_frames_k(path).mean(axis=0)}  # of the one that is looked at
        return self._frames[path]

    def thumbnail(self, identity: str) -> bytes:
        """A small image of that frame, as a message for browsers."""
        path = self.sealed_path(identity)
        key = (path, path.stat().st_mtime_ns)
        if key not in self._thumbnails:
            self._thumbnails[key] = thumbnail(first_frames_k(path).mean(axis=0))
        return self._thumbnails[key]

    def slopes(self, identity: str) -> list[dict[str, Any]]:
        """The final slope of each target of a session, as recorded."""
        with open_session(self.sealed_path(identity)) as session:
            return [outgoing.slope(slope) for slope in recorded_slopes(session)]

    async def estimate(self, identity: str) -> list[dict[str, Any]]:
        """Slopes of a session with the campaign's regions as they are now."""
        path = self.sealed_path(identity)
        async with self._one_job:
            _, output, errors = await _fieldkit("estimate", str(path), "--campaign")
        try:
            return list(json.loads(output)["slopes"])  # there also where none was found
        except (ValueError, KeyError):
            raise command_error(errors, PageError("failed")) from None

    def product(self, kind: str, identity: str) -> Path | asyncio.Task[str]:
        """One of the `PRODUCTS` of a session, or the task that makes it; its result is why it failed."""
        session = self.sealed_path(identity)
        file = default_path(session).with_suffix(PRODUCTS[kind])
        if os.path.lexists(file) and not is_regular(file):  # it may lead anywhere
            raise PageError("no_file", file=file.name)
        making = self._making.get(file)
        if making is None:
            if file.exists() and file.stat().st_mtime >= session.stat().st_mtime:
                return file
            making = self._making[file] = asyncio.create_task(self._make(kind, session, file))
            self._asked_s[file] = time.monotonic()
        elif making.done():
            del self._making[file]  # reported once; asking again tries again
            if not making.result():
                return file  # whichever is the newer by a clock that was corrected meanwhile
        return making

    def waited_s(self, kind: str, identity: str) -> float:
        """Seconds since a product of a session was asked for first."""
        return time.monotonic() - self._asked_s[default_path(self.path(identity)).with_suffix(PRODUCTS[kind])]

    async def _make(self, kind: str, session: Path, file: Path) -> str:
        async with self._one_job:
            command = ["report", str(session), *(["-o", str(file)] if kind == "image" else [])]
            if kind == "timelapse":
                camera, every = await asyncio.to_thread(_film_frames, session)
                chosen = ["--to", "video", "--stream", camera, "--every", str(every)]
                command = ["export", str(session), *chosen, "-o", str(file.parent)]
            code, output, errors = await _fieldkit(*command)
        if code == 0 and kind == "timelapse":
            Path(json.loads(output)["files"][0]).replace(file)
        return "" if code == 0 else command_error(errors, PageError("failed")).words


def _film_frames(path: Path) -> tuple[str, int]:
    """The first camera of a session, and every how many of its frames a film has."""
    with open_session(path) as session:
        camera = find_camera(session.streams.values())
        if camera is None:
            raise PageError("no_frame")
        return camera.name, max(1, session.count(camera.name) // FILM_FRAMES)


async def _fieldkit(*arguments: str) -> tuple[int, str, str]:
    """Exit code and output of a command with ``--json`` that gives way to all other processes."""
    words = ["nice", "-n", "15", sys.executable, "-P", "-m", "fieldkit", *arguments]
    pipe, nothing = asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(
        *words, "--json", "--quiet", "--no-input", stdin=nothing, stdout=pipe, stderr=pipe
    )
    try:
        output, errors = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()  # or a page that ends would leave it and its pipes behind
    return process.returncode or 0, output.decode(errors="replace"), errors.decode(errors="replace")
