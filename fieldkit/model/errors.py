"""Errors of fieldkit: what happened, to which thing, and what to do next.

::

    FieldkitError                    exit code 1
     +-- ConfigError                 3   a key, a file or an option is wrong
     +-- DeviceError                 4   an instrument cannot be used
     |    +-- DeviceNotFoundError        not connected, or another one is
     |    +-- DeviceAccessError          present, but refused
     |    +-- DeviceTimeoutError         nothing arrived in time (also TimeoutError)
     |    +-- DeviceLostError        5   was open, has disappeared
     |    +-- DecodeError                bytes that cannot be decoded, kept in `raw`
     +-- SessionError                3   not a session, damaged
     |    +-- FormatError                of another version of the format, left as it is
     |    +-- IntegrityError         7   stored data do not match their checksums
     |         +-- IncompleteError        a part could not be read, the rest was written
     +-- StorageError                6   disk full, read-only, too slow
     +-- NoAnswerError               8   the data do not determine the answer
     |    +-- CalibrationError
     +-- RefusedError                9   another recording runs, or something would be overwritten

Nature is not an error: night, shade or a closed shutter give NaN and a `Quality` flag.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING

from fieldkit.model.next_step import KEYS, Phrase, Text, in_words, next_step
from fieldkit.phrases import Words, phrases

if TYPE_CHECKING:  # every command would wait for it, also --help
    from pathlib import Path


class FieldkitError(Exception):
    """An error with an explanation: `problem` happened at `place`, `fix` is what to do next.

    `place` is a file, a key, a stream, a region or an argument. A fix that names an action or an argument has
    it as data; `str` writes it as Python has it, the command line as a command or an option.

    Examples
    --------
    >>> try:
    ...     fieldkit.open_session("nowhere.h5")
    ... except fieldkit.FieldkitError as error:
    ...     print(error.fix)
    check the path; fieldkit.open_campaign().sessions shows the sessions of a campaign
    """

    exit_code = 1
    causes: Sequence[FieldkitError] = ()
    """The errors that this one reports together."""

    def __init__(
        self, problem: Text, *, place: str | Path | Phrase | None = None, fix: Text | None = None
    ) -> None:
        super().__init__(problem)
        self.problem: Text = problem
        self.place: str | Path | Phrase | None = place
        self.fix: Text | None = fix

    @property
    def explanation(self) -> Text:
        """The problem, and its place: the text of `message` with its arguments as data."""
        if self.place is None:
            return self.problem
        place = self.place if isinstance(self.place, Phrase) else str(self.place)
        return place + ": " + self.problem

    @property
    def message(self) -> str:
        """The problem, with its place, as text."""
        return str(self.explanation)

    @property
    def line(self) -> Text:
        """Explanation and fix, for a message that has one line."""
        return self.explanation + ("; " + self.fix if self.fix else "")

    @cached_property
    def words(self) -> str:
        """What happened where and what to do next, by the catalogue: without options, keys and commands."""
        texts = [cause.statement for cause in self.causes or (self,)]
        text = texts[0] if len(texts) == 1 else Words("text.all", texts=texts)
        step = next_step(self.fix)
        return Words("text.next", text=text, step=step) if step else text

    @property
    def statement(self) -> str:
        """What happened where, by the catalogue; a problem without a key is the value of its class's text."""
        problem = in_words(self.problem)
        if not isinstance(problem, Words):
            keys = (f"error.{kind.__name__}" for kind in type(self).__mro__)
            problem = Words(next(key for key in keys if key in phrases()), text=KEYS.sub("", problem))
        if self.place is None or isinstance(self.place, Phrase):
            return problem
        place = KEYS.sub("", f"{getattr(self.place, 'name', self.place)}: ").removesuffix(": ")
        return Words("text.of", what=place, text=problem) if place else problem

    def __str__(self) -> str:
        """Message and fix, so that a traceback or a notebook also shows what to do next."""
        return f"{self.message}\n  fix: {self.fix}" if self.fix else self.message


def message_of(error: BaseException) -> str:
    """The message without the fix: for a message or an event that quotes another error.

    Of the mistakes that pydantic finds in a document, it is the first, behind its key.
    """
    if isinstance(error, ValueError) and hasattr(error, "errors"):
        first = error.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return error.message if isinstance(error, FieldkitError) else str(error)


class ConfigError(FieldkitError, ValueError):
    """A configuration key, an input file or an option is wrong."""

    exit_code = 3


class DeviceError(FieldkitError):
    """An instrument cannot be used."""

    exit_code = 4


class DeviceNotFoundError(DeviceError):
    """The instrument asked for is not connected, or another one is in its place."""


class DeviceAccessError(DeviceError):
    """The instrument is present but cannot be opened."""


class DeviceTimeoutError(DeviceError, TimeoutError):
    """Nothing arrived in time."""


class DeviceLostError(DeviceError):
    """The instrument was open and has disappeared."""

    exit_code = 5


class DecodeError(DeviceError):
    """Bytes that cannot be decoded, kept in `raw`."""

    def __init__(
        self, problem: Text, raw: bytes = b"", *, place: str | Path | None = None, fix: Text | None = None
    ) -> None:
        super().__init__(problem, place=place, fix=fix)
        self.raw = raw


class SessionError(FieldkitError):
    """A file is not a session, or cannot be read."""

    exit_code = 3


class FormatError(SessionError):
    """A session or its journal is of another version of the format; it is left as it is."""


class IntegrityError(SessionError):
    """Stored data do not match their checksums, or samples had to be dropped."""

    exit_code = 7


class IncompleteError(IntegrityError):
    """A part of a session could not be read; `files` hold the rest."""

    def __init__(self, problem: Text, files: Sequence[Path] = (), *, fix: Text | None = None) -> None:
        super().__init__(problem, fix=fix)
        self.files: tuple[Path, ...] = tuple(files)


class StorageError(FieldkitError):
    """The disk is full, read-only or too slow."""

    exit_code = 6


class NoAnswerError(FieldkitError):
    """The data do not determine the answer."""

    exit_code = 8


class CalibrationError(NoAnswerError):
    """The data do not determine the calibration; `fix` names data that would."""


class RefusedError(FieldkitError):
    """Another recording is running, or something would be overwritten."""

    exit_code = 9


@contextmanager
def os_errors_as(
    kind: type[FieldkitError], problem: str, *, place: str | Path | None = None, fix: Text | None = None
) -> Iterator[None]:
    """Raise an `OSError` of the block as an error of this kind: the problem, then what the system reports."""
    try:
        yield
    except OSError as error:
        raise kind(f"{problem}: {error.strerror or error}", place=place, fix=fix) from error
