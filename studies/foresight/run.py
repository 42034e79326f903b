"""What foresight is worth at the headway of production cars, and what is made without it.

Behind the same leaders: with a perfect preview of some seconds, and with the range sensor alone, where the
leader is extrapolated. The optimum of a whole trip knows all.
"""

from __future__ import annotations

from studies.drives import DEFAULT
from studies.headway.effects import WHOLE_S, Controls, drive_controls
from studies.road_space.run import DESIRED_S
from studies.savings import PRODUCTION
from studies.session import Session

JERK_M_S3 = 2.0
"""Of both: with the paper's 0.5 brakes take 4 s to build up 2 m/s²; ISO 15622 allows cruise controls 2.5."""
PREVIEWS_S = (60.0, 20.0, 10.0, 5.0, 2.0, 1.0)
OPTIMUM = "optimum of the whole trip"
EXTRAPOLATED = "no preview, extrapolated"


def controls() -> Controls:
    """Return the controls of the table, `production` first."""
    quick = {"limits.max_jerk_m_s3": JERK_M_S3}
    blind = {"preview_mode": "none"}
    equal = {
        "value_beyond_trip": True,
        "overrides": {**quick, "gap.desired_time_headway_s": DESIRED_S},
    }
    return {
        PRODUCTION: (PRODUCTION, {**blind, "overrides": quick}, {}),
        OPTIMUM: (DEFAULT, equal, {"whole": True}),
        **{
            f"perfect preview of {seen_s:g} s": (DEFAULT, {**equal, "preview_length_s": seen_s}, {})
            for seen_s in PREVIEWS_S
        },
        EXTRAPOLATED: (DEFAULT, {**equal, **blind}, {}),
    }


def run(session: Session) -> bool:
    """Run the study; returns whether no lead vehicle was touched."""
    table = drive_controls(session, controls())
    by_trip = table.pivot_table(
        index=["cycle", "car"], columns="control", values=["ageing", "headway_s"]
    )
    shares = by_trip.ageing.div(by_trip.ageing[OPTIMUM], axis=0)
    further = by_trip.headway_s.sub(by_trip.headway_s[PRODUCTION], axis=0)
    grouped = table.groupby("control", sort=False)
    summary = grouped[["headway_s", "ageing", "energy"]].median()
    summary["share"] = 100.0 * shares.median()
    summary["further_s"] = further.median()
    summary["smallest_gap_m"] = grouped.smallest_gap_m.min()
    summary["interventions"] = grouped.interventions.sum()
    session.render(
        table=summary.drop(index=PRODUCTION).reset_index(),
        trips=len(by_trip),
        whole_s=WHOLE_S,
        jerk_m_s3=JERK_M_S3,
        desired_s=DESIRED_S,
    )
    return bool((table.smallest_gap_m > 0.0).all())
