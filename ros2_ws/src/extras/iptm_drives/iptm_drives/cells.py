"""Numbers, moments and times of the day in the texts of a file."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable
from datetime import datetime, timezone

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import counted
from iptm_core.user_input import number, shown

MOST_INVALID = 0.2
"""Share of the rows that may have to be repaired."""
MISSING = frozenset(
    {"", "-", "--", "na", "n/a", "#n/a", "nan", "null", "none", "inf", "-inf", "invalid"}
)
"""Texts, in lower case, that stand for a value that was not measured."""


def cell_value(where: str, name: str, text: str | None) -> float:
    """Return the number in a text, NaN for what was not measured; other texts are refused."""
    plain = (text or "").strip().replace("\N{MINUS SIGN}", "-")
    if plain.lower() in MISSING:
        return math.nan
    try:
        value = number(plain)
    except ValueError:
        raise RouteError(f"{where}: {name} is {shown(text)}; allowed: a finite number") from None
    return value if math.isfinite(value) else math.nan


_ISO = re.compile(
    r"(\d{4})-?(\d\d)-?(\d\d)[T ](\d\d):?(\d\d)(?::?(\d\d)(?:[.,](\d+))?)?\s*"
    r"(?:Z|([+-])(\d\d)(?::?(\d\d))?)?",
    re.IGNORECASE,
)
_CLOCK = re.compile(r"(?:(?:(\d+):)?(\d{1,3}):)?(\d{1,3}):(\d\d(?:[.,]\d+)?)")
_CLOCK_UNITS_S = (86400.0, 3600.0, 60.0, 1.0)
_DAY_AND_MONTH = re.compile(r"(\d{1,2})([./-])(\d{1,2}|[A-Za-z]{3})[./-](\d{4}),?[T ]+")
_MONTHS = "janfebmaraprmayjunjulaugsepoctnovdec"
_UNIX_DATE = re.compile(
    r"[A-Za-z]{3} ([A-Za-z]{3}) (\d{1,2}) (\d\d:\d\d:\d\d) (?:GMT|UTC)?([+-]\d\d:?\d\d)? ?(\d{4})"
)
_HALF_DAY = re.compile(r"(.*[ T]|)(\d{1,2})(:[\d:.,]+)\s*([ap])\.?m\.?", re.IGNORECASE)


_WRITTEN = re.compile(r"(\d\d)(\d\d)(\d\d(?:\.\d+)?)")
_PLACE = re.compile(
    r"([NSEW]?)\s*([-+]?\d+(?:\.\d+)?)\s*°?\s*(?:(\d+(?:\.\d+)?)\s*['′’]\s*)?"
    r"(?:(\d+(?:\.\d+)?)\s*(?:\"|″|'')\s*)?([NSEW]?)",
    re.IGNORECASE,
)


def is_written_clock(texts: Iterable[str]) -> bool:
    """Return whether all texts are times of the day as ``hhmmss``."""
    found = [_WRITTEN.fullmatch(text.strip()) for text in texts]
    parts = [(int(each[1]), int(each[2]), float(each[3])) for each in found if each is not None]
    return len(parts) == len(found) and all(h < 24 and m < 60 and s < 61.0 for h, m, s in parts)


def degrees_of(where: str, name: str, text: str | None) -> float:
    """Return the degrees of a place: a number, or degrees, minutes and seconds with a side."""
    found = _PLACE.fullmatch((text or "").strip())
    if found is None:
        return cell_value(where, name, text)
    degrees, minutes, seconds = (float(found[part] or 0.0) for part in (2, 3, 4))
    value = abs(degrees) + minutes / 60.0 + seconds / 3600.0
    is_negative = found[2].startswith("-") or {found[1].upper(), found[5].upper()} & {"S", "W"}
    return -value if is_negative else value


def is_day_first(texts: Iterable[str]) -> bool:
    """Return whether dates with slashes begin with the day, as one of them whose first number is no month."""
    dates = (_DAY_AND_MONTH.match(text.strip()) for text in texts)
    return any(date is not None and date[2] == "/" and int(date[1]) > 12 for date in dates)


def seconds_of(
    where: str, name: str, text: str | None, *, day_first: bool = False, written: bool = False
) -> float:
    """Return the seconds of a moment (without an offset in UTC), ``h:m:s``, ``m:s``, or a number.

    A moment is one of ISO 8601, or ``d.m.y`` or ``m/d/y`` with the time of the day, which may be am or pm.

    Args:
        day_first: whether dates with slashes are ``d/m/y``.
        written: whether times of the day are ``hhmmss``.
    """
    plain = (text or "").strip()
    if written and (digits := _WRITTEN.fullmatch(plain)) is not None:
        plain = f"{digits[1]}:{digits[2]}:{digits[3]}"
    if (half := _HALF_DAY.fullmatch(plain)) is not None:
        hour = int(half[2]) % 12 + (12 if half[4].lower() == "p" else 0)
        plain = f"{half[1]}{hour:02d}{half[3]}"
    if (date := _UNIX_DATE.fullmatch(plain)) is not None:
        month = _MONTHS.find(date[1].lower()) // 3 + 1
        plain = f"{date[5]}-{month:02d}-{int(date[2]):02d}T{date[3]}{date[4] or 'Z'}"
    if (date := _DAY_AND_MONTH.match(plain)) is not None:
        first, second = int(date[1]), date[3].lower()
        month = int(second) if second.isdigit() else _MONTHS.find(second) // 3 + 1
        day, month = (
            (month, first) if date[2] == "/" and first <= 12 and not day_first else (first, month)
        )
        plain = f"{date[4]}-{month:02d}-{day:02d}T{plain[date.end() :].zfill(8)}"
    if (clock := _CLOCK.fullmatch(plain)) is not None:
        parts = (float((part or "0").replace(",", ".")) for part in clock.groups())
        return sum(part * unit for part, unit in zip(parts, _CLOCK_UNITS_S, strict=True))
    if (iso := _ISO.fullmatch(plain)) is None:
        try:
            return cell_value(where, name, plain)
        except RouteError as reason:
            raise RouteError(f"{reason}, ISO 8601, d.m.y h:m:s, or h:m:s") from None
    year, month, day, hour, minute, second = (int(part or 0) for part in iso.groups()[:6])
    sign, hours, minutes = iso[8] or "+", int(iso[9] or 0), int(iso[10] or 0)
    try:
        # A leap second is the first one of the next minute.
        moment = datetime(year, month, day, hour, minute, min(second, 59), tzinfo=timezone.utc)
    except ValueError:  # as 0000-00-00T00:00:00Z of a receiver without a fix
        return math.nan
    ahead_s = float(f"{sign}1") * (3600 * hours + 60 * minutes)
    return moment.timestamp() + max(0, second - 59) - ahead_s + float(f"0.{iso[7] or 0}")


class Cells:
    """Reads the texts of a file. One that cannot be read costs its value; many are refused."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._first: dict[str, str] = {}
        self._count: Counter[str] = Counter()

    def read(
        self, where: str, name: str, text: str | None, by: Callable[..., float] = cell_value
    ) -> float:
        """Return the value of a text, NaN if it has none."""
        try:
            return by(where, name, text)
        except RouteError as reason:
            self._first.setdefault(name, str(reason))
            self._count[name] += 1
            return math.nan

    def notes(self, rows: int, row: str) -> list[str]:
        """Return what could not be read, out of a number of rows.

        Raises:
            RouteError: it is more than single values.
        """
        for name, count in self._count.items():
            if count > MOST_INVALID * rows:
                raise RouteError(f"{self._source}, {self._first[name]}")
        return [
            f"{name} not readable at {counted(count, row)}, as in "
            f"{self._first[name].partition(';')[0]}"
            for name, count in self._count.items()
        ]
