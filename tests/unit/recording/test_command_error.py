"""What the page answers where a command that it ran has failed: the command's own error."""

import asyncio

import pytest

from fieldkit.cli.next_steps import in_commands
from fieldkit.config import FILE_NAME, load_config
from fieldkit.model.errors import ConfigError, RefusedError, SessionError
from fieldkit.page.conductor import Conductor
from fieldkit.page.hub import Hub
from fieldkit.page.sessions import PastSessions, identifier
from fieldkit.phrases import text_document
from fieldkit.recording.background import RecordOptions, command_error
from fieldkit.recording.record import prepare
from fieldkit.results.session import open_session
from tests.harness.command_line import succeed


@pytest.fixture
def config(tmp_path):
    succeed("init", tmp_path / "field")
    return load_config(tmp_path / "field" / FILE_NAME)


def test_a_recording_that_cannot_start_answers_with_its_error(config):
    with pytest.raises(ConfigError) as expected, prepare(config, RecordOptions()):
        pass
    conductor = Conductor(config, Hub(config), preview=False)
    with pytest.raises(RefusedError) as found:
        conductor.start(RecordOptions())
    conductor.close()
    assert (found.value.message, found.value.fix) == (expected.value.message, in_commands(expected.value.fix))
    assert text_document(found.value.words) == text_document(expected.value.words)


def test_a_session_that_cannot_be_estimated_answers_with_its_error(config):
    path = config.recordings / "a.h5"
    path.write_bytes(b"not a session")
    with pytest.raises(SessionError) as expected:
        open_session(path)
    with pytest.raises(RefusedError) as found:
        asyncio.run(PastSessions(config).estimate(identifier(path)))
    assert text_document(found.value.words) == text_document(expected.value.words)


@pytest.mark.parametrize("printed", ["", "Killed\n", "[]", '{"schema": 1}', "null"])
def test_a_command_that_left_no_error_is_explained_in_words(printed):
    assert command_error(printed, RefusedError("ended")).message == "ended"
