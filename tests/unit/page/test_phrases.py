"""The catalogue of the page: whole in every language, and with a text for whatever can happen."""

import copy
import inspect
import pickle
import re
from importlib import resources
from importlib.resources.abc import Traversable

import pytest

from fieldkit.estimation import region_check
from fieldkit.model.alarm import Condition
from fieldkit.model.errors import ConfigError, RefusedError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import EventKind, Quality
from fieldkit.model.site import RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.page.outgoing import without_commands
from fieldkit.page.phrases import PageError, preferred_language
from fieldkit.page.requests import TYPED
from fieldkit.phrases import LANGUAGES, Words, phrases, text_document
from fieldkit.results import check
from fieldkit.sessions import check as session_check
from fieldkit.sessions import radiation_check
from fieldkit.sessions.check import REPORTED_ELSEWHERE

PAGE = resources.files("fieldkit.page")
NEVER_LIVE = {EventKind.CLOCK_CHECK, EventKind.IMPORTED}


def source(folder: Traversable, *suffixes: str) -> str:
    return "\n".join(file.read_text("utf-8") for file in folder.iterdir() if file.name.endswith(suffixes))


CHECKS = "\n".join(
    inspect.getsource(module) for module in (session_check, radiation_check, check, region_check)
)
CODE, SERVER = source(PAGE / "browser", ".js", ".html"), source(PAGE, ".py")


def slots(texts: dict[str, str]) -> dict[str, set[str]]:
    return {key: set(re.findall(r"\{(\w+)\}", text)) for key, text in texts.items()}


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
    named += re.findall(r'Words\(\s*"([\w.]+)"', CHECKS)
    assert len(named) > 250
    assert len(reasons) >= 4
    assert set(named) <= phrases().keys()


@pytest.mark.parametrize(
    ("group", "names"),
    [
        ("event", {kind.name.lower() for kind in EventKind if kind not in NEVER_LIVE}),
        ("alarm", {condition.value for condition in Condition}),
        ("state", {state.name.lower() for state in SlopeState}),
        ("issue.flagged", {str(flag.name).lower() for flag in Quality if not flag & REPORTED_ELSEWHERE}),
        ("kind", {kind.name.lower() for kind in RegionKind}),
    ],
)
def test_whatever_can_happen_has_a_text(group, names):
    keys = (key.removeprefix(f"{group}.") for key in phrases() if key.startswith(f"{group}."))
    assert names <= {key.split(".")[0] for key in keys}


def test_a_finding_keeps_key_and_values_when_it_is_copied_or_sent():
    finding = Words("issue.missing", count=3, last=9)
    for copied in (finding, copy.deepcopy(finding), pickle.loads(pickle.dumps(finding))):
        assert text_document(copied) == {
            "text": "3 samples are missing from the file (numbers 0 to 9)",
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


def test_an_error_of_the_page_has_its_values():
    error = PageError("silent", seconds="5")
    assert "5 s" in error.message
    assert (error.key, error.values) == ("refused.silent", {"seconds": "5"})


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_text_has_a_command_or_a_key(language):
    texts = [text for key, text in phrases(language).items() if not key.startswith("device.")]
    assert not re.findall(r"--\w|\bfieldkit\b|\.toml|\w+\.\w+\(", "\n".join(texts))


@pytest.mark.parametrize(
    ("error", "shown"),
    [
        (RefusedError("--name: 'a/b' has a slash", fix="--name a-b"), ("'a/b' has a slash", None)),
        (
            ConfigError("region[4].name: taken", place="b15", fix="choose another"),
            ("b15: taken", "choose another"),
        ),
        (RefusedError("nothing is recorded", fix=Action.RECORD()), ("nothing is recorded", None)),
        (ConfigError("wrong", fix="edit fieldkit.toml"), ("wrong", None)),
        (ConfigError("'soon' is no duration", fix="use 3h"), ("'soon' is no duration", "use 3h")),
    ],
)
def test_errors_of_other_rooms_come_without_commands_and_keys(error, shown):
    assert without_commands(error) == shown
