"""The actions and arguments that the fix of an error or a finding names."""

from fieldkit.model.errors import FieldkitError
from fieldkit.model.finding import Finding
from fieldkit.model.next_step import Phrase, Sentence


def steps(error: FieldkitError | Finding) -> list[Phrase]:
    """The actions and arguments of a fix, without the words between them."""
    parts = error.fix.parts if isinstance(error.fix, Sentence) else (error.fix,)
    return [part for part in parts if isinstance(part, Phrase)]
