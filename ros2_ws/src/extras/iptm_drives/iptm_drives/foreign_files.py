"""Files of other programs that are no tables: what they are, and the drives in those that can be read.

A file is named by how it begins, not by its suffix. Readers of what few files need are optional.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_drives import receivers, workbooks
from iptm_drives.fit_file import fit
from iptm_drives.named_table import columns_table
from iptm_drives.records import records
from iptm_drives.text_table import parse_text_table, text_of

_Read = Mapping[str, Any] | str | tuple[Mapping[str, Any], list[str]]
"""Columns by name, the text of a table, or columns with notes."""
_INSTEAD = "a table saved as CSV, or a GPX track"
_BUS = "a log of a bus, which `iptm drive can` makes a drive of,"


def read_foreign(path: Path, content: bytes, columns: str = "") -> DriveTable | None:
    """Return the drive in the content of a file of another program; None for one of text.

    Args:
        path: for messages.
        content: of the file, decompressed.
        columns: see `iptm_drives.text_table.parse_text_table`.

    Raises:
        RouteError: the file is of a kind that is not read, or has no drive; the message names the kind.
    """
    head = content[:4096].lstrip(b"\xef\xbb\xbf \r\n\t")
    for kind, begins, read in _KINDS:
        if not re.match(begins, head, re.DOTALL):
            continue
        if read is None:
            raise RouteError(f"{path} is {kind}, which is not read; allowed: {_INSTEAD}")
        try:
            found = read(content)
        except RouteError:
            raise
        except ImportError as reason:
            raise RouteError(
                f"{path} is {kind}, which is not read without {reason.name}; allowed: {_INSTEAD}"
            ) from None
        except Exception as reason:  # the readers have error types of their own
            raise RouteError(f"{path} is {kind}, and cannot be read ({reason})") from reason
        if isinstance(found, str):
            return parse_text_table(found, str(path), columns)
        named, notes = found if isinstance(found, tuple) else (found, [])
        rows = max(map(len, named.values()), default=0)
        if not rows:
            raise RouteError(f"{path} is {kind} without a point that has a time; allowed: a drive")
        return columns_table(named, str(path)).noted(*notes)
    return None


def _labview(content: bytes) -> str:
    return text_of(content).rpartition("***End_of_Header***")[2]


_KINDS: tuple[tuple[str, bytes, Callable[[bytes], _Read] | None], ...] = (
    ("a TCX file of a sports watch", rb".{0,200}<TrainingCenterDatabase", receivers.tcx),
    ("a KML file", rb".{0,200}<kml", receivers.kml),
    ("a log of NMEA sentences", rb"[$!][A-Z]{2}[A-Z]{3},", receivers.nmea),
    ("a GeoJSON file", rb"\{.{0,200}\"(Feature|FeatureCollection|LineString)\"", receivers.geojson),
    ("a JSON file", rb"[\[{]\s*[\"{\[]", records),
    ("a FIT file of a sports computer", rb"[\x0c\x0e].{7}\.FIT", fit),
    ("a pointer of Git LFS in the place of the file", rb"version https://git-lfs", None),
    ("an Excel workbook (xlsx)", rb"PK\x03\x04.{0,4000}(xl/|\[Content_Types\]|docProps)",
     workbooks.xlsx),
    ("an Excel workbook (xls)", rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", None),
    ("an Arrow file (Feather)", rb"ARROW1", workbooks.feather),
    ("an HDF5 file", rb"\x89HDF", None),
    ("a MATLAB file", rb"MATLAB [57]\.", None),
    ("a VBOX file (.vbo)", rb"File created on .{0,80}\[header\]", receivers.vbox),
    ("a file of RaceChrono", rb"This file is created using RaceChrono", receivers.racechrono),
    ("a track of OziExplorer", rb"OziExplorer Track Point", receivers.ozi),
    ("a measurement of LabVIEW", rb"LabVIEW Measurement", _labview),
    ("a web page", rb"<!DOCTYPE html|<html", None),
    ("a database of SQLite", rb"SQLite format 3", None),
    ("a PDF document", rb"%PDF", None),
    ("a flight log (IGC)", rb"A[A-Z0-9]{3}[^\n]{0,80}\nHF", None),
    ("a file of subtitles", rb"1\s+[\d:,]+ --> ", None),
    ("an array of NumPy", rb"\x93NUMPY", None),
    ("a pickle of Python", rb"\x80[\x02-\x05]", None),
    ("a TDMS file of LabVIEW", rb"TDSm", None),
    ("a 7z archive", rb"7z\xbc\xaf", None),
    ("a picture", rb"\x89PNG|\xff\xd8\xff", None),
    ("a capture of a network", rb"\xd4\xc3\xb2\xa1|\xa1\xb2\xc3\xd4|\n\r\r\n", None),
    (_BUS, rb"MDF |LOGG|\(\d+\.\d+\)\s+\S+\s+[0-9A-F]+#|date [^\n]*\n\s*base (hex|dec)", None),
    ("an XML file of another kind than GPX, TCX and KML", rb"<\?xml|<!DOCTYPE|<html", None),
)  # fmt: skip
"""Name of a kind, how its files begin, and what reads their columns; None where nothing does."""
