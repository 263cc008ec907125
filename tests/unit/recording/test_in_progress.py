"""A recording that another process makes, from Python: its status, a mark, its end."""

import fieldkit
from tests.unit.cli.test_light_commands import begun


def test_a_recording_of_another_process_is_shown_marked_and_stopped(tmp_path):
    folder = tmp_path / "field"
    process, session = begun(folder)
    try:
        assert fieldkit.status(folder)["session"] == str(session)
        assert fieldkit.mark("a gust", fieldkit.open_campaign(folder), kind="wind").session == session
        assert fieldkit.stop(folder) == session
        assert process.wait(30) == 0
    finally:
        process.kill()
    with fieldkit.open_session(session) as sealed:
        marks = [event for event in sealed.events() if event.kind.name == "MARK"]
    assert [(mark.text, mark.data["label"]) for mark in marks] == [("a gust", "wind")]
