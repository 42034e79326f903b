"""Result pages: rendered from templates, with a foot that states what they stand for, and a record of it.

The record of a study (`RECORD`) is committed beside its page. A page is stale when code or data of the suite
or of the study have changed since it was made, unless the short form of the study still has the same numbers.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from pathlib import Path

from iptm.fingerprint import RECORD, SUITE, fingerprint, fingerprint_of_files, used_by
from iptm_core.errors import StoreError

STUDIES = Path(__file__).parent
PAGE = "README.md"
SHOWN_DIGITS = 12
"""Of the digest in the foot of a page."""
_NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_PART = re.compile(r"<!-- (.+) -->\n(.*?)<!-- end of \1 -->", re.DOTALL)
_FOOT = re.compile(r"\n---\n\nMade by `scripts/study [^\n]*\n\Z")
_DATA = frozenset({".py", ".j2", ".yaml", ".gz", ".csv", ".json"})


@dataclass(frozen=True)
class Record:
    """What the pages of a study stand for.

    Attributes:
        made: date on which they were made (ISO 8601).
        confirmed: date on which the short form was last found to have the same numbers.
        code: digest of code and data.
        pages: digests of the numbers of each page, by file name.
        short: numbers of each page of the short form, by file name; empty where they are times of a machine.
        out_of_date: why the pages are known to be out of date, shown in their feet; empty if they are not.
    """

    made: str
    confirmed: str
    code: str
    pages: Mapping[str, str] = field(default_factory=dict)
    short: Mapping[str, str] = field(default_factory=dict)
    out_of_date: str = ""

    @classmethod
    def of(cls, study: str) -> Record:
        """Read the record of a study.

        Raises:
            StoreError: there is none, or it is damaged.
        """
        path = STUDIES / study / RECORD
        try:
            return cls(**json.loads(path.read_text("utf-8")))
        except (OSError, TypeError, ValueError) as error:
            raise StoreError(f"{study}/{RECORD} cannot be read: {error}") from error

    def write(self, study: str) -> None:
        """Write the record, and the foot of each page of the study."""
        folder = STUDIES / study
        text = json.dumps(asdict(self), indent=1, ensure_ascii=False)
        (folder / RECORD).write_text(text + "\n", "utf-8")
        for page in self.pages:
            body = without_foot((folder / page).read_text("utf-8"))
            (folder / page).write_text(body + self.foot(study), "utf-8")

    def foot(self, study: str) -> str:
        """Return the foot of a page: command, dates, and the beginning of the digest of code and data."""
        confirmed = "" if self.confirmed == self.made else f", confirmed on {self.confirmed}"
        warning = f" **Out of date:** {self.out_of_date}." if self.out_of_date else ""
        return (
            f"\n---\n\nMade by `scripts/study {study}` on {self.made}{confirmed}; code and data"
            f" `{self.code[:SHOWN_DIGITS]}`.{warning}\n"
        )


def code_of(study: str) -> str:
    """Return the digest of the code and data that the numbers of a study depend on."""
    files, packages = files_and_packages(study)
    parts = fingerprint((*SUITE, *packages)), fingerprint_of_files(files)
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def files_and_packages(study: str) -> tuple[frozenset[Path], tuple[str, ...]]:
    """Return the files of a study and of others that it imports, and packages beside the suite.

    Of a study from which it imports, the measurements count, too.
    """
    found = (path for path in (STUDIES / study).rglob("*") if path.suffix in _DATA)
    own = {path for path in found if path.name != RECORD}
    files, packages = used_by((path for path in own if path.suffix == ".py"), STUDIES)
    return files | own, packages


def numbers_of(page: str) -> str:
    """Return all numbers of a page except in its foot, in order.

    Of a page that is written by hand around marked parts, only the numbers of these count.
    """
    body = without_foot(page)
    parts = [part for _, part in _PART.findall(body)]
    return " ".join(_NUMBER.findall("\n".join(parts) if parts else body))


def digest_of(page: str) -> str:
    """Return a digest of the numbers of a page."""
    return hashlib.sha256(numbers_of(page).encode()).hexdigest()[:32]


def without_foot(page: str) -> str:
    """Return a page without its foot."""
    return _FOOT.sub("\n", page).rstrip("\n") + "\n"


def put(page: str, name: str, text: str) -> str:
    """Return a page with a text between its two marks.

    Raises:
        StoreError: the page lacks the marks.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    if begin not in page or end not in page:
        raise StoreError(f"the page has no marks {begin.strip()} and {end}; allowed: both of them")
    head, rest = page.split(begin, 1)
    return f"{head}{begin}\n{text.strip()}\n\n{end}{rest.split(end, 1)[1]}"


def today() -> str:
    """Return the date, ISO 8601."""
    return f"{datetime.now(timezone.utc):%Y-%m-%d}"
