"""The drive of `field_drives` as programs and mishaps write it, each with the right reading."""

from __future__ import annotations

import bz2
import io
import json
import lzma
import struct
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
from tests.extras.iptm_drives.field_drives import BEGIN, DRIVE, UNIX_S, write_gpx

KMH, MPH, KN, FT = 3.6, 1.0 / 0.44704, 1.0 / 0.514444, 1.0 / 0.3048
ROWS = range(DRIVE.times_s.size)
T = [f"{at:.1f}" for at in DRIVE.times_s]
V = [f"{v:.3f}" for v in DRIVE.speeds]
KM_H = [f"{KMH * v:.2f}" for v in DRIVE.speeds]
M_P_H = [f"{MPH * v:.2f}" for v in DRIVE.speeds]
LAT = [f"{v:.7f}" for v in DRIVE.latitudes]
LON = [f"{v:.7f}" for v in DRIVE.longitudes]
ELE = [f"{v:.2f}" for v in DRIVE.heights_m]
N = ["7"] * len(T)
Cells = Sequence[str]


def clock(form: str, hours: float = 0.0) -> list[str]:
    return [
        (BEGIN + timedelta(hours=hours, seconds=float(at))).strftime(form) for at in DRIVE.times_s
    ]


ISO = clock("%Y-%m-%dT%H:%M:%SZ")


def table(columns: Mapping[str, Cells], by: str = ",", head: str = "", tail: str = "\n") -> str:
    rows = zip(*columns.values(), strict=True)
    return head + tail.join([by.join(columns), *(by.join(row) for row in rows), ""])


def comma(cells: Cells) -> list[str]:
    return [cell.replace(".", ",") for cell in cells]


def dm(cells: Cells, form: str) -> list[str]:
    parts = (divmod(float(cell), 1.0) for cell in cells)
    return [form.format(int(whole), 60.0 * rest) for whole, rest in parts]


def zipped(members: Mapping[str, str]) -> bytes:
    with io.BytesIO() as held:
        with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in members.items():
                archive.writestr(name, content)
        return held.getvalue()


def workbook(sheets: Mapping[str, Iterable[Sequence[Any]]]) -> bytes:
    openpyxl = pytest.importorskip("openpyxl", reason="requirements/can.txt is not installed")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    with io.BytesIO() as held:
        book.save(held)
        return held.getvalue()


def fit(*, places: bool = True, speed: bool = True) -> bytes:
    """Return a FIT file of records: timestamp, position, altitude and speed, by the protocol."""
    fields = [(253, 4, 0x86)]
    fields += [(0, 4, 0x85), (1, 4, 0x85), (2, 2, 0x84)] if places else []
    fields += [(6, 2, 0x84)] if speed else []
    body = struct.pack("<BBBHB", 0x40, 0, 0, 20, len(fields))
    body += b"".join(struct.pack("BBB", *field) for field in fields)
    began = int((BEGIN - datetime(1989, 12, 31, tzinfo=timezone.utc)).total_seconds())
    half = 2**31 / 180.0
    for k in ROWS:
        body += struct.pack("<BI", 0, began + k)
        if places:
            place = round(half * float(LAT[k])), round(half * float(LON[k]))
            body += struct.pack("<iiH", *place, round(5.0 * (float(ELE[k]) + 500.0)))
        if speed:
            body += struct.pack("<H", round(1000.0 * float(V[k])))
    head = struct.pack("<BBHI4s", 14, 0x20, 2100, len(body), b".FIT")
    head += struct.pack("<H", _crc(head))
    return head + body + struct.pack("<H", _crc(head + body))


def _crc(content: bytes) -> int:
    steps = (0x0, 0xCC01, 0xD801, 0x1400, 0xF001, 0x3C00, 0x2800, 0xE401,
             0xA001, 0x6C00, 0x7800, 0xB401, 0x5000, 0x9C01, 0x8801, 0x4400)  # fmt: skip
    crc = 0
    for byte in content:
        for nibble in (byte & 0xF, byte >> 4):
            crc = (crc >> 4) ^ steps[crc & 0xF] ^ steps[nibble]
    return crc


def gpx_text(folder: Path) -> str:
    return write_gpx(folder / "made.gpx", DRIVE).read_text()


PLAIN = table({"time_s": T, "speed_kmh": KM_H, "elevation_m": ELE})
LOCATED = {"lat": LAT, "lon": LON}
RECORDS = [
    {"tst": UNIX_S + k, "lat": float(LAT[k]), "lon": float(LON[k]), "alt": float(ELE[k])}
    for k in ROWS
]

READ: dict[str, tuple[str, str | bytes]] = {
    "OBD Fusion": ("a.csv", table(
        {"Time (sec)": T, " Vehicle speed (MPH)": M_P_H, " Engine RPM (RPM)": N, " Altitude (ft)":
         [f"{FT * float(v):.1f}" for v in ELE]}, head="# StartTime = 05/04/2026 07:30:00.0 AM\n")),
    "Harry's LapTimer": ("a.csv", table(
        {"INDEX": N, "LAPINDEX": N, "DATE": clock("%d-%b-%y"), "TIME": clock("%H:%M:%S.00"),
         "TIME_LAP": T, "LATITUDE": LAT, "LONGITUDE": LON, "SPEED_KPH": KM_H, "SPEED_MPH": M_P_H,
         "HEIGHT_M": ELE, "HEIGHT_FT": [f"{FT * float(v):.1f}" for v in ELE]})),
    "TrackAddict": ("a.csv", table(
        {'"Time"': T, '"UTC Time"': [f"{UNIX_S + float(t):.3f}" for t in T], '"Lap"': N,
         '"GPS_Update"': N, '"Latitude"': LAT, '"Longitude"': LON, '"Altitude (m)"': ELE,
         '"Speed (MPH)"': M_P_H, '"Heading"': N}, head="# RaceRender Data: TrackAddict 4.6\n")),
    "GPSLogger": ("a.txt", table(
        {"time": ISO, **LOCATED, "elevation": ELE, "accuracy": N, "bearing": N, "speed": V,
         "satellites": N, "provider": ["gps"] * len(T)})),
    "Sensor Logger": ("Location.csv", table(
        {"time": [f"{int(UNIX_S + k)}000000000" for k in ROWS], "seconds_elapsed": T,
         "speedAccuracy": N, "speed": V, "altitude": ELE, "longitude": LON, "latitude": LAT})),
    "phyphox": ("a.csv", table(
        {'"Time (s)"': T, '"Latitude (°)"': LAT, '"Longitude (°)"': LON, '"Height (m)"': ELE,
         '"Velocity (m/s)"': V, '"Direction (°)"': N, '"Horizontal Accuracy (m)"': N})),
    "unicsv": ("a.csv", table(
        {"No": N, "Latitude": LAT, "Longitude": LON, "Altitude": ELE, "Date": clock("%Y/%m/%d"),
         "Time": clock("%H:%M:%S")})),
    "Columbus": ("a.csv", table(
        {"INDEX": N, "TAG": ["T"] * len(T), "DATE": clock("%y%m%d"), "TIME": clock("%H%M%S"),
         "LATITUDE N/S": [f"{v}N" for v in LAT], "LONGITUDE E/W": [f"{v}E" for v in LON],
         "HEIGHT": ELE, "SPEED": KM_H, "HEADING": N})),
    "date and time": ("a.csv", table(
        {"Date": clock("%d.%m.%Y"), "Time": clock("%H:%M:%S"), "Speed [km/h]": KM_H})),
    "TeslaMate": ("a.csv", table(
        {"date": clock("%Y-%m-%d %H:%M:%S.000"), "latitude": LAT, "longitude": LON,
         "speed": KM_H, "power": N, "odometer": [f"{4000 + v / 1000:.3f}" for v in DRIVE.along_m],
         "ideal_battery_range_km": N, "elevation": ELE, "battery_level": N})),
    "TeslaFi": ("a.csv", table(
        {"Date": clock("%Y-%m-%d %H:%M:%S"), "speed": M_P_H, "latitude": LAT, "longitude": LON,
         "battery_level": N, "shift_state": ["D"] * len(T), "odometer": N})),
    "Car Scanner": ("a.csv", table(
        {'"SECONDS"': [f'"{30000 + k}.5"' for k in ROWS for _ in "ab"],
         '"PID"': ['"Vehicle speed"', '"State of charge"'] * len(T),
         '"VALUE"': [f'"{v}"' for k in ROWS for v in (KM_H[k], "80")],
         '"UNITS"': ['"km/h"', '"%"'] * len(T)}, by=";")),
    "Zeit": ("a.csv", table(
        {"Zeit [s]": comma(T), "Geschwindigkeit [km/h]": comma(KM_H), "Höhe [m]": comma(ELE)}, ";")),
    "temps": ("a.csv", table({"temps (s)": T, "vitesse (km/h)": KM_H, "altitude (m)": ELE})),
    "newest first": ("a.csv", table({"time": ISO[::-1], "speed [km/h]": KM_H[::-1]})),
    "exported twice": ("a.csv", PLAIN + PLAIN.partition("\n")[2]),
    "units in cells": ("a.csv", table(
        {"time": [f"{t} s" for t in T], "speed": [f"{v} km/h" for v in KM_H]})),
    "marks of no value": ("a.csv", table(
        {"time_s": T, "speed_kmh": ["327.67" if k in {9, 33} else KM_H[k] for k in ROWS],
         "elevation_m": ["-9999" if k in {12, 80} else ELE[k] for k in ROWS]})),
    "seconds of whole numbers at 10 Hz": ("a.csv", table(
        {"time_s": [str(k) for k in ROWS for _ in range(10)],
         "speed_m_s": [v for v in V for _ in range(10)]})),
    "GPS week": ("a.csv", table(
        {"GPS Week": ["2417"] * len(T), "TOW [s]": [f"{113400 + k}.00" for k in ROWS],
         "Ground Speed [kn]": [f"{KN * float(v):.3f}" for v in V]})),
    "basic ISO": ("a.csv", table({"timestamp": clock("%Y%m%dT%H%M%SZ"), "speed (m/s)": V})),
    "zone without colon": ("a.csv", table(
        {"time": [f"{t},000 +0530" for t in clock("%Y-%m-%d %H:%M:%S", 5.5)], "speed (m/s)": V}, ";")),
    "12 o'clock": ("a.csv", table(
        {"Time": clock("%I:%M:%S %p", 5.4833), "Speed (km/h)": KM_H, "Altitude (m)": ELE})),
    "midnight": ("a.csv", table({"Time": clock("%H:%M:%S", 16.4833), "Speed (km/h)": KM_H})),
    "R": ("a.csv", table(
        {'""': [f'"{k + 1}"' for k in ROWS], '"time_s"': T, '"speed_m_s"': V})),
    "index of pandas": ("a.csv", table({"": [str(k) for k in ROWS], "time_s": T, "speed_m_s": V})),
    "empty lines": ("a.csv", PLAIN.replace("\n", "\r\n\r\n")),
    "NUL block": ("a.csv", PLAIN[:900] + "\0" * 512 + PLAIN[900:]),
    "cut inside a line": ("a.csv", PLAIN[:-9]),
    "header again": ("a.csv", PLAIN[: PLAIN.index("60.0,")] + "time_s,speed_kmh,elevation_m\n"
                     + PLAIN[PLAIN.index("60.0,"):]),
    "SOG": ("a.csv", table(
        {"UTC": ISO, "LAT": LAT, "LON": LON, "SOG (kn)": [f"{KN * float(v):.3f}" for v in V],
         "COG (deg)": N})),
    "OziExplorer": ("a.plt", "OziExplorer Track Point File Version 2.1\nWGS 84\nAltitude is in Feet\n"
                    "Reserved 3\n0,2,255,drive,0,0,2,8421376\n121\n" + "".join(
                        f"  {LAT[k]},  {LON[k]},{int(k == 0)},{FT * float(ELE[k]):7.1f},"
                        f"{46146.3125 + k / 86400.0:.7f}, 04-May-26, 07:3{k // 60}:{k % 60:02d}\n"
                        for k in ROWS)),
    "JSON lines": ("a.jsonl", "".join(json.dumps(row) + "\n" for row in RECORDS)),
    "JSON records": ("a.json", json.dumps(RECORDS)),
    "Records.json": ("Records.json", json.dumps({"locations": [
        {"latitudeE7": round(1e7 * float(LAT[k])), "longitudeE7": round(1e7 * float(LON[k])),
         "altitude": float(ELE[k]), "timestamp": ISO[k]} for k in ROWS]})),
    "bz2": ("a.csv.bz2", bz2.compress(PLAIN.encode())),
    "xz": ("a.csv.xz", lzma.compress(PLAIN.encode())),
    "zip": ("a.zip", zipped({"drive.csv": PLAIN})),
    "zip of a Mac": ("a.zip", zipped({"drive.csv": PLAIN, "__MACOSX/._drive.csv": "\0\5\26\7"})),
    "LabVIEW": ("a.lvm", "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n"
                + table({"time [s]": T, "speed [km/h]": KM_H}, "\t")),
    "GPX 1.0": ("a.gpx", '<?xml version="1.0"?><gpx version="1.0" xmlns="http://www.topografix.com/GPX/1/0">'
                "<trk><trkseg>" + "".join(
                    f'<trkpt lat="{LAT[k]}" lon="{LON[k]}"><ele>{ELE[k]}</ele><time>{ISO[k]}</time>'
                    f"<course>45</course><speed>{V[k]}</speed></trkpt>" for k in ROWS)
                + "</trkseg></trk></gpx>"),
    "degrees and minutes": ("a.csv", table(
        {"time": ISO, "latitude": dm(LAT, "N{}° {:.5f}'"), "longitude": dm(LON, "E{}° {:.5f}'"),
         "altitude [m]": ELE})),
    "e-notation": ("a.csv", table(
        {"t[s]": [f"{float(t):.6E}" for t in T], "v[km/h]": [f"{float(v):.6E}" for v in KM_H]}, "\t")),
    "microseconds": ("a.csv", table(
        {"timestamp": [f"{int(UNIX_S + k)}000000" for k in ROWS], "speed_mps": V})),
}  # fmt: skip
"""Name of a file and its content, by what wrote it; the drive is to be read."""

_CAN = "(1777879800.000000) can0 100#0000000000000000\n"

REFUSED: dict[str, tuple[str, str | bytes, str]] = {
    "thousands or decimals": ("a.csv", table(
        {"time (ms)": [f'"{1000 * k + 5000:,}"' for k in ROWS], "speed (km/h)": KM_H}), "5,000"),
    "no unit": ("a.csv", table({"time_s": T, "speed_raw": KM_H}), "speed"),
    "days of a workbook": ("a.csv", table(
        {"Time": [f"{0.3125 + k / 86400.0:.8f}" for k in ROWS], "Speed (km/h)": KM_H}), r"day"),
    "time begins again": ("a.csv", PLAIN + "\n".join(
        f"{k},{50 + 3 * (k % 9)},500" for k in range(40)) + "\n", "before|restart|begin"),
    "other order in the middle": ("a.csv", PLAIN + "speed_kmh,time_s,elevation_m\n" + "".join(
        f"{KM_H[k]},{121 + k},{ELE[k]}\n" for k in ROWS), "header"),
    "other unit in the middle": ("a.csv", PLAIN + "time_s,speed_mph,elevation_m\n" + "".join(
        f"{121 + k},{M_P_H[k]},{ELE[k]}\n" for k in ROWS), "header"),
    "two speeds": ("a.csv", table(
        {"Time (s)": T, "Speed (OBD) (km/h)": KM_H, "Speed (GPS) (km/h)": [
            f"{0.7 * float(v):.2f}" for v in KM_H]}), "Speed .OBD"),
    "engine only": ("a.csv", table({"Time (s)": T, "Engine RPM (rpm)": N, "Coolant (°C)": N}),
                    "no speed"),
    "swapped": ("a.csv", table({"time": ISO, "latitude": [f"-1{v}" for v in LON], "longitude": LAT}),
                "latitude"),
    "SQLite": ("a.db", b"SQLite format 3\0" + bytes(200), "SQLite"),
    "PDF": ("a.csv", b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n1 0 obj\n", "PDF"),
    "web page": ("a.csv", "<!DOCTYPE html>\n<html><body>Please log in</body></html>\n", "web page"),
    "IGC": ("a.igc", "AXXXABC FLIGHT:1\r\nHFDTE040526\r\nB0730004812345N01134567EA0050000520\r\n" * 9,
            "IGC"),
    "subtitles": ("a.srt", "1\n00:00:00,000 --> 00:00:01,000\n48.2, 11.5 36 km/h\n\n" * 9, "subtitle"),
    "numpy": ("a.npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}", "NumPy"),
    "pickle": ("a.pkl", b"\x80\x05\x95\x10\x00\x00\x00\x00\x00\x00\x00}", "pickle"),
    "rosbag 1": ("a.bag", b"#ROSBAG V2.0\nE\0\0\0", "bag"),
    "MDF": ("a.mf4", b"MDF     4.10    asammdf \0\0\0\0", "drive can"),
    "BLF": ("a.blf", b"LOGG\x90\0\0\0" + bytes(100), "drive can"),
    "candump": ("a.log", _CAN * 9, "drive can"),
    "ASC": ("a.asc", ("date Mon May 4 07:30:00.000 am 2026\nbase hex  timestamps absolute\n"
            "0.000000 1  100             Rx   d 8 00 00 00 00 00 00 00 00\n"), "drive can"),
    "pcap": ("a.pcap", b"\xd4\xc3\xb2\xa1\x02\0\x04\0" + bytes(30), "capture"),
    "TDMS": ("a.tdms", b"TDSm\x0e\0\0\0" + bytes(40), "TDMS"),
    "MATLAB 7.3": ("a.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(500), "MATLAB"),
    "7z": ("a.7z", b"7z\xbc\xaf\x27\x1c\0\4" + bytes(40), "7z"),
    "picture": ("a.csv", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "PNG|picture"),
    "zip of two": ("a.zip", zipped({"one.csv": PLAIN, "two.csv": PLAIN}), "one.csv"),
    "zip of none": ("a.zip", zipped({"read.me": "x"}), "zip"),
    "zip cut": ("a.zip", zipped({"drive.csv": PLAIN})[:-60], "zip"),
    "empty": ("a.csv", "", "empty"),
    "header alone": ("a.csv", "time_s,speed_m_s\n", "no rows"),
}  # fmt: skip
"""Name, content, and what the message has to name."""
