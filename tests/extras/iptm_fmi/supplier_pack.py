"""Cells and chiller of a supplier as an FMU that carries Python: temperatures in degC, powers in kW."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class SupplierPack(Fmi2Slave):
    """Two masses of cells; the second is cooled less. Its compressor draws a tenth more than asked for."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.heat, self.command = 0.0, 0.0
        self.t_1, self.t_n, self.drawn, self.taken = 33.0, 34.0, 0.0, 0.0
        for name in ("heat", "command"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("t_1", "t_n", "drawn", "taken"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, _current_time, step_size):
        """Warm the cells by their heat, and cool them by what the compressor takes."""
        self.drawn = 1.1 * self.command
        cooling = 2.0 * self.drawn
        self.t_1 += step_size * (self.heat - 1.1 * cooling) / 100.0
        self.t_n += step_size * (self.heat - 0.9 * cooling) / 100.0
        self.taken += cooling * step_size
        return True
