"""Conditions on the rows of a table, such as ``tilt > 10 and state == "ok"``: parsed, never evaluated.

The grammar is a part of Python's, read by Python's own parser: columns, numbers and texts, compared by
``< <= > >= == !=`` and joined by ``and``, ``or``, ``not`` and brackets.
"""

from __future__ import annotations

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument

Row = Mapping[str, Any]
Columns = Mapping[str, type]
LONGEST = 1000
"""Characters of a condition: brackets in more of them could nest deeper than the parser goes."""
_UNITS = ("", "_deg", "_s")
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


def row_filter(condition: str, columns: Columns) -> Callable[[Row], bool]:
    """A function that is true of the rows that meet a condition.

    `columns` are the columns by name with their kinds, `float` or `str`; a condition may omit the unit in a
    name. Where a row has None, a comparison is false. Raises `ConfigError` for anything but such a condition.
    """
    try:
        if len(condition) > LONGEST:
            raise ValueError(f"longer than {LONGEST} characters")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's parser warns of what is odd in Python
            tree = ast.parse(condition.strip(), mode="eval")
        return _test(tree.body, columns)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        problem = "not a condition" if isinstance(error, SyntaxError) else str(error)
        fix = f'write it as tilt > 10 and state == "ok"; columns: {", ".join(columns)}'
        raise ConfigError(problem, place=Argument("where", condition[:LONGEST]), fix=fix) from None


def _test(node: ast.expr, columns: Columns) -> Callable[[Row], bool]:
    match node:
        case ast.BoolOp(op=joint, values=parts):
            tests, join = [_test(part, columns) for part in parts], all if isinstance(joint, ast.And) else any
            return lambda row: join(test(row) for test in tests)
        case ast.UnaryOp(op=ast.Not(), operand=part):
            test = _test(part, columns)
            return lambda row: not test(row)
        case ast.Compare(left=first, ops=signs, comparators=others):
            sides = [_side(side, columns) for side in (first, *others)]
            if len({kind for kind, _ in sides}) > 1:
                raise ValueError(f"{ast.unparse(node)} compares a number with a text")
            if unknown := [sign for sign in signs if type(sign) not in _COMPARISONS]:
                raise ValueError(f"{type(unknown[0]).__name__} is not a comparison: < <= > >= == !=")
            pairs = list(zip(signs, pairwise(value for _, value in sides), strict=True))
            return lambda row: all(_holds(sign, low(row), high(row)) for sign, (low, high) in pairs)
    raise ValueError(f"{ast.unparse(node)} is not a comparison")


def _holds(sign: ast.cmpop, low: Any, high: Any) -> bool:
    return low is not None and high is not None and _COMPARISONS[type(sign)](low, high)


def _side(node: ast.expr, columns: Columns) -> tuple[type, Callable[[Row], Any]]:
    """The kind of one side of a comparison, and its value in a row."""
    match node:
        case ast.Name(id=name):
            column = next((name + unit for unit in _UNITS if name + unit in columns), None)
            if column is None:
                raise ValueError(f"there is no column {name}")
            return columns[column], operator.itemgetter(column)
        case ast.Constant(value=int() | float() | str() as value) if not isinstance(value, bool):
            return str if isinstance(value, str) else float, lambda _: value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return float, lambda _: -value
    raise ValueError(f"{ast.unparse(node)} is neither a column nor a number or a text")
