#include "controller.h"

#include <math.h>
#include <string.h>

#include "fallback.h"
#include "controller_constants.h"

static double larger(double first, double second) { return second > first ? second : first; }
static double smaller(double first, double second) { return second < first ? second : first; }

/* Whether the plan covers a trip time; past its end it only repeats its last input. */
static int covers(const iptm_memory *memory, double time_s) {
  const double elapsed_s = time_s - memory->start_s;
  return memory->has_plan && 0.0 <= elapsed_s && elapsed_s < iptm_grid_of_horizon.nodes_s[IPTM_STEPS];
}

static iptm_command planned_command(const iptm_memory *memory, double time_s) {
  const double elapsed_s = time_s - memory->start_s + ROUNDING_S;
  iptm_command command;
  int step = 0;
  while (step < IPTM_STEPS - 1 && iptm_grid_of_horizon.nodes_s[step + 1] <= elapsed_s) ++step;
  command.acceleration_m_s2 = memory->inputs[step * IPTM_INPUTS + IPTM_INPUT_ACCELERATION];
  command.compressor_power_w = memory->inputs[step * IPTM_INPUTS + IPTM_INPUT_COMPRESSOR_POWER];
  return command;
}

/* Price the temperatures; a state before the first one begins another trip. */
static void price(iptm_memory *memory, const iptm_vehicle *vehicle, double foreseen_1_s,
                  iptm_prices *prices) {
  const double loss = vehicle->cell_1_capacity_loss + vehicle->cell_n_capacity_loss;
  iptm_temperature_value value;
  iptm_aged aged;
  if (!memory->has_begun || vehicle->time_s < memory->begun_s) {
    memory->has_begun = 1;
    memory->begun_s = vehicle->time_s;
    memory->begun_loss = loss;
  }
  aged.time_s = vehicle->time_s;
  aged.temperature_k = 0.5 * (vehicle->cell_1_temperature_k + vehicle->cell_n_temperature_k);
  aged.capacity_loss = loss;
  aged.elapsed_s = vehicle->time_s - memory->begun_s;
  aged.lost = larger(loss - memory->begun_loss, 0.0);
  aged.foreseen_1_s = foreseen_1_s;
  iptm_value_temperatures(&iptm_valuation_of_strategy, &aged, &value);
  memset(prices, 0, sizeof(*prices));
  prices->cell_1_marginal_cost_1_k = value.cell_1_marginal_cost_1_k;
  prices->cell_n_marginal_cost_1_k = value.cell_n_marginal_cost_1_k;
}

/* Solve the problem of a tick; a usable plan is kept. */
static int plan(iptm_memory *memory, iptm_scratch *scratch, const iptm_vehicle *vehicle,
                const iptm_inputs *given, const iptm_ahead *known, iptm_decision *decision) {
  iptm_ahead ahead = *known;
  iptm_options options = iptm_solver_options;
  if (!memory->has_solved) {
    memory->has_solved = 1;
    memory->since_second = iptm_switching_numbers.try_every;
  }
  if (given->foreseen_1_s > 0.0) price(memory, vehicle, given->foreseen_1_s, &ahead.prices);
  iptm_shift_plan(&iptm_grid_of_horizon, memory->start_s,
                  covers(memory, vehicle->time_s) ? memory->states : NULL, memory->inputs, vehicle,
                  scratch->states, scratch->inputs);
  iptm_pose_problem(&iptm_grid_of_horizon, &iptm_strategy_of_controller, vehicle, &ahead,
                    scratch->states, scratch->inputs, scratch->guess, scratch->parameters);
  options.clock_s = given->clock_s;
  options.until_s = given->until_s;
  decision->iterations = iptm_solve_checked(
      &iptm_horizon_of_solver, &options, &iptm_switching_numbers, scratch->parameters,
      scratch->guess, &memory->since_second, scratch->variables, scratch->costates, scratch->solver,
      &decision->outcome);
  if (!iptm_is_usable(&decision->outcome)) return 0;
  iptm_read_plan(&iptm_grid_of_horizon, vehicle->position_m, scratch->variables, memory->states,
                 memory->inputs);
  memory->start_s = vehicle->time_s;
  memory->has_plan = 1;
  memory->failures = 0;
  return 1;
}

/* Forecast the leader, and pose and solve the problem behind it. */
static int plan_behind(iptm_memory *memory, iptm_scratch *scratch, const iptm_vehicle *vehicle,
                       const iptm_inputs *given, iptm_decision *decision) {
  enum { ROOM = IPTM_PAST_ROOM + IPTM_PREVIEW_ROOM + IPTM_EXTRAPOLATED_NODES };
  iptm_forecast *const forecast = &decision->forecast;
  iptm_motion motion = {0}, limiting = {0};
  iptm_ahead ahead = given->ahead;
  memory->forecast.leaders = memory->leaders;
  memory->forecast.predictions = memory->predictions;
  memory->forecast.fused_times_s = memory->previews;
  memory->forecast.fused_speeds_m_s = memory->previews + IPTM_PREVIEW_ROOM;
  memory->forecast.averaged_m_s = memory->previews + 2 * IPTM_PREVIEW_ROOM;
  memory->forecast.weights = memory->previews + 3 * IPTM_PREVIEW_ROOM;
  memory->forecast.work = scratch->previews;
  forecast->times_s = scratch->motion;
  forecast->positions_m = scratch->motion + ROOM;
  forecast->speeds_m_s = scratch->motion + 2 * ROOM;
  forecast->limiting_positions_m = scratch->motion + 3 * ROOM;
  forecast->limiting_speeds_m_s = scratch->motion + 4 * ROOM;
  iptm_forecast_leader(&iptm_forecaster_of_controller, &memory->forecast, given->leader,
                       given->preview, forecast);
  motion.nodes = limiting.nodes = forecast->nodes;
  motion.times_s = limiting.times_s = forecast->times_s;
  motion.positions_m = forecast->positions_m;
  motion.speeds_m_s = forecast->speeds_m_s;
  limiting.positions_m = forecast->limiting_positions_m;
  limiting.speeds_m_s = forecast->limiting_speeds_m_s;
  ahead.motion = &motion;
  ahead.limiting = forecast->has_limiting ? &limiting : &motion;
  ahead.known_s = forecast->known_s - (vehicle->time_s - given->leader->time_s);
  ahead.follows = 1.0;
  return plan(memory, scratch, vehicle, given, &ahead, decision);
}

/* Choose the rung of a tick without a usable plan. */
static iptm_rung fall_back(iptm_memory *memory, const iptm_vehicle *vehicle,
                           const iptm_leader *leader, iptm_command *command) {
  const iptm_limits *limits = &iptm_limits_of_model;
  ++memory->failures;
  if (vehicle == NULL) {
    *command = iptm_blind_braking(limits, memory->has_trusted ? &memory->trusted : NULL);
    return IPTM_STOP;
  }
  if (memory->failures <= IPTM_SHIFTED_PLAN_TICKS && covers(memory, vehicle->time_s)) {
    *command = planned_command(memory, vehicle->time_s);
    if (leader != NULL) {
      const iptm_command law = iptm_safe_following(limits, vehicle, leader);
      command->acceleration_m_s2 = smaller(command->acceleration_m_s2, law.acceleration_m_s2);
    }
    return IPTM_SHIFTED_PLAN;
  }
  if (leader != NULL && memory->failures <= IPTM_SHIFTED_PLAN_TICKS + IPTM_SAFE_LAW_TICKS) {
    *command = iptm_safe_following(limits, vehicle, leader);
    return IPTM_SAFE_LAW;
  }
  *command = iptm_controlled_stop(limits, vehicle);
  return IPTM_STOP;
}

/* Limit a command relative to the state, or to the one last trusted or commanded. */
static void limit(iptm_memory *memory, const iptm_vehicle *vehicle, iptm_decision *decision) {
  if (vehicle != NULL) {
    memory->trusted = *vehicle;
    memory->has_trusted = 1;
  }
  if (!memory->has_trusted) {
    decision->command.acceleration_m_s2 = 0.0;
    decision->command.compressor_power_w = 0.0;
    return;
  }
  decision->limits =
      iptm_limit_command(&iptm_limits_of_model, &memory->trusted, &decision->command);
  if (vehicle == NULL) {
    /* The rates count from this command next time, or braking would never get beyond one step. */
    memory->trusted.acceleration_m_s2 = decision->command.acceleration_m_s2;
    memory->trusted.compressor_power_w = decision->command.compressor_power_w;
  }
}

static unsigned unsound(const iptm_inputs *inputs) {
  if (inputs->vehicle == NULL) return 0U;
  return iptm_unsound(&iptm_grid_of_horizon, &iptm_lowest_plausible, &iptm_highest_plausible, inputs->vehicle,
                      inputs->leader, &inputs->ahead) |
         (isfinite(inputs->foreseen_1_s) ? 0U : IPTM_UNSOUND_AHEAD);
}

/* Whether a motion is known and, where what is measured of the pack is not sound, an earlier state of it. */
static int can_be_driven(const iptm_memory *memory, const iptm_vehicle *vehicle, unsigned unsound) {
  if (vehicle == NULL || (unsound & IPTM_UNSOUND_MOTION)) return 0;
  return !(unsound & IPTM_UNSOUND_PACK) || memory->has_trusted;
}

static void take_pack(iptm_vehicle *vehicle, const iptm_vehicle *from) {
  vehicle->cell_1_temperature_k = from->cell_1_temperature_k;
  vehicle->cell_n_temperature_k = from->cell_n_temperature_k;
  vehicle->compressor_power_w = from->compressor_power_w;
  vehicle->cell_1_capacity_loss = from->cell_1_capacity_loss;
  vehicle->cell_n_capacity_loss = from->cell_n_capacity_loss;
}

iptm_decision iptm_decide(iptm_memory *memory, iptm_scratch *scratch, const iptm_inputs *inputs) {
  const iptm_limits *limits = &iptm_limits_of_model;
  const iptm_vehicle *vehicle = NULL;
  iptm_inputs given = *inputs;
  iptm_vehicle within;
  iptm_leader leader;
  iptm_decision decision;
  int is_planned = 0;
  memset(&decision, 0, sizeof(decision));
  decision.rung = IPTM_STOP;
  decision.unsound = unsound(inputs);
  if (decision.unsound & IPTM_UNSOUND_LEADER) given.leader = NULL;
  if (given.leader != NULL) {
    leader = *given.leader;
    leader.speed_m_s = larger(leader.speed_m_s, 0.0);
    given.leader = &leader;
  }
  if (can_be_driven(memory, inputs->vehicle, decision.unsound)) {
    within = *inputs->vehicle;
    within.speed_m_s = larger(within.speed_m_s, 0.0);
    /* An acceleration that ordinary commands can follow; service brakes go beyond. */
    within.acceleration_m_s2 =
        smaller(larger(within.acceleration_m_s2, limits->min_acceleration_m_s2),
                limits->max_acceleration_m_s2);
    if (decision.unsound & IPTM_UNSOUND_PACK) take_pack(&within, &memory->trusted);
    vehicle = &within;
  }
  if (vehicle != NULL && decision.unsound == 0U) {
    if (given.leader != NULL && given.preview != NULL) {
      is_planned = plan_behind(memory, scratch, vehicle, &given, &decision);
    } else if (given.ahead.motion != NULL) {
      is_planned = plan(memory, scratch, vehicle, &given, &given.ahead, &decision);
    }
  }
  if (is_planned) {
    decision.rung = IPTM_OPTIMAL;
    decision.command = planned_command(memory, memory->start_s);
  } else {
    decision.rung = fall_back(memory, vehicle, given.leader, &decision.command);
  }
  if (given.most_acceleration_m_s2 != NULL) {
    decision.command.acceleration_m_s2 =
        smaller(decision.command.acceleration_m_s2, *given.most_acceleration_m_s2);
  }
  limit(memory, vehicle, &decision);
  return decision;
}
