"""Power at the battery terminals with partial regeneration, paper eq. (4)."""

from __future__ import annotations

from iptm_core.parameters.model import PackParameters, PowertrainParameters
from iptm_core.physics.ops import Scalar, maximum


def battery_power_w(
    traction: Scalar,
    compressor: Scalar,
    auxiliary: Scalar,
    pack: PackParameters,
    powertrain: PowertrainParameters,
    *,
    power_smoothing_w: float = 0.0,
) -> Scalar:
    """Terminal power of the pack (P_b, eq. 4), positive when discharging.

    The two cases of the equation are one convex kink in the traction power,
    ``max(P_tra / eta_b, eta_b zeta P_tra)``.

    Args:
        traction: electric traction power P_tra in W.
        compressor: compressor power P_cp in W.
        auxiliary: auxiliary power P_aux in W.
        pack: battery efficiency eta_b.
        powertrain: regenerative efficiency zeta.
        power_smoothing_w: width of the smoothed kink in W of traction power; 0 is exact.

    Returns:
        Power in W.
    """
    drive = 1.0 / pack.battery_efficiency
    regenerate = pack.battery_efficiency * powertrain.regenerative_efficiency
    width = power_smoothing_w * (drive - regenerate)
    share = maximum(traction * drive, traction * regenerate, width)
    return share + drive * (compressor + auxiliary)
