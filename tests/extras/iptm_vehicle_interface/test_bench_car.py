"""The bench car alone, without a clock: how soon it lets go when commands stop, and states it."""

from __future__ import annotations

import pytest

from iptm_vehicle_interface.bench_car import STEP_S, BenchCar
from iptm_vehicle_interface.channel import VehicleLink
from iptm_vehicle_interface.frames import FrameCodec


@pytest.mark.parametrize("before", range(3))
def test_a_car_without_commands_is_inactive_and_states_it_within_80_ms(
    before: int, vehicle: VehicleLink
) -> None:
    """Whichever of its steps the last command comes at, and the compressor's power falls, too."""
    assert vehicle.compressor is not None
    car, gateway, listener = (
        BenchCar(vehicle, "us06"),
        FrameCodec(vehicle),
        FrameCodec(vehicle),
    )
    stated, powers_w = [], []
    last = 100 + before
    for step in range(last + 20):
        if step % 2 == before % 2 and step <= last:
            for target, value in ((vehicle.acceleration, 0.5), (vehicle.compressor, 1000.0)):
                car.receive(*gateway.encode_command(target, value, enabled=True))
        car.advance()
        powers_w.append(car.state.compressor_power_w)
        for _, frame_id, data in car.frames():
            values = listener.decode(frame_id, data).values
            if step > last and "control_active" in values:
                stated.append((step, values["control_active"]))
    inactive = next(step for step, is_active in stated if not is_active)
    assert (inactive - last) * STEP_S == pytest.approx(0.07)
    assert powers_w[last + 6] > powers_w[last] > 0.0
    assert powers_w[last + 9] < powers_w[last + 6]
