"""The small route of the tests of the bridge."""

from tests.iptm_v2x_bridge.conftest import route  # noqa: F401
