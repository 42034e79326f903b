"""What the V2X receiver makes of messages: predictions, the price of not knowing, attacks, and load."""

from __future__ import annotations

from typing import Any

from studies.session import Session
from studies.v2x import attacks, prediction, price
from studies.v2x.options import PARTS

SHORT_S = 60.0
FLOOD = {"seconds": 30, "maps_per_s": 1000, "loops_beside": 1}


def run(session: Session) -> bool:
    """Run the study; returns whether everything was driven."""
    chosen = session.options.only or PARTS
    makers = {"prediction": _prediction, "price": _price, "attacks": _attacks, "load": _load}
    texts: dict[str, str] = {}
    for part in chosen:
        texts |= makers[part](session)
    session.fill(texts)
    return not session.failures


def _prediction(session: Session) -> dict[str, str]:
    calls: list[dict[str, Any]] = [{}]
    if session.short:
        calls = [{"every_s": 30.0, "cycle": ("nycc",), "traffic_s": 0.0}]
    (numbers,) = session.compute(prediction.measure, calls, ["prediction"])
    return {} if numbers is None else prediction.as_table(numbers)


def _price(session: Session) -> dict[str, str]:
    options = session.options
    files, cases = {}, price.cases_of(("nycc",), (price.DECAY, price.PATH), 1)
    if not session.short:
        files = price.measured_cycles(session.scratch / "leads")
        cases = price.cases_of(
            options.trip or price.TRIPS, options.leader or price.LEADERS, options.cells
        )
    calls = [
        {
            **dict(zip(price.KEY, case, strict=True)),
            "seed": options.seed,
            "duration_s": SHORT_S if session.short else None,
            "file": files.get(case[0], ""),
        }
        for case in cases
    ]
    names = [", ".join(map(str, case)) for case in cases]
    rows = [row for row in session.compute(price.drive, calls, names) if row is not None]
    return price.as_table(price.with_prices(rows))


def _attacks(session: Session) -> dict[str, str]:
    if session.short:
        route = attacks.steady_route()
        undisturbed = attacks.drive(route, attacks.AttackedRadio(route, None))
        title, attack = next(iter(attacks.ATTACKS.items()))
        attacked = attacks.drive(route, attacks.AttackedRadio(route, attack))
        rows = [attacks.attack_row(title, undisturbed, attacked)]
        return attacks.as_tables({"attacks": rows, "impostors": []})
    (numbers,) = session.compute(attacks.measure, [{}], ["attacks"])
    return {} if numbers is None else attacks.as_tables(numbers)


def _load(session: Session) -> dict[str, str]:
    """Loads of a node in real time: what a machine takes, which a short form says nothing about."""
    if session.short:
        return {}
    # Needs ROS 2, which the other parts do without.
    from studies.v2x import load  # noqa: PLC0415

    return load.as_text(load.measure()) | load.as_text(load.measure(**FLOOD))
