"""Numbers of one optimal control problem: from state, forecast and strategy to the parameter vector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import WEIGHTS, GlobalIndex, SampleIndex, StateIndex, StepIndex
from iptm_controller.ocp.stages import LONGEST_STEP_WITHOUT_SAMPLED_GAP_S
from iptm_controller.strategy import Strategy
from iptm_controller.temperature_value import NO_VALUE, TemperatureValue
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.state import TOLERANCE_S, FloatArray, LeaderPreview, SlopePreview, VehicleState

REFERENCE_WINDOW_S = 2.0
LONGEST_ACCELERATION_CHANGE_S = 1.0
"""Cap on the step length used to ramp the acceleration into a longer step: braking that builds up within it
would come too late (at 30 m/s, 1 m/s of speed changes s_min by over 10 m)."""
LONGEST_COMPRESSOR_CHANGE_S = 2.5
"""The same cap for the compressor, larger because its effect on the temperatures takes minutes."""
SLOPE_DIFFERENCE_M = 25.0
COLD_COMPRESSOR_PRICE_1_KW = 100.0
"""Cost per kilowatt and second of a compressor that runs although the cells are at their lower limit."""
COLD_MARGIN_K = 0.05
"""Margin above the lower limit in which the price falls to zero; plans keep cell 1 twice as far."""
UNBOUNDED_W = 1e9
"""Charging power of a pack that takes any; finite, as all numbers of a problem are."""


@dataclass(frozen=True)
class ProblemData:
    """One problem in the optimiser's scaled units.

    Attributes:
        initial_state: x_0, shape (6,).
        parameters: globals, then the parameters of every step.
    """

    initial_state: FloatArray
    parameters: FloatArray


class ProblemDataBuilder:
    """Works out the numbers of one problem after the other.

    Attributes:
        strategy: cost terms and their weights.
        load: what of the road load grows with the mass of the vehicle.
        acceleration_intervals_s: times in which the acceleration changes on the way into each step.
        compressor_intervals_s: the same for the power of the compressor.
    """

    def __init__(
        self,
        grid: ProblemGrid,
        strategy: Strategy,
        model: ModelParameters,
        tick_s: float = math.inf,
    ) -> None:
        """Set up the common parts of all problems.

        Args:
            tick_s: sampling time of the loop; the gap is watched at this interval inside steps that are
                longer, up to those whose samples are watched.
        """
        self._grid = grid
        self.strategy = strategy
        self._scale = strategy.scale
        # Behind what changes from tick to tick.
        weighted = [self._scale * weight for weight in strategy.weights.values()]
        self._weighted: FloatArray = np.array([math.nan] * len(GlobalIndex) + weighted)
        self._model = model
        self._limits = model.limits
        lengths = grid.horizon.step_lengths_s
        self._watched = [
            (step, float(length), np.arange(1, round(float(length) / tick_s)) * tick_s)
            for step, length in enumerate(lengths)
            if 1.5 * tick_s < length <= LONGEST_STEP_WITHOUT_SAMPLED_GAP_S
        ]
        self._node_times_s = grid.horizon.node_times_s
        self.acceleration_intervals_s = _change_intervals_s(lengths, LONGEST_ACCELERATION_CHANGE_S)
        self.compressor_intervals_s = _change_intervals_s(lengths, LONGEST_COMPRESSOR_CHANGE_S)

    @property
    def watches_inside(self) -> bool:
        """Whether the gap is watched inside steps."""
        return bool(self._watched)

    @property
    def max_speed_m_s(self) -> float:
        """Largest speed of the vehicle."""
        return self._limits.max_speed_m_s

    @property
    def min_temperature_k(self) -> float:
        """Lower limit of the cell temperatures."""
        return self._limits.min_temperature_k

    def build(
        self,
        state: VehicleState,
        leader: LeaderPreview,
        slope: SlopePreview,
        expected_positions_m: FloatArray,
        known_s: float = math.inf,
        value: TemperatureValue = NO_VALUE,
        thermal_samples: FloatArray | None = None,
        expected_speeds_m_s: FloatArray | None = None,
        limiting: LeaderPreview | None = None,
        speed_limits_m_s: FloatArray | None = None,
        charge_w: float = UNBOUNDED_W,
        *,
        follows: bool = True,
    ) -> ProblemData:
        """Assemble the problem of one tick.

        Args:
            leader: leader's past and predicted motion in trip time.
            expected_positions_m: where the ego vehicle is expected at the sample times (absolute); the
                slope is expanded to second order there.
            known_s: how far ahead the leader's motion is known and not a guess. The braking reserve
                is asked for at the last node up to there, at the first one if there is none.
            value: what a kelvin costs at the end of the horizon.
            expected_speeds_m_s: expected speeds of the ego vehicle at the nodes, shape (N + 1,); for
                ticks shorter than the steps.
            limiting: motion that the gap limits hold for at the nodes; None for the leader's motion.
            speed_limits_m_s: of the road at the ends of the motion steps, None for none.
            charge_w: largest charging power of the pack, which counts where the pack has limits.
            follows: a lead vehicle is ahead, not only rules of the road; a desired gap to it has its price.
        """
        grid, origin_m = self._grid, state.position_m
        steps = np.empty((grid.steps, layout.STEP_PARAMETERS))
        nodes = state.time_s + self._node_times_s[1:]
        times = state.time_s + grid.sample_times_s
        positions, speeds = leader.at(np.concatenate([nodes, times, times - REFERENCE_WINDOW_S]))
        at_nodes, at_samples = slice(nodes.size), slice(nodes.size, nodes.size + times.size)
        steps[:, StepIndex.LEADER_POSITION] = positions[at_nodes] - origin_m
        steps[:, StepIndex.LEADER_SPEED] = speeds[at_nodes]
        if limiting is not None and limiting is not leader:
            at_nodes_m, at_nodes_m_s = limiting.at(nodes)
            steps[:, StepIndex.LEADER_POSITION] = at_nodes_m - origin_m
            steps[:, StepIndex.LEADER_SPEED] = at_nodes_m_s
        if self._watched and expected_speeds_m_s is not None:
            self._watch_inside(steps, limiting or leader, nodes, origin_m, expected_speeds_m_s)
        steps[:, StepIndex.ACCELERATION_INTERVAL] = self.acceleration_intervals_s
        steps[:, StepIndex.COMPRESSOR_INTERVAL] = self.compressor_intervals_s
        steps[:, StepIndex.END_OF_PREVIEW] = 0.0
        steps[:, StepIndex.MAX_SPEED] = self._limits.max_speed_m_s
        if speed_limits_m_s is not None:
            slower = np.minimum(speed_limits_m_s, self._limits.max_speed_m_s)
            steps[: slower.size, StepIndex.MAX_SPEED] = slower
        motion_nodes = self._node_times_s[1 : grid.horizon.motion_steps + 1]
        known_nodes = int(np.searchsorted(motion_nodes, known_s + TOLERANCE_S, side="right"))
        steps[max(known_nodes, 1) - 1, StepIndex.END_OF_PREVIEW] = 1.0
        around = np.concatenate(
            [
                expected_positions_m,
                expected_positions_m - SLOPE_DIFFERENCE_M,
                expected_positions_m + SLOPE_DIFFERENCE_M,
            ]
        )
        slopes = np.interp(around, slope.positions_m, slope.slopes_rad).reshape(3, -1)
        samples = np.empty((times.size, layout.SAMPLE_PARAMETERS))
        samples[:, SampleIndex.SLOPE] = slopes[0]
        samples[:, SampleIndex.SLOPE_GRADIENT] = (slopes[2] - slopes[1]) / (
            2.0 * SLOPE_DIFFERENCE_M
        )
        samples[:, SampleIndex.SLOPE_CURVATURE] = (
            slopes[1] - 2.0 * slopes[0] + slopes[2]
        ) / SLOPE_DIFFERENCE_M**2
        samples[:, SampleIndex.POSITION] = expected_positions_m - origin_m
        samples[:, SampleIndex.SPEED_REFERENCE] = (
            positions[at_samples] - positions[at_samples.stop :]
        ) / REFERENCE_WINDOW_S
        samples[:, SampleIndex.LEADER_POSITION] = positions[at_samples] - origin_m
        samples[:, SampleIndex.LEADER_SPEED] = speeds[at_samples]
        if thermal_samples is not None:
            samples[grid.motion_samples :] = thermal_samples
        shared = self.shared(state, value, charge_w, follows=follows)
        parameters = grid.parameters(shared, steps, samples)
        return ProblemData(self._scaled_state(state), parameters)

    def _watch_inside(
        self,
        steps: FloatArray,
        leader: LeaderPreview,
        ends_s: FloatArray,
        origin_m: float,
        speeds_m_s: FloatArray,
    ) -> None:
        """Let the instant inside a step at which s_min is tightest stand for its end.

        A leader may slow down briefly between two nodes. Seen from the end of the step, the gap at an earlier
        instant is that to a leader who is farther ahead by what the ego vehicle drives meanwhile, less what
        s_min exceeds its value at the end because the ego vehicle is faster.

        Args:
            steps: parameters of the steps; leader positions and speeds are replaced in place.
            ends_s: trip times of the ends of the steps, shape (N,).
            speeds_m_s: expected speeds of the ego vehicle at the nodes, shape (N + 1,).
        """
        limits, gap = self._limits, self._model.gap
        for step, length_s, earlier_s in self._watched:
            speed = float(speeds_m_s[step + 1])
            slowing_m_s2 = max(float(speeds_m_s[step]) - speed, 0.0) / length_s
            faster = speed + slowing_m_s2 * earlier_s
            positions, speeds = leader.at(np.subtract(ends_s[step], earlier_s))
            driven_m = 0.5 * (speed + faster) * earlier_s
            at_end_m = minimum_gap_m(speed, speeds, gap, limits)
            positions += driven_m - origin_m - minimum_gap_m(faster, speeds, gap, limits) + at_end_m
            margins = positions - at_end_m
            tightest = int(margins.argmin())
            end = steps[step]
            at_node_m = minimum_gap_m(speed, float(end[StepIndex.LEADER_SPEED]), gap, limits)
            if margins[tightest] < end[StepIndex.LEADER_POSITION] - at_node_m:
                end[StepIndex.LEADER_POSITION] = positions[tightest]
                end[StepIndex.LEADER_SPEED] = speeds[tightest]

    def shared(
        self,
        state: VehicleState,
        value: TemperatureValue,
        charge_w: float = UNBOUNDED_W,
        *,
        follows: bool = True,
    ) -> FloatArray:
        """Return the parameters that all steps share, shape (GLOBALS,)."""
        shared, scale = self._weighted.copy(), self._scale
        reference_k = self.strategy.reference_temperature_k
        if value.temperature_weight_1_k2_s > 0.0:  # two parabolas are one, up to a constant
            weight, further = self.strategy.temperature_weight, value.temperature_weight_1_k2_s
            both_k = weight * reference_k + further * value.reference_temperature_k
            shared[WEIGHTS["temperature_weight"]] = scale * (weight + further)
            reference_k = both_k / (weight + further)
        compressor_price, lowest_k = self._lower_temperature_limit(state)
        if value.cell_1_marginal_cost_1_k + value.cell_n_marginal_cost_1_k < 0.0:
            lowest_k = 0.0  # warmth is welcome: nothing is planned to be cooled
        own = {
            GlobalIndex.CELL_1_LOSS: state.cell_1_capacity_loss,
            GlobalIndex.CELL_N_LOSS: state.cell_n_capacity_loss,
            GlobalIndex.REFERENCE_TEMPERATURE: reference_k,
            GlobalIndex.CELL_1_PRICE: scale * value.cell_1_marginal_cost_1_k,
            GlobalIndex.CELL_N_PRICE: scale * value.cell_n_marginal_cost_1_k,
            GlobalIndex.COMPRESSOR_PRICE: compressor_price,
            GlobalIndex.LOWEST_TEMPERATURE: lowest_k,
            GlobalIndex.THERMAL_ENERGY_PRICE: scale * value.thermal_energy_price_1_j,
            GlobalIndex.CHARGE_POWER: charge_w,
            GlobalIndex.HEADWAY_PRICE: scale * self.strategy.headway_price_1_m2_s
            if follows
            else 0.0,
        }
        for place, number in own.items():
            shared[place] = number
        return shared

    def _lower_temperature_limit(self, state: VehicleState) -> tuple[float, float]:
        """Return the lower temperature limit as a reason not to cool, and never one to heat.

        Both parts depend on measurements, not on the plan. Cells at the limit put a price on
        running the compressor, which as an exact penalty switches it off. From above, cell 1 may be cooled
        down to a margin; from below, it may stay as it is, less a margin for what charging takes from a cell
        without any cooling.

        Returns:
            Price per kilowatt and second, lowest temperature in K.
        """
        coldest = min(state.cell_1_temperature_k, state.cell_n_temperature_k)
        mean = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
        spread = min(mean - coldest, self.strategy.coldest_below_limit_k)
        above = coldest + spread - self._limits.min_temperature_k
        share = min(max(1.0 - above / COLD_MARGIN_K, 0.0), 1.0)
        planned_k = self._limits.min_temperature_k + 2.0 * COLD_MARGIN_K - spread
        if share > 0.0:
            planned_k = min(planned_k, coldest - COLD_MARGIN_K)
        return COLD_COMPRESSOR_PRICE_1_KW * share, planned_k

    @staticmethod
    def _scaled_state(state: VehicleState) -> FloatArray:
        physical = {
            StateIndex.POSITION: 0.0,
            StateIndex.SPEED: state.speed_m_s,
            StateIndex.CELL_1_TEMPERATURE: state.cell_1_temperature_k,
            StateIndex.CELL_N_TEMPERATURE: state.cell_n_temperature_k,
            StateIndex.LAST_ACCELERATION: state.acceleration_m_s2,
            StateIndex.LAST_COMPRESSOR_POWER: state.compressor_power_w,
        }
        unscaled = np.array(layout.in_order(StateIndex, physical))
        scaled: FloatArray = (unscaled - layout.STATE_OFFSET) / layout.STATE_SCALE
        return scaled


def _change_intervals_s(lengths_s: FloatArray, longest_s: float) -> FloatArray:
    """Return the times in which an input changes on the way into each step, shape of the lengths.

    They are those between the middles of two steps, where a longer one that follows counts as ``longest_s``.
    """
    previous = np.concatenate([lengths_s[:1], lengths_s[:-1]])
    grows = lengths_s > previous
    following = np.where(grows, np.minimum(lengths_s, np.maximum(longest_s, previous)), lengths_s)
    intervals_s: FloatArray = 0.5 * (previous + following)
    return intervals_s
