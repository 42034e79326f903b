"""The paper's equations (1) to (15) once more, in plain NumPy and without the suite's physics.

What stands in the suite but not in print (gate, brake hold at standstill, bounds of the chiller map) is
applied as the parameters and `integrate` say, so that a trip can be integrated again from its commands.
Parameters come from `iptm`, numbers only. Symbols are the paper's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

KELVIN = 273.15
STATES = [
    "position_m",
    "speed_m_s",
    "cell_1_temperature_k",
    "cell_n_temperature_k",
    "cell_1_capacity_loss",
    "cell_n_capacity_loss",
]
Array = NDArray[np.float64]


def loss_rate_1_s(current_a: Any, temperature_k: Any, loss: Any, p: Any) -> Any:
    """Eq. (12): capacity loss per second, as a fraction."""
    a = p.aging
    counted = np.where(current_a < 0.0, a.charging_rate_factor, 1.0)
    c_rate = counted * np.abs(current_a) / p.cell.nominal_capacity_ah
    z, gas = a.throughput_exponent, a.gas_constant_j_mol_k
    activation = (-a.activation_energy_j_mol + a.compensation_factor_j_mol * c_rate) / (
        z * gas * temperature_k
    )
    factor = z * a.pre_exponential_factor ** (1.0 / z) * loss ** (1.0 - 1.0 / z)
    return np.abs(current_a) / 3600.0 * factor * np.exp(activation)


def aging_map(p: Any) -> pd.DataFrame:
    """Fig. 4: capacity loss in an hour, a row per temperature in degC, a column per current in A up to 2C."""
    capacity, limits = p.cell.nominal_capacity_ah, p.limits
    currents = np.linspace(0.0, 2.0 * capacity, 41)
    celsius = np.linspace(limits.min_temperature_k, limits.max_temperature_k, 31) - KELVIN
    loss = p.aging.initial_capacity_loss
    rate = loss_rate_1_s(currents[None, :], celsius[:, None] + KELVIN, loss, p)
    return pd.DataFrame(3600.0 * rate, np.round(celsius, 6), currents)


def cell_resistance_ohm(temperature_k: Any, loss: Any, p: Any) -> Any:
    """Eq. (13), both effects in one product."""
    cell = p.cell
    warm = 1.0 + cell.resistance_temperature_coefficient_1_k * (
        temperature_k - cell.nominal_temperature_k
    )
    aged = cell.resistance_aging_factor * (1.0 - loss) ** -cell.resistance_aging_exponent
    return cell.nominal_resistance_ohm * warm * aged


def pack_current_a(power_w: Any, temperature_k: Any, resistance_ohm: Any, p: Any) -> Any:
    """Eq. (7): the smaller root of P_b = (E_b - T_b dV/dT) I_b - R_b I_b^2."""
    series = p.pack.modules * p.pack.series_per_module
    source = (
        p.pack.open_circuit_voltage_v - p.cell.entropic_coefficient_v_k * series * temperature_k
    )
    resistance = resistance_ohm * series / p.pack.parallel
    return (source - np.sqrt(source**2 - 4.0 * resistance * power_w)) / (2.0 * resistance)


def coolant_weights(p: Any, passed: float) -> tuple[float, float, float]:
    """Eq. (9) behind a number of cells on a line: weights of the inlet, of cell 1 and of cell N."""
    flow = (
        p.cooling.coolant_specific_heat_j_kg_k * p.cooling.coolant_mass_flow_kg_s / p.pack.modules
    )
    ratio = p.cooling.convective_coefficient_w_k / flow
    j = np.arange(1, passed + 1)
    weights = ratio * (1.0 - ratio) ** (passed - j)
    place = (j - 1) / (p.pack.cells_per_channel - 1)
    return (1.0 - ratio) ** passed, float(weights @ (1.0 - place)), float(weights @ place)


def rates(
    state: Array, a: float, power_w: float, slope: float, p: Any, *, hold: bool
) -> tuple[Array, dict[str, float]]:
    """Time derivatives of `STATES`, and powers: P_tra, P_b, Q_co and the heat of all cells."""
    _, v, t_1, t_n, q_1, q_n = state
    body, motor = p.body, p.powertrain
    weight = body.mass_kg * body.gravity_m_s2
    force = weight * (np.sin(slope) + body.rolling_resistance * np.cos(slope))
    force += 0.5 * body.drag_coefficient * body.frontal_area_m2 * body.air_density_kg_m3 * v * v
    force += body.mass_kg * body.rotational_inertia_factor * a
    ratio = motor.transmission_ratio * motor.final_drive_ratio / motor.wheel_radius_m
    torque = 0.0 if hold else force / (ratio * motor.driveline_efficiency ** np.sign(force))
    traction = ratio * v * torque + motor.motor_loss_w_per_nm2 * torque**2
    eta = p.pack.battery_efficiency
    share = traction / eta if traction >= 0.0 else eta * motor.regenerative_efficiency * traction
    battery = share + (power_w + p.cooling.auxiliary_power_w) / eta

    r_1, r_n = cell_resistance_ohm(t_1, q_1, p), cell_resistance_ohm(t_n, q_n, p)
    current = pack_current_a(battery, 0.5 * (t_1 + t_n), 0.5 * (r_1 + r_n), p) / p.pack.parallel

    c = p.chiller
    gate = 1.0 if c.gate_power_w == 0.0 else 1.0 - np.exp(-((power_w / c.gate_power_w) ** 2))
    used = min(power_w, -c.xi_1 / (2.0 * c.xi_2_1_w)) if c.xi_2_1_w < 0.0 else power_w
    air = c.air_flow_at_rest_kg_s + c.air_flow_per_speed_kg_s_per_km_h * 3.6 * v
    flow = p.cooling.coolant_mass_flow_kg_s
    offset = c.xi_1 * used + c.xi_2_1_w * used**2 + c.xi_6_w
    offset += c.xi_4_j_kg_k * (p.environment.ambient_temperature_k - KELVIN) * air
    per_kelvin = c.xi_3_w_k + c.xi_5_j_kg_k * flow
    # T_out = w_in T_in + cells and T_in = T_out - Q_co / C, with Q_co linear in T_out.
    w_in, w_1, w_n = coolant_weights(p, p.pack.cells_per_channel)
    heat_flow = flow * p.cooling.coolant_specific_heat_j_kg_k
    cells = w_1 * t_1 + w_n * t_n
    outlet = (cells - w_in / heat_flow * gate * (offset - per_kelvin * KELVIN)) / (
        1.0 - w_in + w_in / heat_flow * gate * per_kelvin
    )
    cooling = max(gate * (offset + per_kelvin * (outlet - KELVIN)), 0.0)
    outlet = (cells - w_in / heat_flow * cooling) / (1.0 - w_in)
    inlet = outlet - cooling / heat_flow
    u_in, u_1, u_n = coolant_weights(p, p.pack.cells_per_channel - 1)
    entropic = current * p.cell.entropic_coefficient_v_k
    heat_1, heat_n = current**2 * r_1 + entropic * t_1, current**2 * r_n + entropic * t_n
    h, capacity = p.cooling.convective_coefficient_w_k, p.cell.heat_capacity_j_k
    derivatives = np.array(
        [
            v,
            a,
            (heat_1 + h * (inlet - t_1)) / capacity,
            (heat_n + h * (u_in * inlet + u_1 * t_1 + u_n * t_n - t_n)) / capacity,
            loss_rate_1_s(current, t_1, q_1, p),
            loss_rate_1_s(current, t_n, q_n, p),
        ]
    )
    cells_in_all = p.pack.modules * p.pack.cells_per_channel
    heat = 0.5 * (heat_1 + heat_n) * cells_in_all
    return derivatives, {
        "traction_power_w": traction,
        "battery_power_w": battery,
        "chiller_heat_w": cooling,
        "battery_heat_w": heat,
    }


def integrate(
    frame: pd.DataFrame, p: Any, slope_at: Callable[[float], float] = lambda _: 0.0, steps: int = 20
) -> pd.DataFrame:
    """Drive a trip again from the commands of its rows, by classical Runge-Kutta steps.

    Row k of a run holds the commands and the mean powers of the interval that *ended* there. A vehicle that
    comes to a halt inside an interval stands for the rest of it, held by its brakes; one that did not
    accelerate and is at rest at the end of an interval stood all the time.

    Returns:
        `STATES` and mean powers of every row, indexed like the frame.
    """
    state = frame[STATES].iloc[0].to_numpy(dtype=float)
    rows = [dict(zip(STATES, state, strict=True))]
    times_s = frame.index.to_numpy()
    accelerations, powers = (
        frame[name].to_numpy() for name in ("acceleration_m_s2", "compressor_power_w")
    )
    halted = frame.speed_m_s.to_numpy() == 0.0
    for k in range(1, len(frame)):
        length, means = times_s[k] - times_s[k - 1], dict[str, float]()
        moving = length
        if halted[k]:
            moving = min(length, state[1] / -accelerations[k]) if accelerations[k] < 0.0 else 0.0
        for part, hold in ((moving, False), (length - moving, True)):
            if part <= 0.0:
                continue
            state[1] *= not hold
            a = 0.0 if hold else accelerations[k]
            for _ in range(steps):
                state, energies = _step(state, part / steps, a, powers[k], slope_at, p, hold=hold)
                for name, energy in energies.items():
                    means[name] = means.get(name, 0.0) + energy / length
        state[1] *= not halted[k]
        rows.append({**dict(zip(STATES, state, strict=True)), **means})
    return pd.DataFrame(rows, index=frame.index)


def _step(
    x: Array,
    length: float,
    a: float,
    power_w: float,
    slope_at: Callable[[float], float],
    p: Any,
    *,
    hold: bool,
) -> tuple[Array, dict[str, float]]:
    stages: list[Array] = []
    powers: list[dict[str, float]] = []
    for share, before in ((0.0, None), (0.5, 0), (0.5, 1), (1.0, 2)):
        at = x if before is None else x + share * length * stages[before]
        slope, power = rates(at, a, power_w, slope_at(at[0]), p, hold=hold)
        stages.append(slope)
        powers.append(power)
    weights = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
    moved = x + length * weights @ np.array(stages)
    return moved, {
        name: length * float(weights @ [each[name] for each in powers]) for name in powers[0]
    }
