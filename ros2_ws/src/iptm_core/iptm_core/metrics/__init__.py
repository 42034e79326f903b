"""Results of a finished run: energy, degradation, spacing, temperatures and limits."""

from iptm_core.metrics.constraints import Concern as Concern
from iptm_core.metrics.constraints import ConstraintCheck as ConstraintCheck
from iptm_core.metrics.constraints import check_constraints as check_constraints
from iptm_core.metrics.constraints import cold_compressor_energies_j as cold_compressor_energies_j
from iptm_core.metrics.constraints import gap_margins_m as gap_margins_m
from iptm_core.metrics.figures import FIGURES as FIGURES
from iptm_core.metrics.figures import PAPER_TABLE as PAPER_TABLE
from iptm_core.metrics.figures import SAVINGS as SAVINGS
from iptm_core.metrics.figures import TRIP_FIGURES as TRIP_FIGURES
from iptm_core.metrics.figures import figure_values as figure_values
from iptm_core.metrics.following import MOVING_M_S as MOVING_M_S
from iptm_core.metrics.following import Following as Following
from iptm_core.metrics.run_metrics import Better as Better
from iptm_core.metrics.run_metrics import Figure as Figure
from iptm_core.metrics.run_metrics import RunMetrics as RunMetrics
from iptm_core.metrics.run_metrics import compute_metrics as compute_metrics
from iptm_core.metrics.saving import CellSavings as CellSavings
from iptm_core.metrics.saving import CorrectedFigures as CorrectedFigures
from iptm_core.metrics.saving import Judgement as Judgement
from iptm_core.metrics.saving import SavedShare as SavedShare
from iptm_core.metrics.saving import Saving as Saving
from iptm_core.metrics.saving import TripEnd as TripEnd
from iptm_core.metrics.saving import at_equal_end as at_equal_end
from iptm_core.metrics.saving import judge_saving as judge_saving
