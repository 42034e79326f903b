"""Energy rows of the paper's results table."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.metrics.time_integrals import integral_of_interval_means
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class EnergyMetrics:
    """Energies of a run in joules.

    Attributes:
        cooling_j: integral of P_cp + P_aux.
        traction_j: integral of P_tra, recuperation counted negative.
        total_printed_j: traction + cooling, which is what the six totals printed in the paper are.
        battery_j: integral of P_b, which is how the paper labels that row.
        mean_battery_power_w: mean of P_b over time.
        peak_battery_power_w: largest P_b of an interval.
        lowest_battery_power_w: smallest P_b of an interval, negative when recuperating.
        mean_cop: heat taken from the coolant per compressor energy over the whole run; None if the
            compressor never ran.
    """

    cooling_j: float
    traction_j: float
    total_printed_j: float
    battery_j: float
    mean_battery_power_w: float
    peak_battery_power_w: float
    lowest_battery_power_w: float
    mean_cop: float | None


def energy_metrics(trajectory: Trajectory) -> EnergyMetrics:
    """Integrate the powers of a run.

    Args:
        trajectory: the run, at least two rows.

    Returns:
        Its energies.
    """
    compressor = integral_of_interval_means(trajectory, trajectory.compressor_power_w)
    auxiliary = integral_of_interval_means(trajectory, trajectory.auxiliary_power_w)
    traction = integral_of_interval_means(trajectory, trajectory.traction_power_w)
    battery = integral_of_interval_means(trajectory, trajectory.battery_power_w)
    heat = integral_of_interval_means(trajectory, trajectory.chiller_heat_w)
    return EnergyMetrics(
        cooling_j=compressor + auxiliary,
        traction_j=traction,
        total_printed_j=traction + compressor + auxiliary,
        battery_j=battery,
        mean_battery_power_w=battery / float(trajectory.time_s[-1] - trajectory.time_s[0]),
        peak_battery_power_w=float(trajectory.battery_power_w[1:].max()),
        lowest_battery_power_w=float(trajectory.battery_power_w[1:].min()),
        mean_cop=heat / compressor if compressor > 0.0 else None,
    )
