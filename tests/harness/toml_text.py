"""Lines of a configuration or a pose file."""

import json


def toml_keys(**values: object) -> str:
    """A line for each key that has a value."""
    lines = (f"{key} = {json.dumps(value)}\n" for key, value in values.items() if value is not None)
    return "".join(lines)
