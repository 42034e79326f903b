"""Primal-dual interior-point method whose Newton steps come from a Riccati recursion.

The problem is ``min f(w)`` subject to ``F(x_k, u_k) - x_k+1 = 0`` and ``c(x_k, u_k) - s = 0, s >= 0``
(Nocedal and Wright, Numerical Optimization, 2nd edition, eq. 19.1). ``lam`` are the multipliers of the
dynamics, ``z`` of the inequality constraints. docs/explanation/optimal-control.md leads from every
step of the method to its name in the code and its source.
"""
