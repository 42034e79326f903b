"""The equations of `thermal_model` as functions of numbers: the loop, what it can do, and one interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from iptm_cabin.parameters import CabinParameters
from iptm_cabin.refrigerant_loop import LIMITS, LoopState
from iptm_cabin.thermal_model import INPUTS, STATES, WEATHER, CabinModel
from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import BufferedFunction, named_function

LOOP = (
    "power_w",
    "waste_w",
    "to_air_w",
    "latent_w",
    "fan_w",
    "speed_hz",
    "evaporation_c",
    "condensation_c",
    "beyond_k",
)
FLOWS = ("electric_w", "fans_w", "radiator_w", "coolant_in_k", "coolant_out_k")
_BISECTIONS = 24
Inputs = tuple[float, float, float, float]


@dataclass(frozen=True)
class LoopReading:
    """The loop under inputs, in W, 1/s and degC, the smallest of its margins, and which one that is."""

    power_w: float
    waste_w: float
    to_air_w: float
    latent_w: float
    fan_w: float
    speed_hz: float
    evaporation_c: float
    condensation_c: float
    beyond_k: float
    margin: float
    limit: str


class ThermalFunctions:
    """Buffered functions of a car; not meant to be shared between threads."""

    def __init__(self, cabin: CabinParameters, car: ModelParameters) -> None:
        self.model = CabinModel(cabin, car)
        states, inputs = ca.SX.sym("states", len(STATES)), ca.SX.sym("inputs", len(INPUTS))
        weather, held = ca.SX.sym("weather", len(WEATHER)), ca.SX.sym("waste")
        given = {"states": states, "inputs": inputs, "weather": weather}
        split: list[Any] = [ca.vertsplit(each) for each in given.values()]
        loop = self.model.loop(split[0], split[1], split[2])
        found = ca.vertcat(*(getattr(loop, name) for name in LOOP), *loop.margins)
        self._loop = BufferedFunction(named_function("loop", given, {"found": found}, cse=True))
        flows = self.model.flows(split[0], split[1], split[2])
        found = ca.vertcat(*(getattr(flows, name) for name in FLOWS))
        self._flows = BufferedFunction(named_function("flows", given, {"found": found}, cse=True))

        def rates(now: Any) -> Any:
            flows = self.model.flows(ca.vertsplit(now), split[1], split[2], 0.0, _held(loop, held))
            return ca.vertcat(*flows.rates)

        h = ca.SX.sym("length_s")
        k1 = rates(states)
        k2 = rates(states + 0.5 * h * k1)
        k3 = rates(states + 0.5 * h * k2)
        k4 = rates(states + h * k3)
        end = states + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        self._step = BufferedFunction(
            named_function("step", {**given, "waste": held, "length_s": h}, {"end": end}, cse=True)
        )

    def loop(
        self, states: tuple[float, ...], inputs: Inputs, weather: tuple[float, ...]
    ) -> LoopReading:
        """Return the loop at an instant."""
        _fill(self._loop, states, inputs, weather)
        self._loop()
        found = self._loop.results["found"].tolist()
        margins = found[len(LOOP) :]
        margin = min(margins)
        named = dict(zip(LOOP, found, strict=False))
        return LoopReading(**named, margin=margin, limit=LIMITS[margins.index(margin)])

    def flows(
        self, states: tuple[float, ...], inputs: Inputs, weather: tuple[float, ...]
    ) -> dict[str, float]:
        """Return FLOWS at an instant."""
        _fill(self._flows, states, inputs, weather)
        self._flows()
        return dict(zip(FLOWS, self._flows.results["found"].tolist(), strict=True))

    def advance(
        self,
        states: tuple[float, ...],
        inputs: Inputs,
        weather: tuple[float, ...],
        waste_w: float,
        length_s: float,
    ) -> tuple[float, ...]:
        """Return the states after an interval of at most some seconds with held inputs and weather.

        Args:
            waste_w: what the loop takes from the drive, held, too.
        """
        _fill(self._step, states, inputs, weather)
        self._step.arguments["waste"][0] = waste_w
        self._step.arguments["length_s"][0] = length_s
        self._step()
        return tuple(self._step.results["end"].tolist())

    def possible(
        self, states: tuple[float, ...], inputs: Inputs, weather: tuple[float, ...]
    ) -> Inputs:
        """Return inputs that the loop can do: the cabin is served first, as in cars, then the pack."""
        cabin_w, pack_w, ptc_w, radiator = inputs
        if self.loop(states, inputs, weather).margin >= 0.0:
            return cabin_w, pack_w, ptc_w, radiator

        def of_cabin(share: float) -> Inputs:
            return share * cabin_w, 0.0, ptc_w, radiator

        served_w = cabin_w * self._largest_share(of_cabin, states, weather)

        def of_pack(share: float) -> Inputs:
            return served_w, share * pack_w, ptc_w, radiator

        return of_pack(self._largest_share(of_pack, states, weather))

    def _largest_share(
        self,
        inputs_of: Callable[[float], Inputs],
        states: tuple[float, ...],
        weather: tuple[float, ...],
    ) -> float:
        low, high = 0.0, 1.0
        if self.loop(states, inputs_of(high), weather).margin >= 0.0:
            return high
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if self.loop(states, inputs_of(middle), weather).margin >= 0.0:
                low = middle
            else:
                high = middle
        return low


@lru_cache(maxsize=8)
def thermal_functions(cabin: CabinParameters, car: ModelParameters) -> ThermalFunctions:
    """Return the functions of a car, kept for the next trip with it."""
    return ThermalFunctions(cabin, car)


def _held(loop: LoopState, waste_w: ca.SX) -> LoopState:
    return replace(loop, waste_w=waste_w)


def _fill(
    function: BufferedFunction,
    states: tuple[float, ...],
    inputs: Inputs,
    weather: tuple[float, ...],
) -> None:
    function.arguments["states"][:] = states
    function.arguments["inputs"][:] = inputs
    function.arguments["weather"][:] = weather
