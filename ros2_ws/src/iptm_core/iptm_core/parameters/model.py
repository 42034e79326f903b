"""Every number of the model, grouped by effect, with unit and permitted range.

The ranges are physical plausibility bounds, wide enough for another vehicle or cell; the values and
their sources live in the YAML files of ``sets/``. Symbols in brackets are the paper's.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar

from iptm_core.declaration import count, has_effect, quantity


@dataclass(frozen=True)
class BodyParameters:
    """Vehicle body and rolling gear (paper Table II, body)."""

    mass_kg: float = quantity("m", "kg", 100.0, 60000.0)
    gravity_m_s2: float = quantity("g", "m/s^2", 9.0, 10.0)
    rolling_resistance: float = quantity("f", "1", 0.0, 0.1)
    drag_coefficient: float = quantity("C_D", "1", 0.0, 2.0)
    frontal_area_m2: float = quantity("A", "m^2", 0.1, 15.0)
    air_density_kg_m3: float = quantity("rho", "kg/m^3", 0.5, 1.6)
    rotational_inertia_factor: float = quantity("delta", "1", 1.0, 1.5)


@dataclass(frozen=True)
class PowertrainParameters:
    """Motor and driveline (paper Table II, powertrain)."""

    wheel_radius_m: float = quantity("r_w", "m", 0.1, 1.0)
    transmission_ratio: float = quantity("i_g", "1", 0.2, 20.0)
    final_drive_ratio: float = quantity("i_0", "1", 0.5, 20.0)
    driveline_efficiency: float = quantity("eta_t", "1", 0.5, 1.0)
    motor_loss_w_per_nm2: float = quantity("sigma", "W/(N m)^2", 0.0, 20.0)
    regenerative_efficiency: float = quantity("zeta", "1", 0.0, 1.0)
    drag_loss_w_s2_rad2: float = quantity("c_2", "W s^2/rad^2", 0.0, 1.0, neutral=0.0)


@dataclass(frozen=True)
class RegenerationParameters:
    """Limits within which the motor brakes, the friction brakes supply the rest; no torque: no limits."""

    torque_nm: float = quantity("T_reg", "N m", 0.0, 10000.0, neutral=0.0)
    power_w: float = quantity("P_reg", "W", 1.0, 1e6, neutral=1e6)
    blend_start_m_s: float = quantity("v_0", "m/s", 0.0, 20.0, neutral=0.0)
    blend_end_m_s: float = quantity("v_1", "m/s", 0.01, 30.0, neutral=0.01)
    deceleration_m_s2: float = quantity("b_0", "m/s^2", 0.0, 12.0, neutral=12.0)
    decline_s2_m: float = quantity("k_b", "s^2/m", 0.0, 10.0, neutral=0.0)

    @property
    def limited(self) -> bool:
        """Whether regeneration is limited."""
        return has_effect(self.torque_nm)


@dataclass(frozen=True)
class PackParameters:
    """Pack layout and terminal data (paper Table II, battery)."""

    modules: int = count("N_m", 1, 1000)
    series_per_module: int = count("N_ms", 1, 1000)
    parallel: int = count("N_mp", 1, 1000)
    cells_per_channel: int = count("N_c", 2, 10000)
    open_circuit_voltage_v: float = quantity("E_b", "V", 10.0, 2000.0)
    battery_efficiency: float = quantity("eta_b", "1", 0.5, 1.0)

    @property
    def cells_in_series(self) -> int:
        """Cells between the pack terminals, N_m N_ms."""
        return self.modules * self.series_per_module

    @property
    def cells(self) -> int:
        """All cells of the pack."""
        return self.cells_in_series * self.parallel


@dataclass(frozen=True)
class CellParameters:
    """Electrical and thermal data of one cell; (13) couples its resistance to state."""

    heat_capacity_j_k: float = quantity("C_c", "J/K", 1.0, 10000.0)
    nominal_capacity_ah: float = quantity("Q_nom", "Ah", 0.1, 500.0)
    nominal_resistance_ohm: float = quantity("R_bc,0", "ohm", 1e-5, 1.0)
    nominal_temperature_k: float = quantity("T_bc,0", "K", 233.15, 333.15)
    resistance_temperature_coefficient_1_k: float = quantity("kappa", "1/K", -0.03, 0.03)
    resistance_aging_factor: float = quantity("mu", "1", 0.5, 5.0)
    resistance_aging_exponent: float = quantity("lambda", "1", 0.0, 10.0)
    entropic_coefficient_v_k: float = quantity("dV_bc/dT", "V/K", -0.005, 0.005)
    resistance_exponent_1_k: float = quantity("k_R", "1/K", 0.0, 0.2, neutral=0.0)
    resistance_offset_share: float = quantity("r_0", "1", 0.0, 0.99, neutral=0.0)


def _share(charge_percent: int) -> Any:
    return quantity(f"E_b({charge_percent} %)/E_b", "1", 0.3, 1.5, neutral=1.0)


@dataclass(frozen=True)
class ChargeParameters:
    """State of charge, and what of the pack depends on it; shares of one are the paper's constant voltage.

    The shares refer to the open-circuit voltage at every tenth of the charge, linear between.
    """

    initial_charge: float = quantity("s_ini", "1", 0.0, 1.0, neutral=0.9)
    min_charge: float = quantity("s_min", "1", 0.0, 1.0, neutral=0.1)
    resistance_slope: float = quantity("k_s", "1", -1.9, 1.9, neutral=0.0)
    voltage_share_0: float = _share(0)
    voltage_share_10: float = _share(10)
    voltage_share_20: float = _share(20)
    voltage_share_30: float = _share(30)
    voltage_share_40: float = _share(40)
    voltage_share_50: float = _share(50)
    voltage_share_60: float = _share(60)
    voltage_share_70: float = _share(70)
    voltage_share_80: float = _share(80)
    voltage_share_90: float = _share(90)
    voltage_share_100: float = _share(100)

    @property
    def voltage_shares(self) -> tuple[float, ...]:
        """Shares of the open-circuit voltage from empty to full."""
        return tuple(getattr(self, f"voltage_share_{percent}") for percent in range(0, 101, 10))


def _rate(symbol: str, celsius: int) -> Any:
    return quantity(f"{symbol}({celsius} degC)", "1/h", 0.0, 1000.0, neutral=1000.0)


def _current_share(symbol: str, charge_percent: int) -> Any:
    return quantity(f"{symbol}({charge_percent} %)", "1", 0.0, 1.0, neutral=1.0)


@dataclass(frozen=True)
class PackLimitParameters:
    """Limits of cell voltage, and of currents: rates over temperature times shares over the charge.

    Rates are currents over the nominal capacity, linear between -20 and 45 degC and constant outside. The
    share of the charging current is 1 up to 70 % charge, the one of the discharging current from 30 % on.
    """

    NODES_C: ClassVar[tuple[float, ...]] = (-20.0, -10.0, 0.0, 5.0, 10.0, 45.0)
    """Temperatures of the rates in degC."""

    min_cell_voltage_v: float = quantity("V_min", "V", 0.0, 10.0, neutral=0.0)
    max_cell_voltage_v: float = quantity("V_max", "V", 0.0, 20.0, neutral=20.0)
    charge_rate_minus_20_1_h: float = _rate("c_ch", -20)
    charge_rate_minus_10_1_h: float = _rate("c_ch", -10)
    charge_rate_0_1_h: float = _rate("c_ch", 0)
    charge_rate_5_1_h: float = _rate("c_ch", 5)
    charge_rate_10_1_h: float = _rate("c_ch", 10)
    charge_rate_45_1_h: float = _rate("c_ch", 45)
    discharge_rate_minus_20_1_h: float = _rate("c_dis", -20)
    discharge_rate_minus_10_1_h: float = _rate("c_dis", -10)
    discharge_rate_0_1_h: float = _rate("c_dis", 0)
    discharge_rate_5_1_h: float = _rate("c_dis", 5)
    discharge_rate_10_1_h: float = _rate("c_dis", 10)
    discharge_rate_45_1_h: float = _rate("c_dis", 45)
    charge_share_80: float = _current_share("w_ch", 80)
    charge_share_90: float = _current_share("w_ch", 90)
    charge_share_100: float = _current_share("w_ch", 100)
    discharge_share_0: float = _current_share("w_dis", 0)
    discharge_share_10: float = _current_share("w_dis", 10)
    discharge_share_20: float = _current_share("w_dis", 20)

    @property
    def charge_rates_1_h(self) -> tuple[float, ...]:
        """Largest charging currents over the nominal capacity at `NODES_C`."""
        return self._rates("charge")

    @property
    def discharge_rates_1_h(self) -> tuple[float, ...]:
        """Largest discharging currents over the nominal capacity at `NODES_C`."""
        return self._rates("discharge")

    @property
    def charge_shares(self) -> tuple[float, ...]:
        """Shares of the charging current at 80, 90 and 100 % charge."""
        return self.charge_share_80, self.charge_share_90, self.charge_share_100

    @property
    def discharge_shares(self) -> tuple[float, ...]:
        """Shares of the discharging current at 0, 10 and 20 % charge."""
        return self.discharge_share_0, self.discharge_share_10, self.discharge_share_20

    @property
    def limited(self) -> bool:
        """Whether anything but full and empty limits the pack."""
        usual = PackLimitParameters()
        values = ((getattr(self, each.name), getattr(usual, each.name)) for each in fields(self))
        return any(has_effect(*pair) for pair in values)

    def _rates(self, direction: str) -> tuple[float, ...]:
        names = ("minus_20", "minus_10", "0", "5", "10", "45")
        return tuple(getattr(self, f"{direction}_rate_{name}_1_h") for name in names)


@dataclass(frozen=True)
class AgingParameters:
    """Semi-empirical capacity loss (11), (12).

    A charging rate counts in the exponent with its magnitude times ``charging_rate_factor``: with 1 charging
    ages like discharging, -1 is the signed rate as printed.
    """

    pre_exponential_factor: float = quantity("A", "1/Ah^z", 1e-9, 1e9)
    activation_energy_j_mol: float = quantity("E_a", "J/mol", 0.0, 200000.0)
    compensation_factor_j_mol: float = quantity("B", "J/mol", 0.0, 20000.0)
    throughput_exponent: float = quantity("z", "1", 0.1, 2.0)
    gas_constant_j_mol_k: float = quantity("R", "J/(mol K)", 8.31, 8.32)
    initial_capacity_loss: float = quantity("Q_loss,ini", "1", 1e-6, 0.5)
    charging_rate_factor: float = quantity("k_C", "1", -1.0, 1.0, neutral=1.0)


@dataclass(frozen=True)
class CoolingParameters:
    """Coolant loop and auxiliaries (paper Table II, BTMS)."""

    convective_coefficient_w_k: float = quantity("h", "W/K", 0.001, 100.0)
    coolant_mass_flow_kg_s: float = quantity("m_c", "kg/s", 0.001, 10.0)
    coolant_specific_heat_j_kg_k: float = quantity("C_p", "J/(kg K)", 500.0, 6000.0)
    auxiliary_power_w: float = quantity("P_aux", "W", 0.0, 10000.0)
    air_exchange_w_k: float = quantity("G_a", "W/K", 0.0, 1000.0, neutral=0.0)
    heater_performance: float = quantity("COP_h", "1", 0.5, 6.0, neutral=1.0)
    radiator_w_k: float = quantity("G_r", "W/K", 0.0, 5000.0, neutral=0.0)
    radiator_fan_power_w: float = quantity("P_r", "W", 1.0, 2000.0, neutral=100.0)


@dataclass(frozen=True)
class ChillerParameters:
    """Fitted chiller map (14) at one ambient temperature; temperatures in it are degrees Celsius.

    A gate of 0 is none: the map as printed, which cools with the compressor off.
    """

    xi_1: float = quantity("xi_1", "1", -100.0, 100.0)
    xi_2_1_w: float = quantity("xi_2", "1/W", -1.0, 1.0)
    xi_3_w_k: float = quantity("xi_3", "W/K", -1e6, 1e6)
    xi_4_j_kg_k: float = quantity("xi_4", "J/(kg K)", -1e6, 1e6)
    xi_5_j_kg_k: float = quantity("xi_5", "J/(kg K)", -1e6, 1e6)
    xi_6_w: float = quantity("xi_6", "W", -1e6, 1e6)
    gate_power_w: float = quantity("P_gate", "W", 0.0, 5000.0)
    air_flow_at_rest_kg_s: float = quantity("m_a,0", "kg/s", 0.0, 10.0)
    air_flow_per_speed_kg_s_per_km_h: float = quantity("m_a,v", "kg/s/(km/h)", 0.0, 1.0)


@dataclass(frozen=True)
class EnvironmentParameters:
    """Ambient air and initial temperatures."""

    ambient_temperature_k: float = quantity("T_a", "K", 233.15, 333.15)
    initial_cell_temperature_k: float = quantity("T_init", "K", 253.15, 333.15)


@dataclass(frozen=True)
class LimitParameters:
    """Bounds and rates of the paper's Table I, and the largest power of a heater, 0 for none."""

    min_acceleration_m_s2: float = quantity("a_min", "m/s^2", -12.0, -0.1)
    max_acceleration_m_s2: float = quantity("a_max", "m/s^2", 0.1, 12.0)
    max_jerk_m_s3: float = quantity("Delta a_max / Delta t", "m/s^3", 0.01, 50.0)
    min_compressor_power_w: float = quantity("P_cp,min", "W", 0.0, 20000.0)
    max_compressor_power_w: float = quantity("P_cp,max", "W", 1.0, 50000.0)
    max_compressor_rate_w_s: float = quantity("Delta P_cp,max / Delta t", "W/s", 1.0, 50000.0)
    min_speed_m_s: float = quantity("v_min", "m/s", 0.0, 10.0)
    max_speed_m_s: float = quantity("v_max", "m/s", 1.0, 100.0)
    min_temperature_k: float = quantity("T_b,min", "K", 253.15, 333.15)
    max_temperature_k: float = quantity("T_b,max", "K", 263.15, 353.15)
    max_heater_power_w: float = quantity("P_h,max", "W", 0.0, 20000.0, neutral=0.0)

    @property
    def lowest_thermal_power_w(self) -> float:
        """Lower bound of the thermal actuator: full heating, with a heater, or the least compressor power."""
        heater_w = self.max_heater_power_w
        return -heater_w if has_effect(heater_w) else self.min_compressor_power_w


@dataclass(frozen=True)
class BrakeParameters:
    """Service brakes of the vehicle; ordinary commands keep to the comfort limits of `LimitParameters`."""

    max_deceleration_m_s2: float = quantity("b_max", "m/s^2", 0.5, 12.0)
    build_up_m_s3: float = quantity("db/dt", "m/s^3", 0.5, 100.0)
    delay_s: float = quantity("t_b", "s", 0.0, 2.0)
    regenerative_deceleration_m_s2: float = quantity("b_reg", "m/s^2", 0.0, 12.0)


@dataclass(frozen=True)
class GapParameters:
    """Car-following limits: intelligent driver model below, traffic efficiency above.

    A largest or desired time headway of 0 switches it off; see `desired_gap_m`.
    """

    standstill_gap_m: float = quantity("s_st", "m", 0.0, 50.0)
    time_headway_s: float = quantity("T_h", "s", 0.1, 10.0)
    max_gap_m: float = quantity("s_max", "m", 20.0, 1000.0)
    initial_gap_m: float = quantity("s_init", "m", 1.0, 500.0)
    max_time_headway_s: float = quantity("T_max", "s", 0.0, 100.0, neutral=0.0)
    desired_time_headway_s: float = quantity("T_d", "s", 0.0, 10.0, neutral=0.0)


@dataclass(frozen=True)
class ModelParameters:
    """Everything that the model, the constraints and the start of a run depend on."""

    body: BodyParameters
    powertrain: PowertrainParameters
    regeneration: RegenerationParameters
    pack: PackParameters
    cell: CellParameters
    charge: ChargeParameters
    pack_limits: PackLimitParameters
    aging: AgingParameters
    cooling: CoolingParameters
    chiller: ChillerParameters
    environment: EnvironmentParameters
    limits: LimitParameters
    brakes: BrakeParameters
    gap: GapParameters

    @property
    def pack_heat_capacity_j_k(self) -> float:
        """Heat capacity of all cells together."""
        return self.pack.cells * self.cell.heat_capacity_j_k
