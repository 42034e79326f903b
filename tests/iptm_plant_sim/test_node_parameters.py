"""What the node's parameters build."""

import pytest

from iptm_core.errors import ParameterError, RouteError
from iptm_core.state import FullChannelState
from iptm_plant_sim.node_parameters import PlantNodeParameters


def test_trip_has_the_length_of_the_cycle_unless_told_otherwise() -> None:
    assert PlantNodeParameters(cycle="nycc").build_trip().ticks == 598
    assert PlantNodeParameters(cycle="nycc", duration_s=20.0).build_trip().ticks == 20


def test_overrides_reach_the_model() -> None:
    trip = PlantNodeParameters(overrides="body.mass_kg=2000").build_trip()
    assert trip.parameters.body.mass_kg == 2000.0


def test_all_cells_of_a_channel_are_simulated_if_wanted() -> None:
    usual = PlantNodeParameters(duration_s=1.0).build_trip()
    assert not isinstance(usual.step.state, FullChannelState)
    state = (
        PlantNodeParameters(duration_s=1.0, thermal_model="full_channel").build_trip().step.state
    )
    assert isinstance(state, FullChannelState)
    assert state.cells.temperatures_k.shape == (228,)


def test_errors_are_the_projects_own() -> None:
    with pytest.raises(RouteError):
        PlantNodeParameters(cycle="nowhere").build_trip()
    with pytest.raises(ParameterError):
        PlantNodeParameters(parameter_set="unheard_of").build_trip()
    with pytest.raises(ParameterError):
        PlantNodeParameters(overrides="body.mas_kg=2000").build_trip()


@pytest.mark.parametrize("text", ["body.mass_kg", "body.mass_kg=heavy", "=3", "a.b=1, a.b=2"])
def test_malformed_overrides_are_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="overrides"):
        PlantNodeParameters(overrides=text).build_trip()
