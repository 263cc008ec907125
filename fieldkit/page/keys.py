"""Who may see and who may control: links that work once, and the sessions of browsers they open.

A link's key has 128 random bits and is exchanged for a session's, which the browser keeps in a cookie. Only
hashes are stored, in a file that no other user can read, so that browsers stay known when the page is
restarted and ``fieldkit page --link`` can add a link while it runs.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass
from hmac import compare_digest
from pathlib import Path

from fieldkit.disk import one_at_a_time, replacing
from fieldkit.model.errors import StorageError, os_errors_as
from fieldkit.page.viewer import Role
from fieldkit.sessions.json_forms import build

FILE = ".page-keys.json"
"""In ``recordings/``, beside the locks; the folder is not kept under version control."""
KEY_BYTES = 16
LINK_LASTS_S = SESSION_LASTS_S = 24 * 3600.0
PROGRAM_LASTS_S = 366 * SESSION_LASTS_S
MOST_KEPT = 200


@dataclass(frozen=True, slots=True)
class Grant:
    """Permission of a link's or a session's key, and its end (seconds since 1970); `hash` is its SHA-256."""

    hash: str
    role: str
    ends_at: float
    is_link: bool = False


class Keys:
    """Keys of a campaign's page, in its folder of recordings; raises `StorageError` if it cannot write."""

    def __init__(self, folder: Path) -> None:
        with _errors_of(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.path: Path = folder / FILE

    def new_link(self, role: Role) -> str:
        """A key that `exchange` takes once, within a day."""
        with self._changing() as grants:
            return _add_key(grants, role, LINK_LASTS_S, is_link=True)

    def new_program(self) -> str:
        """A key with which a program, such as Prometheus, may look for a year."""
        with self._changing() as grants:
            return _add_key(grants, "view", PROGRAM_LASTS_S)

    def exchange(self, key: str) -> tuple[str, Role] | None:
        """The key of a new session for that of a link, which is void from now on; None for any other."""
        with self._changing() as grants:
            link = _find(grants, key, is_link=True)
            if link is None:
                return None
            grants.remove(link)
            return _add_key(grants, link.role, SESSION_LASTS_S), _role(link)

    def session(self, key: str) -> tuple[Role, float] | None:
        """Role of a session's key and when it ends; None for any other key."""
        session = _find(self._read(), key)
        return None if session is None else (_role(session), session.ends_at)

    def is_link(self, key: str) -> bool:
        """Whether `exchange` would take this key."""
        return _find(self._read(), key, is_link=True) is not None

    def _read(self) -> list[Grant]:
        try:
            grants = [build(Grant, plain) for plain in json.loads(self.path.read_text(encoding="utf-8"))]
        except (OSError, ValueError, TypeError):  # no file yet, or a damaged one: everybody needs a new link
            return []
        return [grant for grant in grants if grant.ends_at > time.time()]

    @contextmanager
    def _changing(self) -> Iterator[list[Grant]]:
        with _errors_of(self.path.parent), one_at_a_time(self.path.parent):
            before = self._read()
            grants = before.copy()
            yield grants
            if grants != before:
                grants.sort(key=lambda grant: grant.ends_at)  # browsers do not crowd out a program
                links = [grant for grant in grants if grant.is_link]
                sessions = [grant for grant in grants if not grant.is_link]
                self._write([*links[-MOST_KEPT:], *sessions[-MOST_KEPT:]])

    def _write(self, grants: Sequence[Grant]) -> None:
        with replacing(self.path, synced=False) as draft:
            descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with open(descriptor, "w", encoding="utf-8") as file:
                json.dump(list(map(asdict, grants)), file)


def _errors_of(folder: Path) -> AbstractContextManager[None]:
    fix = f"have a disk with room at {folder}, which this user may write"
    return os_errors_as(StorageError, "cannot keep the page's keys", place=folder / FILE, fix=fix)


def _role(grant: Grant) -> Role:
    return "control" if grant.role == "control" else "view"


def _hash(key: str) -> str:
    return hashlib.sha256(key.encode(errors="replace")).hexdigest()


def _add_key(grants: list[Grant], role: str, lasts_s: float, *, is_link: bool = False) -> str:
    key = secrets.token_urlsafe(KEY_BYTES)
    grants.append(Grant(_hash(key), role, time.time() + lasts_s, is_link))
    return key


def _find(grants: Sequence[Grant], key: str, *, is_link: bool = False) -> Grant | None:
    """The grant of a key; every one is compared, in a time that does not depend on the key."""
    digest, match = _hash(key), None
    for grant in grants:
        if compare_digest(grant.hash, digest) and grant.is_link is is_link:
            match = grant
    return match
