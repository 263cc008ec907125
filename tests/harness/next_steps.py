"""An error is tested by what it carries: its kind, its place, and the actions and arguments of its fix."""

from collections.abc import Callable

from fieldkit.model.errors import FieldkitError
from fieldkit.model.finding import Finding
from fieldkit.model.next_step import Phrase, Sentence


def steps(error: FieldkitError | Finding) -> list[Phrase]:
    """The actions and arguments of a fix, without the words between them."""
    parts = error.fix.parts if isinstance(error.fix, Sentence) else (error.fix,)
    return [part for part in parts if isinstance(part, Phrase)]


def at(place: object, *next_steps: Phrase) -> Callable[[FieldkitError], bool]:
    """The check of `pytest.raises`: the error names this place, and its fix these steps, if any are given."""

    def check(error: FieldkitError) -> bool:
        assert str(error.place) == str(place)
        assert not next_steps or steps(error) == list(next_steps)
        return True

    return check
