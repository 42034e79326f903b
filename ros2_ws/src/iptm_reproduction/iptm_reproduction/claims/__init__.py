"""Every statement of the paper that is checked, by topic, in the order of the paper."""

from __future__ import annotations

from iptm_reproduction.claims.sensitivity import HORIZON, LENGTH, SAMPLING_TIME, WEIGHTS
from iptm_reproduction.claims.strategies import AGING_MODEL, HEADLINE, POWER, STRATEGY_TABLE, TRIP

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
