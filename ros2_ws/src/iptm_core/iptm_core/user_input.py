"""User input (files, names, numbers): read strictly, refused in one form.

No mistake hangs or floods the process. Files of the suite (parameter sets, scenarios, studies) are read
through `StrictMapping`, so that all refusals look alike: where, which key, the value, and the allowed ones.
"""

from __future__ import annotations

import argparse
import difflib
import functools
import inspect
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast

from iptm_core.errors import IptmError, ParameterError, ScenarioError

_MANY_NAMES = 30
_LEAST_BEGINNING = 3
_FEW_NAMES = 12
_MAX_SHOWN = 80


def shown(value: object) -> str:
    """Return a value as an error message shows it: its repr in one line, cut to a readable length."""
    try:
        text = repr(str(value)) if isinstance(value, Enum) else repr(value)
    except ValueError:  # an int with more digits than Python prints
        text = f"<{type(value).__name__} too long to print>"
    text = " ".join(line.strip() for line in text.splitlines())
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."


def suggestion(name: object, known: Iterable[str]) -> str:
    """Return what an unknown name may have meant: ``did you mean 'cycle'? allowed: cycle, slope``.

    Of many known names only the nearest or the first ones are named.
    """
    names = list(known)
    near = nearest(name, names)
    hint = [f"did you mean {near!r}?"] if near else []
    if len(names) <= _FEW_NAMES or not near:
        more = ", ..." if len(names) > _MANY_NAMES else ""
        listed = names[:_FEW_NAMES] if more else names
        hint.append(f"allowed: {', '.join(listed) or 'none'}{more}")
    return " ".join(hint)


def nearest(name: object, known: Iterable[str]) -> str:
    """Return the name that an unknown one is nearest to, empty if it is near to none.

    Case and punctuation do not count, and of a dotted name only the last part; ageing is aging.
    """
    by_lower = {_letters(each): each for each in known}
    lower = _letters(str(name))
    begun = [each for each in by_lower if len(lower) >= _LEAST_BEGINNING and each.startswith(lower)]
    near = begun or difflib.get_close_matches(lower, by_lower, n=1)
    near = near or [each for each in by_lower if len(lower) >= _LEAST_BEGINNING and lower in each]
    return by_lower[near[0]] if near else ""


def _letters(name: str) -> str:
    """Return letters, digits and underscores of a name in lower case, of a dotted key of its last part."""
    lower = name.lower().replace("ageing", "aging")
    last = lower.rpartition(".")[2] if re.fullmatch(r"[a-z_]+\.[a-z_]\w*", lower) else lower
    return re.sub(r"\W+", "", last.replace(" ", "_").replace("-", "_"))


def one_of(known: Iterable[str]) -> Callable[[str], str]:
    """Return the type of an argument of a command line that is one of known names."""
    names = list(known)

    def chosen(text: str) -> str:
        if text not in names:
            raise argparse.ArgumentTypeError(f"unknown {shown(text)}; {suggestion(text, names)}")
        return text

    return chosen


def check_known(
    name: object,
    known: Iterable[str],
    where: str,
    kind: str = "key",
    error: type[IptmError] = ParameterError,
) -> None:
    """Refuse a name that is not among the known ones."""
    names = list(known)
    if name not in names:
        raise error(f"{where}: unknown {kind} {shown(name)}; {suggestion(name, names)}")


_Called = TypeVar("_Called", bound=Callable[..., Any])


def known_keywords(called: _Called) -> _Called:
    """Return a function or class that refuses unknown keywords with a `ScenarioError` and a suggestion."""
    function = called.__init__ if isinstance(called, type) else called  # type: ignore[misc]
    names = [name for name in inspect.signature(called).parameters if name != "self"]

    @functools.wraps(function)
    def checked(*values: Any, **given: Any) -> Any:
        for name in given:
            check_known(name, names, called.__name__, "argument", ScenarioError)
        return function(*values, **given)

    if isinstance(called, type):
        called.__init__ = checked  # type: ignore[misc]
        return called
    return cast("_Called", checked)


class StrictMapping:
    """One mapping of a file, with its place in the file for the messages."""

    def __init__(
        self,
        content: object,
        where: str,
        known: Iterable[str] | None = None,
        *,
        kind: str = "key",
        error: type[IptmError] = ScenarioError,
    ) -> None:
        """Check that it is a mapping of known names; None permits any text."""
        self.where = where
        self._error = error
        if not isinstance(content, Mapping):
            held = "nothing" if content is None else shown(content)
            raise error(f"{where} holds {held}; allowed: a mapping of names to values")
        names = None if known is None else list(known)
        for key in content:
            if not isinstance(key, str):
                raise error(f"{where}: {kind} {shown(key)}; allowed: a text (quote it)")
            if names is not None:
                check_known(key, names, where, kind, error)
        self.content: Mapping[str, Any] = content

    def __contains__(self, key: str) -> bool:
        """Return whether a key is stated."""
        return key in self.content

    def __iter__(self) -> Iterator[str]:
        """Return the keys as written."""
        return iter(self.content)

    def refuse(self, key: str, allowed: str) -> NoReturn:
        """Raise the error for a value that is not as it should be."""
        raise self._error(
            f"{self.where}: {key} is {shown(self.content.get(key))}; allowed: {allowed}"
        )

    def require(self, *keys: str, allowed: str = "") -> None:
        """Refuse the mapping if a key is missing, with the allowed values."""
        for key in keys:
            if key not in self.content:
                hint = f"; allowed: {allowed}" if allowed else ""
                raise self._error(f"{self.where}: {key!r} is missing{hint}")

    def value(self, key: str) -> Any:
        """Return the value of a key that must be stated."""
        self.require(key)
        return self.content[key]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; without a default the key must be stated."""
        if key not in self.content and default is not None:
            return default
        value = self.value(key)
        if not isinstance(value, str):
            self.refuse(key, "a text (quote it)")
        return value

    def number(self, key: str) -> float:
        """Return a number as a float; NaN and infinity are left to the check of the range."""
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.refuse(key, "a number")
        try:
            return float(value)
        except OverflowError:
            self.refuse(key, "a number that a float can hold")

    def scalar(self, key: str) -> bool | int | float | str:
        """Return a number, a text or a truth value."""
        value = self.value(key)
        if not isinstance(value, bool | int | float | str):
            self.refuse(key, "a number, a text, true or false")
        return value

    def choice(self, key: str, choices: Iterable[str]) -> str:
        """Return one of several texts."""
        names = list(choices)
        self.require(key, allowed=", ".join(names))
        value = self.content[key]
        if value not in names:
            self.refuse(key, ", ".join(names))
        return str(value)

    def section(
        self, key: str, known: Iterable[str] | None = None, *, kind: str = "key"
    ) -> StrictMapping:
        """Return the mapping of a key, an empty one where the key is not stated."""
        return StrictMapping(
            self.content.get(key, {}), f"{self.where}: {key}", known, kind=kind, error=self._error
        )

    def entries(self, key: str, *, may_be_empty: bool = False) -> list[Any]:
        """Return a list; without a value for the key an empty one, if that is permitted."""
        value = self.content.get(key, [])
        if not isinstance(value, list) or not (value or may_be_empty):
            self.refuse(key, "a list with at least one entry")
        return value


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file; others, such as pipes, and larger ones raise an `OSError`."""
    # Non-blocking: opening a pipe would wait for a writer.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError("not a regular file")
        if status.st_size > most_bytes:
            raise OSError(f"{status.st_size} bytes; at most {most_bytes} are read")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            return file.read(most_bytes)
    finally:
        os.close(descriptor)


def read_file(path: Path, most_bytes: int, error: type[IptmError]) -> bytes:
    """Return the content of a user's file; what cannot be read raises the error, with path and cause."""
    try:
        return read_bounded(path, most_bytes)
    except FileNotFoundError:
        raise error(f"{path}: no such file; allowed: the path of an existing one") from None
    except (OSError, ValueError) as reason:  # ValueError: a null character in the path
        raise error(f"{path}: cannot be read: {reason}") from reason


def is_path(text: str, suffixes: tuple[str, ...]) -> bool:
    """Return whether a text (without a part after ``#``) is a path: with a folder, or one of the suffixes."""
    parts = text.lower().split("#")
    heads = ("#".join(parts[: count + 1]) for count in range(len(parts)))
    return "/" in text or any(head.endswith(suffixes) for head in heads)


def file_and_name(path: Path) -> tuple[Path, str]:
    """Return a file and the name behind a ``#``, empty without; names of files may hold a ``#``, too."""
    text = str(path)
    places = [index for index, letter in enumerate(text) if letter == "#"]
    for end in [len(text), *reversed(places)]:
        if Path(text[:end]).exists():
            return Path(text[:end]), text[end + 1 :]
    end = places[0] if places else len(text)
    return Path(text[:end]), text[end + 1 :]


def number(text: str) -> float:
    """Read a plain decimal, as any other tool would: Python alone takes ``1_600`` for a number."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a plain number")
    return float(text)


def whole_number(text: str) -> int:
    """Read a plain whole number; see `number`."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a plain whole number")
    return int(text)
