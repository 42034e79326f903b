"""Rules that turn stored results into a verdict on a statement of the paper."""

from iptm_studies.report.rules.base import Rule
from iptm_studies.report.rules.model_rules import AgingExponential, AgingFalls
from iptm_studies.report.rules.number_rules import (
    Change,
    ChangeAtLeast,
    ChangesInRange,
    Value,
    ValueBetween,
)
from iptm_studies.report.rules.order_rules import AllLower, BestChoice, Between, Rank
from iptm_studies.report.rules.power_rules import (
    CoolsOffPeak,
    LowerPeaks,
    PowerRegionShares,
    TractionDominates,
)
from iptm_studies.report.rules.temperature_rules import (
    CooledBeforeDemand,
    HeatsInDemand,
    LastCellFallsSlower,
    SettlesNear,
)
from iptm_studies.report.rules.trend_rules import LevelsOff, NotAlways, Spread, Trend, TrendInGroups

RULES: dict[str, type[Rule]] = {
    "aging_falls": AgingFalls,
    "aging_exponential": AgingExponential,
    "change": Change,
    "changes_in_range": ChangesInRange,
    "change_at_least": ChangeAtLeast,
    "value": Value,
    "value_between": ValueBetween,
    "all_lower": AllLower,
    "between": Between,
    "rank": Rank,
    "best_choice": BestChoice,
    "power_regions": PowerRegionShares,
    "lower_peaks": LowerPeaks,
    "traction_dominates": TractionDominates,
    "cools_off_peak": CoolsOffPeak,
    "settles_near": SettlesNear,
    "last_cell_falls_slower": LastCellFallsSlower,
    "heats_in_demand": HeatsInDemand,
    "cooled_before_demand": CooledBeforeDemand,
    "trend": Trend,
    "not_always": NotAlways,
    "trend_in_groups": TrendInGroups,
    "levels_off": LevelsOff,
    "spread": Spread,
}
"""Rule classes by the name that the claims file uses."""

__all__ = ["RULES", "Rule"]
