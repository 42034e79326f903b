"""What a saving is made of, in percentage points that add up to it.

The ageing is that of the paper, from the rows of both runs. With the law at the current of one run and the
temperatures of the other,

    throughput               fewer ampere-hours
    C-rate term              smoother current: what the law adds for high rates, at the other's temperatures
    temperature driving      the own temperatures at the other's current
    interaction              of current and temperature; and what the mean current of a row does not show
    ending                   both packs brought to one temperature, or the trip repeated

The energy per distance is divided into driving, cooling with auxiliaries, and the ending.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from iptm_core.aging_laws.judging import Exposure, loss_by_paper
from iptm_core.declaration import TextEnum
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.saved_share import saved_percent
from iptm_core.metrics.saving import Saving
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory


class Part(TextEnum):
    """A part of a saving."""

    THROUGHPUT = "throughput"
    C_RATE = "C-rate term"
    TEMPERATURE = "temperature while driving"
    INTERACTION = "interaction"
    DRIVING = "driving"
    COOLING = "cooling"
    ENDING = "ending"


def aging_parts(
    own: Trajectory, other: Trajectory, parameters: ModelParameters, saving: Saving
) -> Mapping[Part, float]:
    """Return the parts of what a run saves of the ageing by the paper's law.

    Args:
        parameters: of both vehicles.
        saving: against the other run.

    Raises:
        StateError: current or temperatures are not known throughout.
    """
    ours, theirs = Exposure.of(own), Exposure.of(other)
    throughput = saved_percent(
        *(float(np.sum(np.abs(np.diff(each.charge)))) for each in (ours, theirs))
    )
    base = loss_by_paper(parameters, theirs)
    current = saved_percent(loss_by_paper(parameters, ours.at(theirs)), base)
    temperature = saved_percent(loss_by_paper(parameters, theirs.at(ours)), base)
    as_driven = saving.aging.as_driven_percent
    return {
        Part.THROUGHPUT: throughput,
        Part.C_RATE: current - throughput,
        Part.TEMPERATURE: temperature,
        Part.INTERACTION: as_driven - current - temperature,
        Part.ENDING: saving.aging.stated_percent - as_driven,
    }


def energy_parts(own: RunMetrics, other: RunMetrics, saving: Saving) -> Mapping[Part, float]:
    """Return the parts of what a run saves of the battery energy per distance."""
    cooling, used = (
        [getattr(run, name) / run.distance_m if run.distance_m else np.nan for run in (own, other)]
        for name in ("cooling_energy_j", "battery_energy_j")
    )
    cooled = 100.0 * (cooling[1] - cooling[0]) / used[1] if used[1] else np.nan
    as_driven = saving.energy.as_driven_percent
    return {
        Part.DRIVING: as_driven - cooled,
        Part.COOLING: cooled,
        Part.ENDING: saving.energy.stated_percent - as_driven,
    }
