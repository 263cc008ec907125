"""The catalogue of the page: whole in every language, and with a text for whatever can happen."""

import copy
import json
import os
import pickle
import re
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

import pytest

from fieldkit.config.validation import ConfigMistakesError, Mistake
from fieldkit.model.alarm import Condition
from fieldkit.model.errors import ConfigError, DeviceAccessError, RefusedError, SessionError, StorageError
from fieldkit.model.installation import PACKAGE
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import EventKind, Quality
from fieldkit.model.site import RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.page.phrases import PageError, preferred_language
from fieldkit.page.requests import TYPED
from fieldkit.phrases import LANGUAGES, Words, in_language, phrases, text_document, text_of
from fieldkit.recording.opening import together
from fieldkit.sessions.check import REPORTED_ELSEWHERE

PAGE = resources.files("fieldkit.page")
NEVER_LIVE = {EventKind.CLOCK_CHECK, EventKind.IMPORTED}


def source(folder: Traversable, *suffixes: str) -> str:
    return "\n".join(file.read_text("utf-8") for file in folder.iterdir() if file.name.endswith(suffixes))


# rooms at the top of the tree are links in the package
FILES = (Path(folder, name) for folder, _, names in os.walk(PACKAGE, followlinks=True) for name in names)
PRODUCT = "\n".join(file.read_text("utf-8") for file in FILES if file.suffix == ".py")
CODE, SERVER = source(PAGE / "browser", ".js", ".html"), source(PAGE, ".py")


def slots(texts: dict[str, str]) -> dict[str, set[str]]:
    return {key: set(re.findall(r"\{(\w+)[:}]", text)) for key, text in texts.items()}


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_has_every_text_with_its_slots(language):
    assert slots(phrases(language)) == slots(phrases())
    assert "<" not in "".join(phrases(language).values())  # which might end the script that has them


def test_every_text_that_the_code_names_is_there():
    named = re.findall(r'(?:phrase|unanswered)\("([\w.-]+)"', CODE)
    named += re.findall(r"\{\{(\w+\.[\w.-]+)\}\}", CODE) + re.findall(r'"(done\.\w+)"', SERVER)
    named += [f"refused.{key}" for key in (*re.findall(r'PageError\("(\w+)"', SERVER), *TYPED, "reload")]
    reasons = re.findall(r'(?:leave\((?:\w+(?:\[0\])?, )?|LeftError\()"(\w+)"', SERVER)
    named += [f"closed.{reason}" for reason in reasons]
    named += re.findall(r'Words\(\s*"([\w.]+)"', PRODUCT)
    assert len(named) > 350
    assert len(reasons) >= 4
    assert set(named) <= phrases().keys()
    sent = {key for key in phrases() if re.match(r"(error|fix|text)\.[a-z]", key)}
    assert {key for key in sent if f'"{key}"' not in PRODUCT} == set()


@pytest.mark.parametrize(
    ("group", "names"),
    [
        ("event", {kind.name.lower() for kind in EventKind if kind not in NEVER_LIVE}),
        ("alarm", {condition.value for condition in Condition}),
        ("state", {state.name.lower() for state in SlopeState}),
        ("issue.flagged", {str(flag.name).lower() for flag in Quality if not flag & REPORTED_ELSEWHERE}),
        ("kind", {kind.name.lower() for kind in RegionKind}),
        ("next", {action.name.lower() for action in Action}),
    ],
)
def test_whatever_can_happen_has_a_text(group, names):
    keys = (key.removeprefix(f"{group}.") for key in phrases() if key.startswith(f"{group}."))
    assert names <= {key.split(".")[0] for key in keys}


def test_a_finding_keeps_key_and_values_when_it_is_copied_or_sent():
    finding = Words("issue.missing", count=3, last=9)
    for copied in (finding, copy.deepcopy(finding), pickle.loads(pickle.dumps(finding))):
        assert text_document(copied) == {
            "text": "3 samples missing from the file (numbers 0 to 9)",
            "key": "issue.missing",
            "data": {"count": 3, "last": 9},
        }
    assert text_document("plain") == {"text": "plain"}


@pytest.mark.parametrize(
    ("accepted", "chosen", "language"),
    [
        ("ja,en-US;q=0.9,en;q=0.8", "", "ja"),
        ("de-CH, ja;q=0.5", "", "ja"),
        ("ja", "en", "en"),
        ("de", "../../etc", "en"),
        ("", "", "en"),
    ],
)
def test_the_language_is_the_one_chosen_or_preferred(accepted, chosen, language):
    assert preferred_language(accepted, chosen) == language


def test_an_error_of_the_page_is_its_text_with_its_values():
    error = PageError("silent", seconds="5")
    assert text_document(error.words) == text_document(Words("refused.silent", seconds="5"))


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_text_has_a_command_or_a_key(language):
    texts = [text for key, text in phrases(language).items() if not key.startswith("device.")]
    assert not re.findall(r"--\w|\bfieldkit\b|\.toml|\w+\.\w+\(", "\n".join(texts))


RECOVER, DOCTOR = Words("next.recover"), Words("next.doctor")
DURATION = ConfigError(Words("error.duration"), place="'soon'", fix=Words("fix.duration"))
DAMAGED = SessionError("damaged", place=Path("/a/b.h5"), fix=Action.RECOVER("/a/b.h5"))
CROSSED = Mistake(("region", 4, "points_px"), Words("issue.region.crosses"))


@pytest.mark.parametrize(
    ("error", "shown"),
    [
        (RefusedError("--name: 'a/b' has a slash", fix="--name a-b"), "'a/b' has a slash"),
        (ConfigError("region[4].name: taken", place="b15", fix="rename it"), "b15: taken; rename it"),
        (RefusedError("nothing is recorded", fix=Action.RECORD()), "nothing is recorded; start a recording"),
        (ConfigError("wrong", fix="edit fieldkit.toml"), "wrong"),
        (ConfigError("wrong", place=Argument("to")), "wrong"),
        (DAMAGED, f"b.h5: damaged; {RECOVER}"),
        (DURATION, "'soon': is not a valid duration; use 3h, 90m or 45s"),
        (ConfigMistakesError([("b15", CROSSED)]), f"b15: {CROSSED.message}"),
        (together([DURATION, DeviceAccessError("used")]), f"'soon': is not a valid duration; used; {DOCTOR}"),
    ],
)
def test_errors_of_other_rooms_come_without_commands_and_keys(error, shown):
    assert error.words == shown


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_error_is_in_a_language_with_place_and_next_step(language):
    texts = phrases(language)
    assert in_language(DURATION.words, language) == texts["text.next"].format(
        text=texts["text.of"].format(what="'soon'", text=texts["error.duration"]), step=texts["fix.duration"]
    )
    original = in_language(StorageError("No space left on device").words, language)
    assert original == texts["error.StorageError"].format(text="No space left on device")


def test_a_text_within_a_text_is_the_same_after_a_message_of_json():
    for text in (DURATION.words, together([DURATION, DURATION]).words):
        assert text_document(text_of(json.loads(json.dumps(text_document(text))))) == text_document(text)
    assert text_of({"text": "as it was", "key": "of.a.later.version", "data": {}}) == "as it was"
