"""An interior-point method written for these horizons: one Riccati recursion per iteration."""
