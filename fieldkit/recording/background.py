"""A recording in a process and session of its own, which goes on however those end who began it."""

from __future__ import annotations

import datetime
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import IO, ClassVar

from pydantic import BaseModel, ConfigDict

from fieldkit.config import Config
from fieldkit.model.errors import RefusedError
from fieldkit.phrases import Words, text_of
from fieldkit.recording.running import LOOK_EVERY_S, session_in_progress, waiting_recorder
from fieldkit.sessions.lock import journal_path, owner

PRINTED_MAX = 1_000_000
STARTS_WITHIN_S = 60.0
"""And each instrument's `connect_timeout_s`, after which one that hangs is given up."""


class RecordOptions(BaseModel):
    """How a campaign is recorded, from command line, page or Python to the process that does it.

    `at` and `until` are times of day at the site, at which the recording is to begin and to end; `until`
    replaces `duration_s`. `include_last_s` is how far back the samples of a preview that ends now become the
    recording's first. `split` replaces that of ``[record]``. With `on_trigger` the recording waits for a
    trigger. `settings` are ``KEY=VALUE`` over ``fieldkit.toml``.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid")

    name: str = ""
    duration_s: float | None = None
    at: datetime.time | None = None
    until: datetime.time | None = None
    include_last_s: float | None = None
    allow_missing: bool = False
    split: str = ""
    on_trigger: bool = False
    settings: tuple[str, ...] = ()


def keep_messages(session: Path) -> None:
    """Have what this process prints on stderr from now on in ``NAME.log`` beside a session.

    What a `BackgroundRecording` printed before comes first; of an earlier session's log nothing is repeated.
    """
    with suppress(OSError), session.with_suffix(".log").open("ab") as file:
        sys.stderr.flush()
        with suppress(OSError):  # that log cannot be read
            file.write(os.pread(sys.stderr.fileno(), PRINTED_MAX, 0))
        file.flush()
        os.dup2(file.fileno(), sys.stderr.fileno())


class BackgroundRecording:
    """A ``fieldkit record`` of a campaign with `options`, begun at once.

    Its messages go to a file without a name, which outlives who began it: a pipe would end with them; once it
    records, to one beside its session.
    """

    def __init__(self, campaign: Path, options: RecordOptions) -> None:
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - the process's, as long as it runs
        words = [
            *(sys.executable, "-P", "-m", "fieldkit", "record"),
            *("-C", str(campaign), "--json", "--no-input", "--options", options.model_dump_json()),
        ]
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._errors,
            start_new_session=True,
        )
        self.pid: int = self._process.pid

    @property
    def exit_code(self) -> int | None:
        """The process's exit code, None while it runs."""
        return self._process.poll()

    def await_start(self, config: Config) -> Path | None:
        """The session once it is recorded; None once its recorder waits for its time.

        Raises `RefusedError` with what the recorder said, or if it takes more than `STARTS_WITHIN_S`.
        """
        recordings = config.recordings
        limit_s = STARTS_WITHIN_S + sum(device.connect_timeout_s for device in config.devices)
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            if self.exit_code is not None:
                ended = RefusedError(Words("error.ended_at_once"), fix=Words("fix.terminal"))
                raise command_error(self._error_text(), ended)
            session = session_in_progress(recordings)
            if session is not None and owner(journal_path(session)) == self.pid:
                return session
            if waiting_recorder(recordings) == self.pid:
                return None
            time.sleep(LOOK_EVERY_S)
        problem = Words("error.not_begun", seconds=f"{limit_s:.0f}")
        raise RefusedError(problem, fix=Words("fix.instruments"))

    def warnings(self) -> list[str]:
        """Its warnings so far, such as of a calibration that is too old."""
        return [line for line in self._error_text().splitlines() if line.startswith("warning: ")]

    def forget(self) -> None:
        """Let it go on alone."""
        self._errors.close()

    def _error_text(self) -> str:
        self._errors.seek(0)
        return self._errors.read().decode(errors="replace")


def command_error(printed: str, otherwise: RefusedError) -> RefusedError:
    """The error that a command with ``--json`` left on stderr as its last line; `otherwise` without one."""
    try:
        document = json.loads(printed.splitlines()[-1])
        error = RefusedError(document["error"], fix=document["fix"])
        error.words = text_of(document["words"])
        return error
    except (ValueError, LookupError, TypeError):  # killed, or an option of another version
        return otherwise
