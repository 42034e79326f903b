#include "tick_data.h"
#include "tick_data_constants.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

static const double STATE_SCALE[] = IPTM_STATE_SCALE;
static const double STATE_OFFSET[] = IPTM_STATE_OFFSET;
static const double INPUT_SCALE[] = IPTM_INPUT_SCALE;

enum { BLOCK = IPTM_STATES + IPTM_INPUTS };

static double least(double x, double y) { return y < x ? y : x; }
static double most(double x, double y) { return y > x ? y : x; }

/* Number of entries that are not above a value. */
static int count_up_to(const double *sorted, int size, double value) {
  int low = 0, high = size;
  while (low < high) {
    const int middle = low + (high - low) / 2;
    if (sorted[middle] <= value) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

double iptm_interpolate(double x, const double *places, const double *values, int stride,
                        int size) {
  const int j = count_up_to(places, size, x) - 1;
  const double *here;
  if (j < 0) return values[0];
  here = values + (ptrdiff_t)stride * j;
  if (j >= size - 1 || places[j] == x) return *here;
  return (here[stride] - *here) / (places[j + 1] - places[j]) * (x - places[j]) + *here;
}

double iptm_motion_at(const iptm_motion *motion, double time_s, double *speed_m_s) {
  const double *times = motion->times_s;
  const int last = motion->nodes - 1;
  int j;
  double width, inside, tau, v_0, v_1, p_0, p_1, rest, position;
  if (last == 0) {
    *speed_m_s = motion->speeds_m_s[0];
    return motion->positions_m[0] + motion->speeds_m_s[0] * (time_s - times[0]);
  }
  j = count_up_to(times, motion->nodes, time_s) - 1;
  if (j < 0) j = 0;
  if (j > last - 1) j = last - 1;
  width = times[j + 1] - times[j];
  inside = least(most(time_s, times[0]), times[last]);
  tau = (inside - times[j]) / width;
  v_0 = motion->speeds_m_s[j];
  v_1 = motion->speeds_m_s[j + 1];
  p_0 = motion->positions_m[j];
  p_1 = motion->positions_m[j + 1];
  rest = p_1 - p_0 - 0.5 * width * (v_0 + v_1);
  position = p_0 + width * tau * (v_0 + 0.5 * tau * (v_1 - v_0));
  position = position + rest * tau * tau * (3.0 - 2.0 * tau);
  *speed_m_s = v_0 + tau * (v_1 - v_0);
  return position + *speed_m_s * (time_s - inside);
}

/* Average the inputs of a plan over the steps as they lie `moved_s` later. */
static void average_inputs(const iptm_grid *grid, const double *inputs, double moved_s,
                           double *averaged) {
  const int steps = grid->steps, held = grid->motion_steps - 1;
  const double *nodes = grid->nodes_s, end_s = nodes[steps];
  int input, k;
  for (input = 0; input < IPTM_INPUTS; ++input) {
    /* Integral of the old input from the start to the node before edge, found step by step. */
    double integral = 0.0, before = 0.0, edge_before = 0.0;
    int j = 0;
    for (k = 0; k <= steps; ++k) {
      const double edge = least(nodes[k] + moved_s, end_s);
      double at_edge, value = 0.0;
      while (j < steps && nodes[j + 1] <= edge) {
        const int from = input == IPTM_INPUT_ACCELERATION && j > held ? held : j;
        integral += inputs[(ptrdiff_t)IPTM_INPUTS * from + input] * grid->lengths_s[j];
        ++j;
      }
      at_edge = integral;
      if (j < steps && nodes[j] != edge && edge > nodes[0]) {
        const int from = input == IPTM_INPUT_ACCELERATION && j > held ? held : j;
        value = inputs[(ptrdiff_t)IPTM_INPUTS * from + input] * grid->lengths_s[j];
        value = integral + value;
        at_edge =
            (value - integral) / (nodes[j + 1] - nodes[j]) * (edge - nodes[j]) + integral;
      }
      if (k > 0) {
        const double covered_s = edge - edge_before;
        const double length_s = grid->lengths_s[k - 1], beyond_s = length_s - covered_s;
        const int last = input == IPTM_INPUT_ACCELERATION ? held : steps - 1;
        const double total =
            (at_edge - before) + beyond_s * inputs[(ptrdiff_t)IPTM_INPUTS * last + input];
        averaged[(ptrdiff_t)IPTM_INPUTS * (k - 1) + input] = total / length_s;
      }
      before = at_edge;
      edge_before = edge;
    }
  }
  for (k = grid->motion_steps; k < steps; ++k) {
    averaged[(ptrdiff_t)IPTM_INPUTS * k + IPTM_INPUT_ACCELERATION] = 0.0;
  }
}

/* Let position and speed follow from the inputs; temperatures are left to the caller. */
static void roll_out(const iptm_grid *grid, const iptm_vehicle *vehicle, const double *inputs,
                     double *states) {
  double gained = 0.0, travelled = 0.0;
  int k;
  states[IPTM_STATE_POSITION] = vehicle->position_m;
  states[IPTM_STATE_SPEED] = vehicle->speed_m_s;
  states[IPTM_STATE_CELL_1_TEMPERATURE] = vehicle->cell_1_temperature_k;
  states[IPTM_STATE_CELL_N_TEMPERATURE] = vehicle->cell_n_temperature_k;
  states[IPTM_STATE_LAST_ACCELERATION] = vehicle->acceleration_m_s2;
  states[IPTM_STATE_LAST_COMPRESSOR_POWER] = vehicle->compressor_power_w;
  for (k = 0; k < grid->steps; ++k) {
    const double *const input = inputs + (ptrdiff_t)IPTM_INPUTS * k;
    const double *const now = states + (ptrdiff_t)IPTM_STATES * k;
    double *const next = states + (ptrdiff_t)IPTM_STATES * (k + 1);
    gained += input[IPTM_INPUT_ACCELERATION] * grid->lengths_s[k];
    next[IPTM_STATE_SPEED] = vehicle->speed_m_s + gained;
    travelled += 0.5 * (now[IPTM_STATE_SPEED] + next[IPTM_STATE_SPEED]) * grid->lengths_s[k];
    next[IPTM_STATE_POSITION] = vehicle->position_m + travelled;
    next[IPTM_STATE_LAST_ACCELERATION] = input[IPTM_INPUT_ACCELERATION];
    next[IPTM_STATE_LAST_COMPRESSOR_POWER] = input[IPTM_INPUT_COMPRESSOR_POWER];
  }
}

/* Make the plan of a vehicle that keeps its speed and the power of its compressor. */
static void hold(const iptm_grid *grid, const iptm_vehicle *vehicle, double *states,
                 double *inputs) {
  int k;
  memset(inputs, 0, sizeof(double) * IPTM_INPUTS * (size_t)grid->steps);
  for (k = 0; k < grid->steps; ++k) {
    double *const next = states + (ptrdiff_t)IPTM_STATES * (k + 1);
    inputs[(ptrdiff_t)IPTM_INPUTS * k + IPTM_INPUT_COMPRESSOR_POWER] = vehicle->compressor_power_w;
    next[IPTM_STATE_CELL_1_TEMPERATURE] = vehicle->cell_1_temperature_k;
    next[IPTM_STATE_CELL_N_TEMPERATURE] = vehicle->cell_n_temperature_k;
  }
  roll_out(grid, vehicle, inputs, states);
}

void iptm_shift_plan(const iptm_grid *grid, double start_s, const double *states,
                     const double *inputs, const iptm_vehicle *vehicle, double *next_states,
                     double *next_inputs) {
  const int steps = grid->steps;
  const double moved_s = vehicle->time_s - start_s, *nodes = grid->nodes_s;
  int k;
  if (states == NULL) {
    hold(grid, vehicle, next_states, next_inputs);
    return;
  }
  average_inputs(grid, inputs, moved_s, next_inputs);
  for (k = 1; k <= steps; ++k) {
    double *const next = next_states + (ptrdiff_t)IPTM_STATES * k;
    const double time_s = least(nodes[k] + moved_s, nodes[steps]);
    next[IPTM_STATE_CELL_1_TEMPERATURE] = iptm_interpolate(
        time_s, nodes, states + IPTM_STATE_CELL_1_TEMPERATURE, IPTM_STATES, steps + 1);
    next[IPTM_STATE_CELL_N_TEMPERATURE] = iptm_interpolate(
        time_s, nodes, states + IPTM_STATE_CELL_N_TEMPERATURE, IPTM_STATES, steps + 1);
  }
  roll_out(grid, vehicle, next_inputs, next_states);
}

/* Write the parameters that all steps share: state of the cells, prices and weights. */
static void pose_shared(const iptm_strategy *strategy, const iptm_vehicle *vehicle,
                        const iptm_ahead *ahead, iptm_real *parameters) {
  const iptm_prices *prices = &ahead->prices;
  const double scale = strategy->scale, lowest_k = strategy->min_temperature_k;
  const double coldest = least(vehicle->cell_1_temperature_k, vehicle->cell_n_temperature_k);
  const double mean = 0.5 * (vehicle->cell_1_temperature_k + vehicle->cell_n_temperature_k);
  const double spread = least(mean - coldest, strategy->coldest_below_limit_k);
  const double share = least(most(1.0 - (coldest + spread - lowest_k) / COLD_MARGIN_K, 0.0), 1.0);
  const double further = prices->temperature_weight_1_k2_s;
  double planned_k = lowest_k + 2.0 * COLD_MARGIN_K - spread;
  double reference_k = strategy->reference_temperature_k;
  int i;
  for (i = 0; i < IPTM_WEIGHTS; ++i) {
    parameters[IPTM_GLOBALS - IPTM_WEIGHTS + i] = scale * strategy->weights[i];
  }
  if (share > 0.0) planned_k = least(planned_k, coldest - COLD_MARGIN_K);
  /* Warmth is welcome: nothing is planned to be cooled. */
  if (prices->cell_1_marginal_cost_1_k + prices->cell_n_marginal_cost_1_k < 0.0) planned_k = 0.0;
  if (further > 0.0) {
    /* Two parabolas are one, up to a constant. */
    const double weight =
        strategy->weights[IPTM_GLOBAL_TEMPERATURE_WEIGHT - (IPTM_GLOBALS - IPTM_WEIGHTS)];
    const double both_k = weight * reference_k + further * prices->reference_temperature_k;
    parameters[IPTM_GLOBAL_TEMPERATURE_WEIGHT] = scale * (weight + further);
    reference_k = both_k / (weight + further);
  }
  parameters[IPTM_GLOBAL_CELL_1_LOSS] = vehicle->cell_1_capacity_loss;
  parameters[IPTM_GLOBAL_CELL_N_LOSS] = vehicle->cell_n_capacity_loss;
  parameters[IPTM_GLOBAL_REFERENCE_TEMPERATURE] = reference_k;
  parameters[IPTM_GLOBAL_CELL_1_PRICE] = scale * prices->cell_1_marginal_cost_1_k;
  parameters[IPTM_GLOBAL_CELL_N_PRICE] = scale * prices->cell_n_marginal_cost_1_k;
  parameters[IPTM_GLOBAL_COMPRESSOR_PRICE] = COLD_COMPRESSOR_PRICE_1_KW * share;
  parameters[IPTM_GLOBAL_LOWEST_TEMPERATURE] = planned_k;
  parameters[IPTM_GLOBAL_THERMAL_ENERGY_PRICE] = scale * prices->thermal_energy_price_1_j;
  parameters[IPTM_GLOBAL_CHARGE_POWER] = ahead->charge_w;
  parameters[IPTM_GLOBAL_HEADWAY_PRICE] = ahead->follows > 0.0 ? scale * strategy->headway_price_1_m2_s : 0.0;
}

/* Write the parameters of the steps: gap limits, intervals of the inputs and speed limits. */
static void pose_steps(const iptm_grid *grid, const iptm_vehicle *vehicle,
                       const iptm_ahead *ahead, iptm_real *parameters) {
  int known_nodes = count_up_to(grid->nodes_s + 1, grid->motion_steps, ahead->known_s + TOLERANCE_S);
  int k;
  if (known_nodes < 1) known_nodes = 1;
  for (k = 0; k < grid->steps; ++k) {
    iptm_real *const step = parameters + grid->step_places[k];
    const double node_s = vehicle->time_s + grid->nodes_s[k + 1];
    double limit_m_s = grid->max_speed_m_s, leader_m_s;
    step[IPTM_STEP_LEADER_POSITION] =
        iptm_motion_at(ahead->limiting, node_s, &leader_m_s) - vehicle->position_m;
    step[IPTM_STEP_LEADER_SPEED] = leader_m_s;
    step[IPTM_STEP_ACCELERATION_INTERVAL] = grid->acceleration_intervals_s[k];
    step[IPTM_STEP_COMPRESSOR_INTERVAL] = grid->compressor_intervals_s[k];
    step[IPTM_STEP_END_OF_PREVIEW] = k == known_nodes - 1 ? 1.0 : 0.0;
    if (ahead->speed_limits_m_s != NULL && k < grid->motion_steps) {
      limit_m_s = least(ahead->speed_limits_m_s[k], limit_m_s);
    }
    step[IPTM_STEP_MAX_SPEED] = limit_m_s;
  }
}

/* Write the parameters of the samples: slope around the plan, and the leader. */
static void pose_samples(const iptm_grid *grid, const iptm_vehicle *vehicle, const double *states,
                         const double *inputs, const iptm_ahead *ahead, iptm_real *parameters) {
  const iptm_motion *leader = ahead->motion;
  const iptm_slope *slope = ahead->slope;
  const double *thermal_samples = ahead->thermal_samples;
  const int motion = thermal_samples == NULL ? grid->samples : grid->motion_samples;
  int i;
  for (i = 0; i < motion; ++i) {
    iptm_real *const sample = parameters + grid->sample_places[i];
    const int step = grid->sample_steps[i];
    const double *const state = states + (ptrdiff_t)IPTM_STATES * step;
    const double acceleration = inputs[(ptrdiff_t)IPTM_INPUTS * step + IPTM_INPUT_ACCELERATION];
    const double elapsed_s = grid->sample_times_s[i] - grid->nodes_s[step];
    const double time_s = vehicle->time_s + grid->sample_times_s[i];
    const double expected_m =
        state[IPTM_STATE_POSITION] +
        elapsed_s * (state[IPTM_STATE_SPEED] + 0.5 * elapsed_s * acceleration);
    const double here = iptm_interpolate(expected_m, slope->positions_m, slope->slopes_rad, 1,
                                    slope->nodes);
    const double behind = iptm_interpolate(expected_m - SLOPE_DIFFERENCE_M, slope->positions_m,
                                      slope->slopes_rad, 1, slope->nodes);
    const double ahead = iptm_interpolate(expected_m + SLOPE_DIFFERENCE_M, slope->positions_m,
                                     slope->slopes_rad, 1, slope->nodes);
    double unused, leader_m_s;
    const double position_m = iptm_motion_at(leader, time_s, &leader_m_s);
    sample[IPTM_SAMPLE_LEADER_SPEED] = leader_m_s;
    sample[IPTM_SAMPLE_SLOPE] = here;
    sample[IPTM_SAMPLE_SLOPE_GRADIENT] = (ahead - behind) / (2.0 * SLOPE_DIFFERENCE_M);
    sample[IPTM_SAMPLE_SLOPE_CURVATURE] =
        (behind - 2.0 * here + ahead) / (SLOPE_DIFFERENCE_M * SLOPE_DIFFERENCE_M);
    sample[IPTM_SAMPLE_POSITION] = expected_m - vehicle->position_m;
    sample[IPTM_SAMPLE_SPEED_REFERENCE] =
        (position_m - iptm_motion_at(leader, time_s - REFERENCE_WINDOW_S, &unused)) /
        REFERENCE_WINDOW_S;
    sample[IPTM_SAMPLE_LEADER_POSITION] = position_m - vehicle->position_m;
  }
  for (; i < grid->samples; ++i) {
    const double *const given = thermal_samples + (ptrdiff_t)IPTM_SAMPLE_PARAMETERS * (i - motion);
    int j;
    for (j = 0; j < IPTM_SAMPLE_PARAMETERS; ++j) parameters[grid->sample_places[i] + j] = given[j];
  }
}

static void scale_state(const double *state, double position_m, iptm_real *scaled) {
  int i;
  for (i = 0; i < IPTM_STATES; ++i) {
    double relative = state[i] - STATE_OFFSET[i];
    if (i == IPTM_STATE_POSITION) relative -= position_m;
    scaled[i] = relative / STATE_SCALE[i];
  }
}

void iptm_pose_problem(const iptm_grid *grid, const iptm_strategy *strategy,
                       const iptm_vehicle *vehicle, const iptm_ahead *ahead, const double *states,
                       const double *inputs, iptm_real *variables, iptm_real *parameters) {
  int k, i;
  pose_shared(strategy, vehicle, ahead, parameters);
  pose_steps(grid, vehicle, ahead, parameters);
  pose_samples(grid, vehicle, states, inputs, ahead, parameters);
  for (k = 0; k < grid->steps; ++k) {
    iptm_real *const block = variables + (ptrdiff_t)BLOCK * k;
    const double *const input = inputs + (ptrdiff_t)IPTM_INPUTS * k;
    scale_state(states + (ptrdiff_t)IPTM_STATES * k, vehicle->position_m, block);
    for (i = 0; i < IPTM_INPUTS; ++i) block[IPTM_STATES + i] = input[i] / INPUT_SCALE[i];
  }
  scale_state(states + (ptrdiff_t)IPTM_STATES * grid->steps, vehicle->position_m,
              variables + (ptrdiff_t)BLOCK * grid->steps);
}

void iptm_read_plan(const iptm_grid *grid, double position_m, const iptm_real *variables,
                    double *states, double *inputs) {
  int k, i;
  for (k = 0; k <= grid->steps; ++k) {
    const iptm_real *const block = variables + (ptrdiff_t)BLOCK * k;
    double *const state = states + (ptrdiff_t)IPTM_STATES * k;
    for (i = 0; i < IPTM_STATES; ++i) state[i] = block[i] * STATE_SCALE[i] + STATE_OFFSET[i];
    state[IPTM_STATE_POSITION] += position_m;
    if (k == grid->steps) break;
    for (i = 0; i < IPTM_INPUTS; ++i) {
      inputs[(ptrdiff_t)IPTM_INPUTS * k + i] = block[IPTM_STATES + i] * INPUT_SCALE[i];
    }
  }
}
