"""Compare the models with the excerpts of measurements of cars, cells and drivers."""

from __future__ import annotations

from studies.session import Session
from studies.validation import excerpts
from studies.validation.cell import PanasonicCell, compare_cell
from studies.validation.drivers import LeadBounds, compare_drivers
from studies.validation.epa import OneDrivetrain, compare_cars, dynamometer_tests
from studies.validation.fitted import load_fitted
from studies.validation.i3_drivetrain import I3Drivetrain
from studies.validation.i3_pack import I3Pack, compare_pack
from studies.validation.i3_vehicle import I3Vehicle, compare_energy
from studies.validation.outcome import draw, figures_table


def run(session: Session) -> bool:
    """Run the study; returns whether all bars are met."""
    trips = excerpts.trips()
    drivetrain = load_fitted("bmw_i3_drivetrain", I3Drivetrain)
    outcomes = (
        compare_energy(trips, drivetrain, load_fitted("bmw_i3_vehicle", I3Vehicle)),
        compare_pack(trips, load_fitted("bmw_i3_pack", I3Pack)),
        compare_cell(excerpts.cell_tests(), load_fitted("panasonic_18650pf", PanasonicCell)),
        compare_cars(dynamometer_tests(), load_fitted("one_drivetrain", OneDrivetrain)),
        compare_drivers(excerpts.drives(), load_fitted("lead_vehicles", LeadBounds)),
    )
    if not session.short:
        for comparison in (each for outcome in outcomes for each in outcome.comparisons):
            draw(comparison, session.output / "pictures" / f"{comparison.key}.png")
    session.render(outcomes=[(outcome, figures_table(outcome)) for outcome in outcomes])
    return all(figure.is_met for outcome in outcomes for figure in outcome.figures if figure.bar)
