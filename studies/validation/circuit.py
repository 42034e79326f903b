"""Equivalent circuits of a cell or a pack, fitted to current and voltage by bounded linear least squares.

For given coefficients of temperature and time constants the voltage is linear in everything else:
increments of the open-circuit voltage, resistances and shares of charge transfer at their nodes, none of
them negative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from iptm.parts import ChargeTable, ChargeTransfer, FloatArray, ResistanceLaw

REFERENCE_K = 298.15
_ROUGHNESS = 1e-3


@dataclass(frozen=True, eq=False)
class Samples:
    """What a circuit is fitted to or tried on: one trip or test, arrays of shape (n,).

    Attributes:
        steps_s: time since the previous sample.
        current_a: current, positive when discharging.
        mean_current_a: mean current since the previous sample.
        voltage_v: measured voltage.
        temperature_k: temperature.
        charge: state of charge, 0 to 1.
        weights: weight of each sample in a fit.
    """

    steps_s: FloatArray
    current_a: FloatArray
    mean_current_a: FloatArray
    voltage_v: FloatArray
    temperature_k: FloatArray
    charge: FloatArray
    weights: FloatArray


@dataclass(frozen=True)
class Structure:
    """What is chosen before a fit.

    Attributes:
        ocv_charges: nodes of the open-circuit voltage.
        resistance_charges: nodes of the resistances.
        ohmic_coefficient_1_k: coefficient of the resistance that follows at once.
        relaxation_coefficient_1_k: coefficient of the resistances of the RC branches.
        time_constants_s: of the RC branches.
        transfer_charges: nodes of the charge transfer, empty without it.
        exchange_current_a: exchange current at 25 degC.
        exchange_coefficient_1_k: increase of its logarithm per kelvin.
        typical_ohm: size of the resistances, for the smoothing over the state of charge.
    """

    ocv_charges: tuple[float, ...]
    resistance_charges: tuple[float, ...]
    ohmic_coefficient_1_k: float
    relaxation_coefficient_1_k: float
    time_constants_s: tuple[float, ...]
    transfer_charges: tuple[float, ...]
    exchange_current_a: float
    exchange_coefficient_1_k: float
    typical_ohm: float


@dataclass(frozen=True)
class Circuit:
    """A fitted circuit.

    Attributes:
        open_circuit_v: open-circuit voltage over the state of charge.
        ohmic: resistance that follows the current at once.
        relaxations: resistances of the RC branches.
        time_constants_s: of the RC branches.
        transfer: charge transfer; its shares are zero without it.
    """

    open_circuit_v: ChargeTable
    ohmic: ResistanceLaw
    relaxations: tuple[ResistanceLaw, ...]
    time_constants_s: tuple[float, ...]
    transfer: ChargeTransfer

    def voltage_v(self, samples: Samples) -> FloatArray:
        """Return the terminal voltage for the recorded current, temperature and state of charge."""
        charge, temperature, current = samples.charge, samples.temperature_k, samples.current_a
        voltage = self.open_circuit_v.at(charge) - current * self.ohmic.ohm(temperature, charge)
        voltage = voltage - self.transfer.voltage_v(current, temperature, charge)
        for law, tau in zip(self.relaxations, self.time_constants_s, strict=True):
            voltage = voltage - law.ohm(temperature, charge) * branch_current_a(samples, tau)
        return np.asarray(voltage, dtype=np.float64)


def branch_current_a(samples: Samples, time_constant_s: float) -> FloatArray:
    """Return the current through the resistor of an RC branch that starts at rest."""
    kept = np.exp(-samples.steps_s / time_constant_s).tolist()
    value, values = 0.0, []
    for share, current in zip(kept, samples.mean_current_a.tolist(), strict=True):
        value = share * value + (1.0 - share) * current
        values.append(value)
    return np.array(values)


def hats(values: FloatArray, nodes: Sequence[float]) -> FloatArray:
    """Return the weights of the nodes in a linear interpolation, constant outside; shape (n, nodes)."""
    return np.column_stack([np.interp(values, nodes, row) for row in np.eye(len(nodes))])


def _design(samples: Samples, structure: Structure) -> FloatArray:
    """Return the derivatives of the voltage after the unknowns; shape (n, unknowns)."""
    ocv = hats(samples.charge, structure.ocv_charges)
    at = hats(samples.charge, structure.resistance_charges)
    kelvin = samples.temperature_k - REFERENCE_K
    current = samples.current_a[:, None]
    ohmic = np.exp(-structure.ohmic_coefficient_1_k * kelvin)[:, None]
    relaxing = np.exp(-structure.relaxation_coefficient_1_k * kelvin)[:, None]
    # Unknown is the increment from one node to the next, which keeps the open-circuit voltage monotone.
    blocks = [np.cumsum(ocv[:, ::-1], axis=1)[:, ::-1], -at * current, -at * ohmic * current]
    for tau in structure.time_constants_s:
        branch = branch_current_a(samples, tau)[:, None]
        blocks += [-at * branch, -at * relaxing * branch]
    if structure.transfer_charges:
        unit = _transfer(structure, (1.0,) * len(structure.transfer_charges))
        loss = unit.voltage_v(samples.current_a, samples.temperature_k, samples.charge)
        blocks.append(-hats(samples.charge, structure.transfer_charges) * loss[:, None])
    return np.hstack(blocks)


def _transfer(structure: Structure, shares: tuple[float, ...]) -> ChargeTransfer:
    charges = structure.transfer_charges or (0.0, 1.0)
    table = ChargeTable(charges, shares or (0.0, 0.0))
    exchange = structure.exchange_current_a
    return ChargeTransfer(table, exchange, structure.exchange_coefficient_1_k, REFERENCE_K)


def _roughness(structure: Structure) -> FloatArray:
    """Return second differences over the nodes of each resistance and of the charge transfer."""
    nodes = [structure.resistance_charges] * (2 + 2 * len(structure.time_constants_s))
    sizes = [structure.typical_ohm] * len(nodes)
    if structure.transfer_charges:
        nodes.append(structure.transfer_charges)
        sizes.append(0.5)
    start = len(structure.ocv_charges)
    total = start + sum(len(block) for block in nodes)
    rows = []
    for block, size in zip(nodes, sizes, strict=True):
        widths = np.diff(block)
        for i in range(1, len(block) - 1):
            row = np.zeros(total)
            before, after = 1.0 / widths[i - 1], 1.0 / widths[i]
            row[start + i - 1 : start + i + 2] = np.array([before, -before - after, after]) / size
            rows.append(0.1 * row)
        start += len(block)
    return np.array(rows)


def fit_circuit(samples: Sequence[Samples], structure: Structure, every: int = 1) -> Circuit:
    """Fit a circuit, each trip or test with the same weight apart from ``weights``.

    Args:
        samples: trips or tests.
        structure: nodes, coefficients and time constants.
        every: stride of the samples that are used.
    """
    normal: FloatArray = np.zeros(1)
    right: FloatArray = np.zeros(1)
    for case in samples:
        design = _design(case, structure)[::every]
        weights = (case.weights[::every] / len(design))[:, None]
        normal = normal + (design * weights).T @ design
        right = right + (design * weights).T @ case.voltage_v[::every]
    rough = _roughness(structure)
    normal = normal + _ROUGHNESS * 1e-4 * len(samples) * rough.T @ rough
    size = len(normal)
    root = np.linalg.cholesky(normal + 1e-10 * np.trace(normal) / size * np.eye(size))
    found = lsq_linear(root.T, np.linalg.solve(root, right), bounds=(0.0, np.inf)).x
    return _circuit(found, structure)


def _circuit(found: FloatArray, structure: Structure) -> Circuit:
    values = found.tolist()

    def take(count: int) -> tuple[float, ...]:
        taken = tuple(float(value) for value in values[:count])
        del values[:count]
        return taken

    ocv = tuple(float(v) for v in np.cumsum(take(len(structure.ocv_charges))))
    nodes = structure.resistance_charges

    def law(coefficient_1_k: float) -> ResistanceLaw:
        offset, exponential = take(len(nodes)), take(len(nodes))
        tables = ChargeTable(nodes, offset), ChargeTable(nodes, exponential)
        return ResistanceLaw(*tables, coefficient_1_k, REFERENCE_K)

    ohmic = law(structure.ohmic_coefficient_1_k)
    relaxations = tuple(
        law(structure.relaxation_coefficient_1_k) for _ in structure.time_constants_s
    )
    shares = take(len(structure.transfer_charges))
    return Circuit(
        open_circuit_v=ChargeTable(structure.ocv_charges, ocv),
        ohmic=ohmic,
        relaxations=relaxations,
        time_constants_s=structure.time_constants_s,
        transfer=_transfer(structure, shares),
    )
