"""Every statement of the paper that is checked, by topic, in the order of the paper."""

from __future__ import annotations

from iptm_reproduction.claims.headline import AGING_MODEL, HEADLINE
from iptm_reproduction.claims.multi_horizon import LENGTH, SAMPLING_TIME
from iptm_reproduction.claims.sensitivity import HORIZON, WEIGHTS
from iptm_reproduction.claims.strategies import STRATEGY_TABLE
from iptm_reproduction.claims.trip import POWER, TRIP

TOPICS = (
    HEADLINE,
    AGING_MODEL,
    STRATEGY_TABLE,
    POWER,
    TRIP,
    WEIGHTS,
    HORIZON,
    SAMPLING_TIME,
    LENGTH,
)
CLAIMS = tuple(claim for topic in TOPICS for claim in topic.claims)
