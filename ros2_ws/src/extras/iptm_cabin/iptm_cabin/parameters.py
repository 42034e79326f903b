"""Parameters of cabin, refrigerant loop and weather, with unit and range, and the files that hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

from iptm_cabin.cycle_map import Refrigerant
from iptm_core.declaration import Settings, TextEnum, parameter
from iptm_core.errors import ScenarioError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.user_input import check_known, shown

CARS = Path(__file__).parent / "cars"
SUFFIX = ".cabin"
COLDEST_C, HOTTEST_C = -40.0, 60.0
"""Bounds of the air."""


class ClimateControl(TextEnum):
    """Who decides on cabin and pack.

    In all of them but the predictive one a PI control keeps the cabin. ``command``: the compressor command of
    the trip's controller sets the heat that the pack gives off. ``rule``: the pack is cooled above 35 degC
    until 30 and heated below 5 degC until 10. ``alone``: nothing is done to the pack. ``published``: bypass
    of the chiller below 30 degC, heater below 5 degC, radiator whenever the air is colder by 5 K.
    """

    COMMAND = "command"
    RULE = "rule"
    ALONE = "alone"
    PUBLISHED = "published"
    PREDICTIVE = "predictive"


class PartFailure(TextEnum):
    """What is broken."""

    NONE = "none"
    COMPRESSOR = "compressor"
    PTC = "ptc"
    FAN = "fan"
    SENSOR_LOST = "sensor_lost"
    SENSOR_FROZEN = "sensor_frozen"


@dataclass(frozen=True)
class CabinParameters(Settings):
    """The cabin of a car, its refrigerant loop, and the weather.

    Defaults are chosen, in the middle of those that public models of cars have; what is fitted or published
    is stated in the file of a car.
    """

    refrigerant: Refrigerant = parameter(Refrigerant.R1234YF, "what circulates")
    control: ClimateControl = parameter(ClimateControl.RULE, "who decides on cabin and pack")
    set_point_c: float = parameter(22.0, "wanted temperature of the cabin", "degC", 16.0, 28.0)
    initial_c: float = parameter(
        -273.15,
        "cabin and interior at the start; without it that of the air, and 15 K more in a sun of 700 W/m^2",
        "degC",
        -273.15,
        75.0,
    )
    air_over_time: str = parameter(
        "",
        "air in degC over the time in s, such as '0: -20, 3600: 25'; without it the trip's",
    )
    sun_w_m2: float = parameter(0.0, "radiation of the sun", "W/m^2", 0.0, 1200.0)
    humidity: float = parameter(0.5, "relative humidity of the air outside", "", 0.0, 1.0)
    occupants: float = parameter(1.0, "persons, 100 W each", "", 0.0, 9.0)
    open_windows_w_k: float = parameter(
        0.0, "exchange with the air by open windows", "W/K", 0.0, 1000.0
    )
    air_heat_capacity_j_k: float = parameter(45e3, "air and light trim", "J/K", 5e3, 5e5)
    interior_heat_capacity_j_k: float = parameter(90e3, "seats and board", "J/K", 1e4, 2e6)
    interior_conductance_w_k: float = parameter(120.0, "air to interior", "W/K", 5.0, 1000.0)
    shell_conductance_w_k: float = parameter(40.0, "air to outside, standing", "W/K", 1.0, 500.0)
    shell_conductance_j_k_m: float = parameter(
        0.8, "rise of that over the speed", "W s/(K m)", 0.0, 20.0
    )
    interior_outside_w_k: float = parameter(12.0, "interior to outside", "W/K", 0.0, 200.0)
    sun_aperture_m2: float = parameter(0.9, "glass area times transmittance", "m^2", 0.0, 10.0)
    sun_share_of_air: float = parameter(0.3, "share of the sun into the air", "", 0.0, 1.0)
    blown_air_kg_s: float = parameter(0.08, "flow of the blower", "kg/s", 0.02, 0.3)
    fresh_share: float = parameter(0.4, "share of it from outside", "", 0.0, 1.0)
    blower_power_w: float = parameter(120.0, "power of the blower", "W", 0.0, 600.0)
    core_heat_capacity_j_k: float = parameter(12e3, "heater core with its coolant", "J/K", 1e3, 1e5)
    core_conductance_w_k: float = parameter(150.0, "heater core to its air", "W/K", 10.0, 500.0)
    evaporator_w_k: float = parameter(260.0, "evaporator of the cabin", "W/K", 20.0, 2000.0)
    condenser_w_k: float = parameter(
        600.0, "condenser of the cabin, to the heater core", "W/K", 20.0, 5000.0
    )
    chiller_w_k: float = parameter(
        700.0, "chiller and condenser of the pack's coolant", "W/K", 20.0, 5000.0
    )
    outside_w_k: float = parameter(
        260.0, "outside heat exchanger, standing, with its fan", "W/K", 20.0, 5000.0
    )
    outside_j_k_m: float = parameter(18.0, "rise of that over the speed", "W s/(K m)", 0.0, 500.0)
    outside_fan_w: float = parameter(
        200.0, "power of its fan at standstill under full load", "W", 0.0, 1000.0
    )
    frost_lift_k: float = parameter(
        12.0,
        "how far below the air a heat pump may evaporate before frost grows, down to -20 degC of the air",
        "K",
        2.0,
        40.0,
    )
    is_heat_pump: bool = parameter(default=True, description="whether the loop heats, too")
    has_regulator: bool = parameter(
        default=True,
        description="whether a pressure regulator keeps the cabin's evaporator above freezing",
    )
    displacement_cm3: float = parameter(33.0, "displacement of the compressor", "cm^3", 3.0, 100.0)
    max_speed_hz: float = parameter(143.0, "its largest speed", "1/s", 30.0, 145.0)
    max_compressor_power_w: float = parameter(4500.0, "its largest power", "W", 0.0, 20e3)
    max_ptc_power_w: float = parameter(5500.0, "largest power of the heater", "W", 0.0, 15e3)
    max_pack_heat_w: float = parameter(5000.0, "largest heat of pack or from it", "W", 0.0, 20e3)
    radiator_w_k: float = parameter(
        100.0, "radiator of the pack's coolant at 14 m/s, 0 for none", "W/K", 0.0, 2000.0
    )
    radiator_fan_w: float = parameter(100.0, "power of its fan at standstill", "W", 0.0, 1000.0)
    drive_heat_capacity_j_k: float = parameter(
        45e3, "motor, inverter and their coolant", "J/K", 1e3, 1e6
    )
    drive_radiator_w_k: float = parameter(
        60.0, "radiator of the drive at 14 m/s", "W/K", 1.0, 2000.0
    )
    drive_waste_share: float = parameter(
        0.1, "share of the magnitude of the traction power that warms the drive", "", 0.0, 0.5
    )
    waste_w_k: float = parameter(
        50.0, "drive to the refrigerant of a heat pump, 0 for none", "W/K", 0.0, 1000.0
    )
    warm_up_price_w_k2: float = parameter(
        8.0,
        "power that a squared kelvin off the set point is as bad as, in the first ten minutes",
        "W/K^2",
        0.0,
        1000.0,
    )
    comfort_price_w_k2: float = parameter(150.0, "the same after them", "W/K^2", 0.0, 5000.0)
    band_k: float = parameter(
        2.0, "half width of the band that is left at an exact penalty", "K", 0.5, 10.0
    )
    band_price_w_k: float = parameter(
        300.0, "power that a kelvin outside of the band is as bad as", "W/K", 0.0, 5000.0
    )
    pack_price_j_k: float = parameter(
        0.0,
        "energy that a kelvin of the pack at the end of the trip is as good as, as from a plan of the day",
        "J/K",
        -1e6,
        1e6,
    )
    aging_price_j: float = parameter(
        9e11,
        "energy that the loss of all capacity is as bad as: 15,000 EUR for 20 % at 0.30 EUR/kWh",
        "J",
        0.0,
        1e14,
    )
    horizon_s: float = parameter(600.0, "how far the predictive control plans", "s", 60.0, 7200.0)
    way_ahead: str = parameter(
        "", "cycle whose speeds the navigation expects; without it, those of the preview"
    )
    broken: PartFailure = parameter(PartFailure.NONE, "broken part")

    def initial_temperature_c(self, ambient_c: float) -> float:
        """Return the temperature of a cabin that stood in the air and the sun."""
        if self.initial_c > -273.0:
            return self.initial_c
        return ambient_c + 15.0 * self.sun_w_m2 / 700.0


def read_cabin(file: str) -> CabinParameters:
    """Read a file of YAML: values by the names of `CabinParameters`, with a ``base`` for the others.

    Args:
        file: a path, or the name of a car of this extra, such as ``bmw_i3.cabin``.

    Raises:
        ScenarioError: there is no such file, or a value is not permitted.
    """
    return cabin_of(_values(Path(file), ()))


def cabin_of(values: Mapping[str, Any]) -> CabinParameters:
    """Return parameters of values by name.

    Raises:
        IptmError: a name is unknown or a value is not permitted.
    """
    names = [each.name for each in fields(CabinParameters)]
    for name in values:
        check_known(name, names, "cabin", "parameter", ScenarioError)
    return CabinParameters(**values)


def air_course(cabin: CabinParameters) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return times in s and temperatures of the air in degC; none where the trip's air stays as it is.

    Raises:
        ScenarioError: an entry is not a pair of numbers, or times do not increase.
    """
    given = cabin.air_over_time
    pairs = [each.split(":") for each in given.split(",")] if given.strip() else []
    try:
        times, degrees = (
            zip(*((float(s), float(c)) for s, c in pairs), strict=True) if pairs else ((), ())
        )
    except ValueError:
        times, degrees = (0.0, 0.0), (0.0, 0.0)
    within = all(COLDEST_C <= each <= HOTTEST_C for each in degrees)
    if not within or any(late <= early for early, late in pairwise(times)):
        raise ScenarioError(
            f"air_over_time is {shown(given)}; allowed: pairs as '0: -20, 3600: 25', increasing times in s "
            f"and {COLDEST_C:g} to {HOTTEST_C:g} degC"
        )
    return times, degrees


def _values(path: Path, above: tuple[str, ...]) -> dict[str, Any]:
    found = path if path.is_file() else CARS / path.name
    if not found.is_file() or path.name in above:
        cars = ", ".join(sorted(each.name for each in CARS.glob(f"*{SUFFIX}")))
        raise ScenarioError(f"cabin is {str(path)!r}; allowed: a file that exists, or {cars}")
    own = read_yaml(found, ScenarioError) or {}
    if not isinstance(own, dict):
        raise ScenarioError(f"{found} holds {shown(own)}; allowed: names with values")
    base = own.pop("base", None)
    if base is None:
        return own
    return _values(Path(f"{base}{SUFFIX}"), (*above, path.name)) | own
