"""One compressor for cabin and pack: what heat and cold cost at an instant, in closed form.

Two evaporators (cabin, chiller of the pack's coolant), two condensers (heater core, the same coolant) and the
outside heat exchanger, which is either. The lowest active temperature of evaporation counts for all
evaporators (one suction pressure; a pressure regulator keeps the cabin's above it), and the highest of
condensation. With the heat C into the evaporators of cabin and chiller and H out of the condensers, the
compressor draws

    P = max(C / COP, H / (COP + eta)),

evaporators take up COP P in all and condensers give off (COP + eta) P; the outside heat exchanger has the
difference. The temperatures of evaporation and condensation belong to nominal flows, so that no equation
has to be solved, and the balance of heat closes whatever they are.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_cabin.cycle_map import BOUNDS, CycleMap, cycle_map
from iptm_cabin.parameters import CabinParameters
from iptm_core.physics.ops import Scalar, exp, maximum, minimum
from iptm_core.units import CELSIUS_ZERO_K

SHELL_EFFICIENCY = 0.95
"""Share of the electric power that the refrigerant takes up (eta); the rest leaves through the shell."""
APPROACH_K = 3.0
ACTIVE_W = 80.0
"""Load beyond which a heat exchanger sets a pressure."""
_ASIDE_K = 60.0
_BLEND_K = 1.0
_NOMINAL_FROM_AIR = 0.65
_NOMINAL_TO_AIR = 1.33
_SENSIBLE_W = 200.0
_COIL_C = 8.0
COLDEST_AIR_C = -20.0
LATENT_J_KG = 2.45e6
AIR_J_KG_K = 1006.0
LEAST_EVAPORATOR_C = -1.0
OF_COMPRESSOR = ("the compressor's power limits the loop", "the compressor's speed limits the loop")
LIMITS = (
    *OF_COMPRESSOR,
    "frost on the cabin's evaporator limits the loop",
    "frost on the outside heat exchanger limits the loop",
    "the highest pressure limits the loop",
)
"""Reports of what limits the loop, in the order of `LoopState.margins`."""


@dataclass(frozen=True)
class Surroundings:
    """Temperatures in K around the loop, and the motion of the car in m/s."""

    air_k: Scalar
    cabin_k: Scalar
    core_k: Scalar
    pack_k: Scalar
    drive_k: Scalar
    speed_m_s: Scalar


@dataclass(frozen=True)
class LoopState:
    """The loop at an instant; powers in W.

    Attributes:
        power_w: electric power of the compressor.
        evaporated_w: heat into all evaporators.
        condensed_w: heat out of all condensers.
        shell_w: loss of the compressor to the air.
        latent_w: heat of water that condenses on the cabin's evaporator.
        waste_w: heat taken from the drive.
        to_air_w: heat given to the air by the outside heat exchanger, negative where it is taken.
        fan_w: power of its fan.
        speed_hz: speed of the compressor.
        beyond_k: how far evaporation or condensation lie outside of the map, which is held at its bounds.
        margins: reserves before LIMITS, as shares; not negative where the loop can do it.
    """

    power_w: Scalar
    evaporated_w: Scalar
    condensed_w: Scalar
    shell_w: Scalar
    latent_w: Scalar
    waste_w: Scalar
    to_air_w: Scalar
    fan_w: Scalar
    evaporation_c: Scalar
    condensation_c: Scalar
    speed_hz: Scalar
    beyond_k: Scalar
    margins: tuple[Scalar, ...]


def solve_loop(
    cabin_w: Scalar,
    pack_w: Scalar,
    around: Surroundings,
    parameters: CabinParameters,
    smoothing_w: float = 0.0,
    fluid: CycleMap | None = None,
) -> LoopState:
    """Return the loop that heats the cabin (its core) and the pack by these powers, cools where negative.

    Args:
        smoothing_w: width of the sign changes; 0 is exact.
        fluid: map of the refrigerant, by default the parameters'.
    """
    fluid = fluid or cycle_map(parameters.refrigerant)
    values, width = parameters, smoothing_w
    heat_cabin, heat_pack = maximum(cabin_w, 0.0, width), maximum(pack_w, 0.0, width)
    cool_cabin, cool_pack = maximum(-cabin_w, 0.0, width), maximum(-pack_w, 0.0, width)
    air_c, cabin_c, core_c, pack_c = (
        each - CELSIUS_ZERO_K
        for each in (around.air_k, around.cabin_k, around.core_k, around.pack_k)
    )
    mixed_c = values.fresh_share * air_c + (1.0 - values.fresh_share) * cabin_c
    latent = latent_w(air_c, values) * cool_cabin / (cool_cabin + _SENSIBLE_W)
    cool_cabin = cool_cabin + latent
    heat, cold = heat_cabin + heat_pack, cool_cabin + cool_pack

    outside_w_k = values.outside_w_k + values.outside_j_k_m * around.speed_m_s
    needed = maximum(_NOMINAL_FROM_AIR * heat - cold, 0.0, width)
    warm_k = maximum(around.drive_k - around.air_k, 0.0, _BLEND_K)
    offered = values.waste_w_k * warm_k * heat / (heat + _SENSIBLE_W)
    waste = needed * offered / (needed + offered + ACTIVE_W)
    from_air = needed - waste
    to_air = maximum(_NOMINAL_TO_AIR * cold - heat, 0.0, width)

    lift_k = from_air / outside_w_k
    coil_c = mixed_c - APPROACH_K - cool_cabin / values.evaporator_w_k
    sources = (
        (coil_c, cool_cabin),
        (pack_c - APPROACH_K - cool_pack / values.chiller_w_k, cool_pack),
        (air_c - APPROACH_K - lift_k, from_air),
    )
    sinks = (
        (core_c + APPROACH_K + heat_cabin / values.condenser_w_k, heat_cabin),
        (pack_c + APPROACH_K + heat_pack / values.chiller_w_k, heat_pack),
        (air_c + APPROACH_K + to_air / outside_w_k, to_air),
    )
    evaporation = -_highest([(-each, load) for each, load in sources])
    condensation = _highest(list(sinks))
    (coldest_c, warmest_c), (coolest_c, hottest_c), _ = BOUNDS[fluid.fluid]
    pressure_k = hottest_c - condensation
    beyond_k = maximum(maximum(coldest_c - evaporation, evaporation - warmest_c), 0.0)
    beyond_k = maximum(beyond_k, coolest_c - condensation)
    evaporation, condensation, fastest = fluid.within(
        evaporation, condensation, values.max_speed_hz
    )
    full_w = (
        fluid.capacity_j_m3(evaporation, condensation, fastest)
        * values.displacement_cm3
        * 1e-6
        * values.max_speed_hz
    )
    share = maximum(cold, _NOMINAL_FROM_AIR * heat, 2.0 * width) / full_w
    *_, speed = fluid.within(evaporation, condensation, values.max_speed_hz * share)
    cop = fluid.performance(evaporation, condensation, speed)
    power = maximum(cold / cop, heat / (cop + SHELL_EFFICIENCY), 0.2 * width)
    evaporated = cop * power
    condensed = evaporated + SHELL_EFFICIENCY * power
    rejected = condensed - heat - (evaporated - cold - waste)

    aside = _ASIDE_K * _idle(cool_cabin)
    evaporator_c = coil_c if values.has_regulator else evaporation
    frost_k = minimum(values.frost_lift_k, air_c - COLDEST_AIR_C + 0.5, _BLEND_K)
    return LoopState(
        power_w=power,
        evaporated_w=evaporated,
        condensed_w=condensed,
        shell_w=(1.0 - SHELL_EFFICIENCY) * power,
        latent_w=latent,
        waste_w=waste,
        to_air_w=rejected,
        fan_w=values.outside_fan_w
        * exp(-around.speed_m_s / 8.0)
        * (from_air + to_air)
        / (from_air + to_air + 3000.0),
        evaporation_c=evaporation,
        condensation_c=condensation,
        speed_hz=speed,
        beyond_k=beyond_k,
        margins=(
            1.0 - power / max(values.max_compressor_power_w, 1.0),
            1.0 - share,
            (evaporator_c + aside - LEAST_EVAPORATOR_C) / 10.0,
            (frost_k - lift_k) / 10.0,
            pressure_k / 10.0,
        ),
    )


def latent_w(air_c: Scalar, parameters: CabinParameters) -> Scalar:
    """Return the heat of the water in fresh air that condenses on a coil of 8 degC, in W."""
    wet = parameters.humidity * _water(air_c) - _water(_COIL_C)
    flow = parameters.fresh_share * parameters.blown_air_kg_s
    return flow * LATENT_J_KG * maximum(wet, 0.0, 1e-4)


def _water(air_c: Scalar) -> Scalar:
    """Return kg of water per kg of saturated air, by the formula of Magnus."""
    return 0.622 * 6.112 * exp(17.62 * air_c / (243.12 + air_c)) / 1013.25


def _highest(levels: list[tuple[Scalar, Scalar]]) -> Scalar:
    """Return the highest of temperatures, each put aside without a load."""
    put = [level - _ASIDE_K * _idle(load) for level, load in levels]
    highest = put[0]
    for each in put[1:]:
        highest = maximum(highest, each, _BLEND_K)
    return highest


def _idle(load_w: Scalar) -> Scalar:
    """Return 1 without a load, and 0 beyond `ACTIVE_W`."""
    return ACTIVE_W**2 / (load_w * load_w + ACTIVE_W**2)
