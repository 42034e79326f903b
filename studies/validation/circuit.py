"""Equivalent circuits of a cell or a pack: voltage for a recorded current, temperature and charge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.physics.cell import (
    GAS_CONSTANT_J_MOL_K,
    ChargeTable,
    exponential_growth,
    heat_from_surroundings_w,
)
from iptm_core.physics.ops import Scalar, asinh, exp
from iptm_core.state import FloatArray

REFERENCE_K = 298.15
FARADAY_C_MOL = 96485.33212


@dataclass(frozen=True)
class ResistanceLaw:
    """Resistance over temperature and state of charge: an offset and an exponential.

    Attributes:
        offset_ohm: part that does not depend on temperature.
        exponential_ohm: part that does, at the reference temperature.
        coefficient_1_k: decrease of the logarithm of that part per kelvin.
    """

    offset_ohm: ChargeTable
    exponential_ohm: ChargeTable
    coefficient_1_k: float
    reference_k: float

    def ohm(self, temperature_k: Scalar, charge: Scalar) -> Scalar:
        """Return the resistance in ohm."""
        growth = exponential_growth(temperature_k, self.coefficient_1_k, self.reference_k)
        return self.offset_ohm.at(charge) + self.exponential_ohm.at(charge) * growth


@dataclass(frozen=True)
class ChargeTransfer:
    """Voltage loss of the electrode reaction (Butler-Volmer equation with equal transfer coefficients).

    Attributes:
        share: factor on the ideal ``2 R T / F``, over the state of charge.
        coefficient_1_k: increase of its logarithm per kelvin.
    """

    share: ChargeTable
    exchange_current_a: float
    coefficient_1_k: float
    reference_k: float

    def voltage_v(self, current_a: Scalar, temperature_k: Scalar, charge: Scalar) -> Scalar:
        """Return the loss in V with the sign of the current."""
        growth = exp(self.coefficient_1_k * (temperature_k - self.reference_k))
        thermal_v = 2.0 * GAS_CONSTANT_J_MOL_K * temperature_k / FARADAY_C_MOL
        ratio = current_a / (2.0 * self.exchange_current_a * growth)
        return self.share.at(charge) * thermal_v * asinh(ratio)


def ambient_temperature_rate_k_s(
    heat_w: Scalar,
    temperature_k: Scalar,
    ambient_k: Scalar,
    heat_capacity_j_k: float,
    exchange_w_k: float,
) -> Scalar:
    """Rate of the temperature of a cell or pack that exchanges heat with the air around it, in K/s."""
    taken_w = heat_from_surroundings_w(temperature_k, ambient_k, exchange_w_k)
    return (heat_w + taken_w) / heat_capacity_j_k


@dataclass(frozen=True, eq=False)
class Samples:
    """Recorded input of a circuit: one trip or test, arrays of shape (n,).

    Attributes:
        steps_s: time since the previous sample.
        current_a: current, positive when discharging.
        mean_current_a: mean current since the previous sample.
        voltage_v: measured voltage.
        temperature_k: temperature.
        charge: state of charge, 0 to 1.
    """

    steps_s: FloatArray
    current_a: FloatArray
    mean_current_a: FloatArray
    voltage_v: FloatArray
    temperature_k: FloatArray
    charge: FloatArray


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
