"""What the paper prints: the only place of the project that holds numbers of the paper's results.

Li et al., "Integrated Power and Thermal Management for Enhancing Energy Efficiency and Battery Life in
Connected and Automated Electric Vehicles". Relative changes are fractions: -0.05 is -5 %.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.metrics.figures import Figure
from iptm_reproduction import figures as fig
from iptm_reproduction.runs import STRATEGIES

PAPER = (
    "Dongjun Li, Qiuhao Hu, Weiran Jiang, Haoxuan Dong, Ziyou Song: Integrated Power and Thermal Management "
    "for Enhancing Energy Efficiency and Battery Life in Connected and Automated Electric Vehicles"
)


@dataclass(frozen=True)
class ParameterTable:
    """A printed table of parameters: key of this project's parameter, printed value, printed unit."""

    name: str
    title: str
    rows: tuple[tuple[str, float, str], ...]


PARAMETER_TABLES = (
    ParameterTable(
        "Table I",
        "Parameters and values of constraints",
        (
            ("limits.min_acceleration_m_s2", -2.0, "m/s^2"),
            ("limits.max_acceleration_m_s2", 2.0, "m/s^2"),
            ("limits.max_jerk_m_s3", 0.5, "m/s^3"),
            ("limits.min_compressor_power_w", 0.0, "W"),
            ("limits.max_compressor_power_w", 4500.0, "W"),
            ("limits.max_compressor_rate_w_s", 200.0, "W/s"),
            ("limits.min_speed_m_s", 0.0, "km/h"),
            ("limits.max_speed_m_s", 135.0, "km/h"),
            ("limits.min_temperature_k", 25.0, "degC"),
            ("limits.max_temperature_k", 40.0, "degC"),
        ),
    ),
    ParameterTable(
        "Table II",
        "Vehicle parameters and values",
        (
            ("body.mass_kg", 1432.0, "kg"),
            ("body.air_density_kg_m3", 1.026, "kg/m^3"),
            ("body.drag_coefficient", 0.3, "1"),
            ("body.frontal_area_m2", 2.22, "m^2"),
            ("body.gravity_m_s2", 9.8, "m/s^2"),
            ("body.rotational_inertia_factor", 1.022, "1"),
            ("body.rolling_resistance", 0.015, "1"),
            ("powertrain.wheel_radius_m", 0.28, "m"),
            ("powertrain.driveline_efficiency", 0.9, "1"),
            ("powertrain.motor_loss_w_per_nm2", 0.873, "W/(N m)^2"),
            ("powertrain.final_drive_ratio", 3.789, "1"),
            ("powertrain.regenerative_efficiency", 0.3, "1"),
            ("powertrain.transmission_ratio", 2.8, "1"),
            ("cell.heat_capacity_j_k", 45.0, "J/K"),
            ("cell.nominal_capacity_ah", 5.019, "Ah"),
            ("aging.initial_capacity_loss", 0.001, "1"),
            ("pack.open_circuit_voltage_v", 380.0, "V"),
            ("pack.modules", 16.0, "1"),
            ("pack.series_per_module", 6.0, "1"),
            ("pack.parallel", 38.0, "1"),
            ("aging.activation_energy_j_mol", 15162.0, "J/mol"),
            ("aging.pre_exponential_factor", 0.0032, "1/Ah^z"),
            ("aging.throughput_exponent", 0.824, "1"),
            ("aging.compensation_factor_j_mol", 1516.0, "J/mol"),
            ("cooling.convective_coefficient_w_k", 0.4901, "W/K"),
            ("cooling.auxiliary_power_w", 200.0, "W"),
            ("cooling.coolant_mass_flow_kg_s", 0.144, "kg/s"),
            ("cooling.coolant_specific_heat_j_kg_k", 3330.0, "J/(kg K)"),
        ),
    ),
)

FORMULATIONS: dict[str, tuple[str, tuple[int, ...]]] = {
    "reference": ("Reference", (1, 2)),
    "reference_energy": ("Ref + Energy", (1, 2, 3)),
    "reference_aging": ("Ref + Aging", (1, 2, 4)),
    "reference_energy_aging": ("Ref + Energy + Aging", (1, 2, 3, 4)),
    "energy_aging": ("Energy + Aging", (3, 4)),
    "aging": ("Aging", (4,)),
}
"""Table III: name of each strategy and the numbers of its cost terms J1 to J4."""

STRATEGY_VALUES: dict[Figure, tuple[float, ...]] = {
    fig.COOLING: (8049.01, 6925.07, 7903.57, 7549.34, 6165.48, 6492.42),
    fig.TRACTION: (179033.67, 172377.17, 178511.69, 175992.75, 169563.81, 166888.65),
    fig.TOTAL: (187082.68, 179302.24, 186415.26, 183542.09, 175729.29, 173381.07),
    fig.CELL_1: (1.2789, 1.2352, 1.2568, 1.2312, 1.2109, 1.1156),
    fig.CELL_N: (1.3718, 1.3164, 1.3469, 1.3171, 1.3035, 1.1803),
    fig.INCONSISTENCY: (9.29, 8.12, 9.01, 8.59, 8.45, 6.47),
}
"""Table IV: six strategies on a single horizon of 15 x 1 s, in the order of `STRATEGIES`."""

STRATEGY_CHANGES: dict[Figure, tuple[float, ...]] = {
    fig.COOLING: (-0.1396, -0.0181, -0.0621, -0.234, -0.1934),
    fig.TRACTION: (-0.0372, -0.0029, -0.017, -0.0529, -0.0678),
    fig.TOTAL: (-0.0416, -0.0036, -0.0189, -0.0607, -0.0732),
    fig.CELL_1: (-0.0342, -0.0173, -0.0373, -0.0468, -0.1277),
    fig.CELL_N: (-0.0404, -0.0182, -0.0399, -0.0498, -0.1396),
    fig.INCONSISTENCY: (-0.1259, -0.0301, -0.0753, -0.0904, -0.3036),
}
"""Table IV: changes against the reference, from the second strategy on, as printed with the values."""

STRATEGY_NOTE = (
    "One printed value contradicts its neighbours: for Energy + Aging, the degradation of cell 1 neither "
    "gives the change printed with it nor, with that of cell N, the inconsistency printed below; with its "
    "digits swapped (1.2190) it gives both."
)

HEADLINE_WHERE = "Abstract, Section IV-D.2, Conclusion"
HEADLINE_CHANGES: dict[Figure, float] = {
    fig.COMPUTING_TIME: -0.0718,
    fig.COOLING: -0.1422,
    fig.TRACTION: -0.0826,
    fig.TOTAL: -0.0852,
    fig.CELL_1: -0.2247,
    fig.CELL_N: -0.2342,
    fig.INCONSISTENCY: -0.3657,
}
"""Section IV-D.2, last paragraph: aging on 3 x 1 s + 5 x 5 s against the reference on 15 x 1 s."""

LENGTH_RANGES: dict[Figure, tuple[float, float]] = {
    fig.COOLING: (0.0635, 0.0826),
    fig.TRACTION: (-0.0276, -0.0158),
    fig.CELL_1: (-0.1313, -0.1112),
    fig.CELL_N: (-0.1284, -0.11),
    fig.INCONSISTENCY: (-0.0892, -0.0657),
}
"""Section IV-D.2: smallest and largest change of the multi-horizon runs against the single horizon."""

SMALLEST_MARGIN_M = 5.904
"""Section IV-B.2: smallest distance to the safe threshold of the gap under the proposed strategy."""

LARGEST_VICE_RATIO_J = 5e12
"""Section IV-C.1: largest lambda_Q / lambda_P of the vice benchmark, in joules (per fraction of capacity)."""

FIGURE_CAPTIONS = {
    "aging_map": ("Fig. 4", "Influences of current and temperature on degradation (10 A = 2C)."),
    "driving_cycle": (
        "Fig. 5",
        "Comprehensive driving cycle. L and S represent large and small road slope conditions.",
    ),
    "power_distribution": ("Fig. 6a", "Total power distributions."),
    "power_statistics": ("Fig. 6b", "Statistical power distributions."),
    "temperature_comparison": ("Fig. 7a", "Temperature changes of cell 1 and N_c."),
    "degradation_comparison": ("Fig. 7b", "Degradation changes of cell 1 and N_c."),
    "power_profiles": (
        "Fig. 8a",
        "Traction power and cooling power profiles under the proposed strategy.",
    ),
    "spacing": (
        "Fig. 8b",
        "Inter-vehicle spacing; the minimum spacing remains larger than the safe threshold.",
    ),
    "weighting": (
        "Fig. 9",
        "Sensitivity analysis on weighting parameters of conventional strategies.",
    ),
    "prediction_horizon": (
        "Fig. 10",
        "Sensitivity analysis on prediction horizon of the proposed strategy.",
    ),
    "horizon_temperatures": (
        "Fig. 11",
        (
            "Temperature changes of cell 1 and cell N_c under the proposed strategy with different "
            "prediction horizons."
        ),
    ),
    "sampling_time": (
        "Fig. 12",
        "Sensitivity analysis on long horizon sampling times of the proposed strategy.",
    ),
    "long_horizon": (
        "Fig. 13",
        "Sensitivity analysis on long horizon step of the proposed strategy.",
    ),
}
"""Figures of results by the key of the one that stands for it here; Figs. 1 to 3 draw the system."""


def printed_value(run: str, figure: Figure) -> float | None:
    """Return a figure of a run as Table IV prints it, None where it prints none."""
    if run not in STRATEGIES or figure not in STRATEGY_VALUES:
        return None
    return STRATEGY_VALUES[figure][STRATEGIES.index(run)]


def printed_change(run: str, figure: Figure) -> float:
    """Return the change of a figure against the reference as Table IV prints it."""
    return STRATEGY_CHANGES[figure][STRATEGIES.index(run) - 1]
