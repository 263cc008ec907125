"""From TOML, environment and command line to a checked `Config`.

Who wins: ``--set`` > ``FIELDKIT_TABLE__KEY`` in the environment > the campaign's
``fieldkit.toml`` > the user's own ``config.toml`` > the defaults.
"""

from __future__ import annotations

import functools
import operator
import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import platformdirs
from pydantic import ValidationError

from fieldkit.config.config import Config
from fieldkit.config.defaults import KIND, forget_defaults_of_kind
from fieldkit.config.files import KeyPath, key_lines, regions_in, table_in
from fieldkit.config.references import resolve, with_horizons
from fieldkit.config.toml_schema import Tables
from fieldkit.config.validation import (
    ConfigMistakesError,
    Mistake,
    cross_check,
    explain,
    secrets_in,
    unknown_drivers,
    unknown_keys,
)
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument, Text
from fieldkit.model.text_file import parse_toml, read_text

SET = "setting "
ENVIRONMENT = "FIELDKIT_"


def user_file() -> Path:
    """The user's own configuration, which every campaign's overrides."""
    return platformdirs.user_config_path("fieldkit") / "config.toml"


def load_config(
    path: Path, *, settings: Sequence[str] = (), environment: Mapping[str, str] = os.environ
) -> Config:
    """The checked configuration of a campaign.

    `settings` are ``KEY=VALUE`` of the command line, values written as in TOML (text may go without
    quotes). Raises `ConfigMistakesError` with every mistake, `ConfigError` if a file cannot be read.
    """
    return _without_mistakes(
        *read_config(path, settings=settings, environment=environment), fix=f"edit {path}"
    )


def read_config(
    path: Path,
    *,
    text: str | None = None,
    settings: Sequence[str] = (),
    environment: Mapping[str, str] = os.environ,
) -> tuple[Config | None, list[tuple[str, Mistake]]]:
    """The configuration and its mistakes, each with its place, for callers that report instead of raising.

    The configuration is None if a single key is wrong; with mistakes between keys it is still returned.
    `text` is the file's where it is known already.
    """
    document = _Document()
    for file in (user_file(), path):
        if file == path or file.is_file():
            document.add(text if file == path and text is not None else read_text(file), file)
    for origin, keys, value in (*_from_environment(environment), *_from_settings(settings)):
        document.put(origin, keys, value)
    return document.check(path, of_campaign=True)


def config_from_text(text: str, path: Path, *, settings: Sequence[str] = ()) -> Config:
    """The configuration a session keeps of itself, with ``KEY=VALUE`` of the command line over it.

    Environment and user configuration are ignored, so that a session keeps its meaning; its drivers need not
    be installed here. Keys that a later version has added are ignored. Raises as `load_config`.
    """
    document = _Document()
    document.add(text, path)
    document.drop_unknown_keys()
    document.set(settings)
    return _without_mistakes(*document.check(path), fix=f"correct the settings for {path.name}")


def ignored_keys(text: str, path: Path) -> list[str]:
    """The keys that `config_from_text` ignores; raises `ConfigError` if the text is not TOML."""
    document = _Document()
    document.add(text, path)
    return [".".join(map(str, key)) for key in document.drop_unknown_keys()]


def changed_config(config: Config, settings: Sequence[str]) -> Config:
    """A configuration with ``KEY=VALUE`` over it, as a sweep needs many; raises as `load_config`."""
    document = _Document(config.tables.model_dump(by_alias=True, exclude_none=True))
    document.set(settings)
    return _without_mistakes(*document.check(config.path), fix=f"correct the settings for {config.path.name}")


def mistakes_in(text: str, path: Path) -> list[tuple[str, Mistake]]:
    """The mistakes of a ``fieldkit.toml`` with this text, each with its place.

    Raises `ConfigError` if the text is not TOML.
    """
    document = _Document()
    document.add(text, path)
    return document.check(path, of_campaign=True)[1]


def _without_mistakes(config: Config | None, mistakes: list[tuple[str, Mistake]], fix: str) -> Config:
    if config is None or mistakes:
        raise ConfigMistakesError(mistakes, fix=_correct([where for where, _ in mistakes]) or fix)
    return config


def _correct(origins: Sequence[str]) -> Text | None:
    """The fix if all mistakes come from the command line or the environment."""
    if all(origin.startswith(SET) for origin in origins):
        return "correct the " + Argument("settings")
    if all(origin.startswith(ENVIRONMENT) for origin in origins):
        return f"correct {', '.join(origins)} in the environment"
    return None


@dataclass
class _Document:
    """The merged plain document, and where each of its keys came from."""

    values: dict[str, Any] = field(default_factory=dict)
    origins: dict[KeyPath, str] = field(default_factory=dict)

    def add(self, text: str, file: Path) -> None:
        _merge(self.values, parse_toml(text, file))
        self.origins |= {path: f"{file.name}:{line}" for path, line in key_lines(text).items()}

    def put(self, origin: str, keys: Sequence[str], value: Any) -> None:
        table = self.values
        for key in keys[:-1]:
            table = table.setdefault(key, {})
            if not isinstance(table, dict):
                raise ConfigError(
                    f"{key} is not a table", place=_key_of(origin), fix="write it as table.key=value"
                )
        table[keys[-1]] = value
        self.origins[tuple(keys)] = origin

    def set(self, settings: Sequence[str]) -> None:
        """Put ``KEY=VALUE`` over a document that states every value."""
        values = list(_from_settings(settings))
        if any(keys == KIND for _, keys, _ in values):
            forget_defaults_of_kind(self.values)
        for setting in values:
            self.put(*setting)

    def take_secrets(self) -> list[Mistake]:
        """Remove what looks like a secret, so that no message quotes it; the mistakes."""
        secrets = list(secrets_in(self.values))
        for mistake in reversed(secrets):
            self._drop(mistake.path)
            for length in range(1, len(mistake.path) + 1):
                if (place := mistake.path[:length]) in self.origins:
                    self.origins[place] = _key_of(self.origins[place])
        return secrets

    def drop_unknown_keys(self) -> list[KeyPath]:
        """Remove the keys that no table has; returns them."""
        try:
            Tables.model_validate(self.values)
        except ValidationError as error:
            unknown = unknown_keys(error, self.values)
            for path in unknown:
                self._drop(path)
            return unknown
        return []

    def _drop(self, path: KeyPath) -> None:
        *tables, key = path
        del functools.reduce(operator.getitem, tables, self.values)[key]  # type: ignore[arg-type]

    def check(
        self, path: Path, *, of_campaign: bool = False
    ) -> tuple[Config | None, list[tuple[str, Mistake]]]:
        """The configuration, if there can be one, and every mistake with its place, in file order.

        Of a campaign every driver must be installed here.
        """
        secrets = self.take_secrets()
        values, mistakes = resolve(self.values, path)
        mistakes += [*secrets, *with_horizons(values, path), *_on_ground(values, path)]
        tables, reported = None, {mistake.path for mistake in mistakes}
        # corners on the ground that cannot be seen are one mistake, not missing pixels as well
        reported |= {(*path[:2], "points_px") for path in reported if path[2:] == ("points_m",)}
        try:
            tables = Tables.model_validate(values)
        except ValidationError as error:
            mistakes += [mistake for mistake in explain(error, values) if mistake.path not in reported]
        reported = {mistake.path for mistake in mistakes}
        between = [*cross_check(values), *(unknown_drivers(values) if of_campaign else ())]
        mistakes += [mistake for mistake in between if mistake.path not in reported]
        located = [(self._origin(mistake.path) or path.name, mistake) for mistake in mistakes]
        return (Config(path, tables) if tables else None), sorted(located, key=_by_line)

    def _origin(self, path: KeyPath) -> str | None:
        """Line and file of the key, or of the closest table around it."""
        while path and path not in self.origins:
            path = path[:-1]
        return self.origins.get(path)


def _on_ground(values: dict[str, Any], path: Path) -> list[Mistake]:
    """Complete the pose and the regions on its ground; what that needs is imported only if they are there."""
    has_pose = "pose" in table_in(values, "camera")
    if not has_pose and not any(region.get("points_m") for _, region in regions_in(values)):
        return []
    from fieldkit.config.ground import with_regions
    from fieldkit.config.pose import with_pose

    # a wrong pose is reported once, not with every region again
    return with_pose(values, path) or with_regions(values, path)


def _key_of(origin: str) -> str:
    """``--set KEY`` without its value."""
    return origin.partition("=")[0]


def _by_line(located: tuple[str, Mistake]) -> tuple[str, int]:
    origin, _, line = located[0].rpartition(":")
    return (origin, int(line)) if line.isdigit() else (located[0], 0)


def _merge(below: dict[str, Any], above: Mapping[str, Any]) -> None:
    """Merge `above` into `below`: tables key by key, any other value as a whole."""
    for key, value in above.items():
        if isinstance(value, dict) and isinstance(below.get(key), dict):
            _merge(below[key], value)
        else:
            below[key] = value


def _from_environment(environment: Mapping[str, str]) -> Iterator[tuple[str, list[str], Any]]:
    """``FIELDKIT_SITE__ELEVATION_M=9`` is ``site.elevation_m = 9``; names without ``__`` are not settings."""
    for name, text in sorted(environment.items()):
        keys = name.removeprefix(ENVIRONMENT).lower().split("__")
        if name.startswith(ENVIRONMENT) and len(keys) > 1:
            yield name, keys, _value(text)


def _from_settings(settings: Sequence[str]) -> Iterator[tuple[str, list[str], Any]]:
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise ConfigError("no value", place=f"{SET}{setting}", fix="write it as surface.albedo=0.25")
        yield f"{SET}{setting}", key.strip().split("."), _value(text)


def _value(text: str) -> Any:
    """A value as TOML writes it, or the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()
