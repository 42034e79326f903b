"""What a predictive control saves on a recorded commute, against a car of today.

python docs/examples/commute.py my_commute.csv volkswagen_id4 -5
"""

import argparse

import iptm


def main() -> None:
    """Drive the commute twice and print what the first drive saved."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "drive", help="recorded drive: CSV, GPX, or what else `iptm drive show` reads"
    )
    parser.add_argument("car", help="such as volkswagen_id4; the reference on cars lists them")
    parser.add_argument("celsius", type=float, help="temperature of the air")
    parser.add_argument("--cell", default="nca", help="whose ageing counts over years")
    given = parser.parse_args()
    trip = {"cycle": given.drive, "vehicle": given.car, "climate": given.celsius}

    run = iptm.simulate(**trip)
    today = iptm.simulate(**trip, strategy="production")
    for label, text in run.saving(today).lines:
        print(f"{label}: {text}")
    years = iptm.life(run, against=today, cell=given.cell, climate=given.celsius)
    print(f"over years: {years.sentence.partition('; ')[2]}")
    for warning in run.warnings:
        print(f"note: {warning}")


if __name__ == "__main__":
    try:
        main()
    except iptm.IptmError as error:
        raise SystemExit(f"commute: {error}") from None
