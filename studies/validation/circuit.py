"""Equivalent circuits of a cell or a pack: voltage for a recorded current, temperature and charge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.physics.cell import ChargeTable, ChargeTransfer, ResistanceLaw
from iptm_core.state import FloatArray

REFERENCE_K = 298.15


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
