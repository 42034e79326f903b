"""A car of others as an FMU that carries Python: speed in km/h, temperatures in degC, a pack of one cell."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class ForeignCar(Fmi2Slave):
    """A point mass with a lumped pack."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.a_cmd, self.p_comp, self.grade = 0.0, 0.0, 0.0
        self.s, self.v_kmh, self.e_kwh, self.soc, self.t_pack = 0.0, 0.0, 0.0, 0.9, 35.0
        for name in ("a_cmd", "p_comp", "grade"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("s", "v_kmh", "e_kwh", "soc", "t_pack"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, _current_time, step_size):
        """Move for one step."""
        v = self.v_kmh / 3.6
        end = max(v + self.a_cmd * step_size, 0.0)
        force = 1600.0 * (self.a_cmd + 9.81 * self.grade) + 0.4 * v * v + 160.0 * (v > 0.0)
        power = force * 0.5 * (v + end) + 1000.0 * self.p_comp + 400.0
        self.s += 0.5 * (v + end) * step_size
        self.v_kmh = 3.6 * end
        self.e_kwh += power * step_size / 3.6e6
        self.soc = 0.9 - self.e_kwh / 60.0
        self.t_pack += step_size * (0.03 * abs(power) - 2500.0 * self.p_comp) / 300e3
        return True
