"""The same law as an FMU: `pythonfmu build -f follower_fmu.py` makes `Follower.fmu`."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real

INPUTS = ("position", "speed", "cell_n_temperature", "leader_position", "leader_speed")
OUTPUTS = ("acceleration_command", "compressor_power_command")


class Follower(Fmi2Slave):
    """Follows with a constant time gap, cools with a thermostat."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for names, causality in ((INPUTS, Fmi2Causality.input), (OUTPUTS, Fmi2Causality.output)):
            for name in names:
                setattr(self, name, 0.0)
                self.register_variable(Real(name, causality=causality))

    def do_step(self, _current_time, _step_size):
        """Decide the commands of a tick."""
        gap_error_m = self.leader_position - self.position - 6.0 - 2.0 * self.speed
        wanted_m_s2 = 0.1 * gap_error_m + 0.8 * (self.leader_speed - self.speed)
        self.acceleration_command = min(max(wanted_m_s2, -3.0), 2.0)
        self.compressor_power_command = 1500.0 if self.cell_n_temperature - 273.15 > 34.0 else 0.0
        return True
