#include "switching.h"

#include <string.h>

#include "stages.h"
#include "switching_constants.h"

/* Why a solve is done once more. */
typedef enum { NONE, TRIED, PROMISING } start_kind;

enum { OPTIONS = IPTM_CANDIDATES + 1, POWER = IPTM_STATES + IPTM_INPUT_COMPRESSOR_POWER };

/* Memory of a check, from the caller's. */
typedef struct {
  iptm_real *powers, *values; /* own and candidate powers and their Hamiltonians, option after option */
  iptm_real *ramps, *chosen, *start, *variables, *costates, *gains, *solve;
  iptm_real *proposals, *states, *ends, *inputs, *costs, *step_costs; /* of the plans that are simulated */
} memory;

static size_t lay_out(memory *m, const iptm_horizon *horizon, iptm_real *work) {
  const size_t steps = (size_t)horizon->steps;
  const size_t variables = steps * IPTM_BLOCK + IPTM_STATES;
  iptm_real *free = work;
  m->powers = free;
  free += OPTIONS * steps;
  m->values = free;
  free += OPTIONS * steps;
  m->ramps = free;
  free += steps;
  m->chosen = free;
  free += steps;
  m->gains = free;
  free += steps;
  m->start = free;
  free += variables;
  m->variables = free;
  free += variables;
  m->costates = free;
  free += steps * IPTM_STATES;
  m->proposals = free;
  free += IPTM_PROPOSALS * steps;
  m->states = free;
  free += IPTM_PROPOSALS * IPTM_STATES;
  m->ends = free;
  free += IPTM_PROPOSALS * IPTM_STATES;
  m->inputs = free;
  free += IPTM_PROPOSALS;
  m->costs = free;
  free += IPTM_PROPOSALS;
  m->step_costs = free;
  free += IPTM_PROPOSALS;
  m->solve = free;
  return (size_t)(free - work);
}

size_t iptm_checked_work_size(const iptm_horizon *horizon) {
  memory m;
  iptm_real origin;
  return lay_out(&m, horizon, &origin) + iptm_work_size(horizon);
}

static iptm_real clamp(iptm_real value, iptm_real low, iptm_real high) {
  const iptm_real raised = low > value ? low : value;
  return high < raised ? high : raised;
}

/* Largest change of the power into every step. */
static void find_ramps(const iptm_horizon *horizon, iptm_real rate_1_s, const iptm_real *parameters,
                       iptm_real *ramps) {
  const iptm_real *step = parameters + IPTM_GLOBALS;
  int kind, i;
  for (kind = 0; kind < IPTM_KINDS; ++kind) {
    for (i = 0; i < horizon->kind_steps[kind]; ++i) {
      *ramps++ = rate_1_s * step[IPTM_STEP_COMPRESSOR_INTERVAL];
      step += iptm_kind_parameters[kind];
    }
  }
}

/* Evaluate the Hamiltonian of every step for every option. */
static void find_hamiltonians(const iptm_horizon *horizon, const memory *m, const iptm_real *parameters,
                              const iptm_real *w, const iptm_real *costates) {
  int option, kind;
  for (option = 0; option < OPTIONS; ++option) {
    int first = 0, offset = IPTM_GLOBALS;
    for (kind = 0; kind < IPTM_KINDS; ++kind) {
      const int count = horizon->kind_steps[kind];
      const ptrdiff_t place = (ptrdiff_t)option * horizon->steps + first;
      const iptm_real *const x = w + (ptrdiff_t)IPTM_BLOCK * first;
      const iptm_real *const arg[] = {
          x,
          x + IPTM_STATES,
          parameters + offset,
          parameters,
          costates + (ptrdiff_t)IPTM_STATES * first,
          m->powers + place,
      };
      iptm_real *const res[] = {m->values + place};
      iptm_hamiltonian[kind](arg, res, count);
      first += count;
      offset += count * iptm_kind_parameters[kind];
    }
  }
}

/* Magnitude of what a plan costs without its slacks. */
static iptm_real cost_without_slacks(const iptm_horizon *horizon, const iptm_real *w, iptm_real objective) {
  iptm_real slack_cost = 0.0;
  int k, i;
  for (k = 0; k < horizon->steps; ++k) {
    const iptm_real *slacks = w + (ptrdiff_t)IPTM_BLOCK * (k + 1) - IPTM_SLACKS;
    for (i = 0; i < IPTM_SLACKS; ++i) {
      slack_cost += slacks[i] * horizon->soft_prices[IPTM_SLACKS * k + i];
    }
  }
  return fabs(objective - slack_cost);
}

/* Find powers that do the work of the plan in fewer steps, the cheapest ones, at the best power. */
static int concentrate(const iptm_horizon *horizon, const memory *m, iptm_real best) {
  const int steps = horizon->steps;
  const iptm_real *own = m->powers, *off = m->values + steps, *on = off + steps;
  iptm_real least = INFINITY, work = 0.0, done = 0.0;
  int k;
  for (k = 0; k < steps; ++k) {
    if (own[k] > RUNNING_SHARE * best && own[k] < least) least = own[k];
    work += own[k] * horizon->lengths_s[k];
    m->gains[k] = (on[k] - off[k]) / horizon->lengths_s[k];
    m->chosen[k] = 0.0;
  }
  if (least >= FULL_SHARE * best) return 0;
  /* One more after the work is done, as searchsorted(cumsum) + 1 counts. */
  while (1) {
    int cheapest = -1;
    for (k = 0; k < steps; ++k) {
      if (m->chosen[k] == 0.0 && (cheapest < 0 || m->gains[k] < m->gains[cheapest])) cheapest = k;
    }
    if (cheapest < 0) break;
    m->chosen[cheapest] = best;
    done += best * horizon->lengths_s[cheapest];
    if (done >= work) break;
  }
  return 1;
}

/* Find the powers of a second start; returns the kind of it, NONE where the expected gain is too small. */
static start_kind find_better_powers(const iptm_horizon *horizon, const iptm_switching *switching,
                              const memory *m, const iptm_real *parameters, const iptm_real *w,
                              const iptm_real *costates, iptm_real objective, int due) {
  const int steps = horizon->steps;
  const iptm_real last = w[IPTM_STATE_LAST_COMPRESSOR_POWER];
  iptm_real reach = 0.0, expected = 0.0, best_gain = -INFINITY, threshold, coldest = INFINITY;
  int k, option, is_promising, all_alike = 1;
  for (k = 0; k < steps; ++k) {
    const iptm_real *const next = w + (ptrdiff_t)IPTM_BLOCK * (k + 1);
    reach = k == 0 ? m->ramps[0] : reach + m->ramps[k];
    m->powers[k] = w[(ptrdiff_t)IPTM_BLOCK * k + POWER];
    for (option = 1; option < OPTIONS; ++option) {
      m->powers[option * steps + k] =
          clamp(switching->candidates[option - 1], last - reach, last + reach);
    }
    if (next[IPTM_STATE_CELL_1_TEMPERATURE] < coldest) coldest = next[IPTM_STATE_CELL_1_TEMPERATURE];
  }
  find_hamiltonians(horizon, m, parameters, w, costates);
  if (IPTM_TEMPERATURE_OFFSET_K + coldest < parameters[IPTM_GLOBAL_LOWEST_TEMPERATURE] + AT_LIMIT_K) {
    /* The costates include the penalty below the limit and are not valid for less cooling. */
    return due && concentrate(horizon, m, switching->candidates[IPTM_CANDIDATES - 1]) ? TRIED : NONE;
  }
  for (k = 0; k < steps; ++k) {
    const iptm_real own = m->powers[k];
    iptm_real best = -INFINITY;
    m->chosen[k] = m->powers[steps + k];
    for (option = 1; option < OPTIONS; ++option) {
      const int place = option * steps + k;
      iptm_real gain = -INFINITY;
      if (!(fabs(m->powers[place] - own) < DISTINCT_POWER_KW)) {
        gain = m->values[k] - m->values[place];
        all_alike = 0;
      }
      if (gain > best) {
        best = gain;
        m->chosen[k] = m->powers[place];
      }
    }
    m->gains[k] = best;
    if (best > 0.0) expected += best;
    if (best > best_gain) best_gain = best;
  }
  is_promising = expected > LEAST_GAIN &&
                 expected > PROMISING_SHARE * cost_without_slacks(horizon, w, objective);
  if (!is_promising && (!due || all_alike)) return NONE;
  threshold = best_gain < 0.0 ? best_gain : 0.0;
  for (k = 0; k < steps; ++k) {
    const int is_chosen = is_promising ? m->gains[k] > 0.0 : m->gains[k] >= threshold;
    if (!is_chosen) m->chosen[k] = m->powers[k];
  }
  return is_promising ? PROMISING : TRIED;
}

/* Find the first steps of the parts that are switched as one, and the end; returns how many parts. */
static int find_blocks(const iptm_horizon *horizon, int *starts) {
  iptm_real duration_s = 0.0, block_s = 0.0;
  int k, blocks = 0;
  for (k = 0; k < horizon->steps; ++k) duration_s += horizon->lengths_s[k];
  for (k = 0; k < horizon->steps && blocks < IPTM_BLOCKS; ++k) {
    if (block_s == 0.0) starts[blocks++] = k;
    block_s += horizon->lengths_s[k];
    if (block_s >= duration_s / IPTM_BLOCKS) block_s = 0.0;
  }
  starts[blocks] = horizon->steps;
  return blocks;
}

/* Write the plans to simulate one after the other, the present one first; returns how many there are. */
static int propose(const iptm_horizon *horizon, const iptm_switching *switching, const iptm_real *own,
                   iptm_real *proposals) {
  const iptm_real *const lengths_s = horizon->lengths_s;
  const iptm_real off = switching->candidates[0], on = switching->candidates[IPTM_CANDIDATES - 1];
  const int steps = horizon->steps;
  int starts[IPTM_BLOCKS + 1], blocks = find_blocks(horizon, starts), block, level, k;
  iptm_real *next = proposals, work = 0.0;
  for (k = 0; k < steps; ++k) {
    *next++ = own[k];
    if (own[k] > RUNNING_SHARE * on) work += own[k] * lengths_s[k];
  }
  for (block = 1; block < blocks; ++block) {
    for (level = 0; level <= IPTM_LEVELS; ++level) {
      for (k = 0; k < steps; ++k) {
        const iptm_real power = level < IPTM_LEVELS ? switching->levels[level] : own[k];
        *next++ = k < starts[block] ? off : power;
      }
    }
  }
  for (block = 0; block < blocks; ++block) {
    const int first = starts[block], end = starts[block + 1], last = starts[blocks - 1];
    int is_on = 0, ends_on = 0;
    iptm_real rest = 0.0, scale = 1.0;
    for (k = 0; k < steps; ++k) {
      const int inside = k >= first && k < end;
      if (own[k] > RUNNING_SHARE * on) {
        is_on |= inside;
        ends_on |= k >= last;
        if (!inside) rest += own[k] * lengths_s[k];
      }
    }
    /* Work of a block that is switched off is done at the end, or in the other steps if the end has work. */
    if (is_on && ends_on && rest > 0.0) scale = work / rest;
    for (k = 0; k < steps; ++k) {
      if (k >= first && k < end) {
        *next++ = is_on ? off : on;
      } else if (is_on && !ends_on && k >= last) {
        *next++ = on;
      } else {
        *next++ = own[k] > RUNNING_SHARE * on ? scale * own[k] : own[k];
      }
    }
  }
  return (int)((next - proposals) / steps);
}

/* Find the powers of the plan that is cheapest when it is driven; returns 0 where that is the present one. */
static int find_cheaper_powers(const iptm_horizon *horizon, const iptm_switching *switching,
                               const memory *m, const iptm_real *parameters, const iptm_real *w) {
  const int steps = horizon->steps, count = propose(horizon, switching, m->powers, m->proposals);
  const iptm_real *step_parameters = parameters + IPTM_GLOBALS;
  iptm_real *states = m->states, *ends = m->ends;
  int kind, k = 0, i, each, best = 0;
  for (each = 0; each < count; ++each) {
    memcpy(states + (ptrdiff_t)IPTM_STATES * each, w, sizeof(iptm_real) * IPTM_STATES);
    m->costs[each] = 0.0;
  }
  for (kind = 0; kind < IPTM_KINDS; ++kind) {
    for (i = 0; i < horizon->kind_steps[kind]; ++i, ++k) {
      const iptm_real *const arg[] = {states, w + (ptrdiff_t)IPTM_BLOCK * k + IPTM_STATES, step_parameters,
                                      parameters, m->inputs};
      iptm_real *const res[] = {ends, m->step_costs};
      for (each = 0; each < count; ++each) {
        iptm_real *const power = m->proposals + (ptrdiff_t)steps * each + k;
        const iptm_real last = states[IPTM_STATES * each + IPTM_STATE_LAST_COMPRESSOR_POWER];
        *power = clamp(*power, last - m->ramps[k], last + m->ramps[k]);
        m->inputs[each] = *power;
      }
      iptm_follow[kind](arg, res, count);
      for (each = 0; each < count; ++each) m->costs[each] += m->step_costs[each];
      ends = states;
      states = res[0];
      step_parameters += iptm_kind_parameters[kind];
    }
  }
  for (each = 1; each < count; ++each) {
    if (m->costs[each] < m->costs[best]) best = each;
  }
  if (m->costs[best] >= m->costs[0] - LEAST_GAIN) return 0;
  memcpy(m->chosen, m->proposals + (ptrdiff_t)steps * best, sizeof(iptm_real) * (size_t)steps);
  return 1;
}

/* Put powers into variables, as the rate limit lets the compressor follow them. */
static void put_powers(const iptm_horizon *horizon, const memory *m, iptm_real *w) {
  iptm_real last = w[IPTM_STATE_LAST_COMPRESSOR_POWER];
  int k;
  for (k = 0; k < horizon->steps; ++k) {
    iptm_real *const block = w + (ptrdiff_t)IPTM_BLOCK * k;
    last = clamp(m->chosen[k], last - m->ramps[k], last + m->ramps[k]);
    block[POWER] = last;
    block[IPTM_BLOCK + IPTM_STATE_LAST_COMPRESSOR_POWER] = last;
  }
}

int iptm_solve_checked(const iptm_horizon *horizon, const iptm_options *options,
                       const iptm_switching *switching, const iptm_real *parameters,
                       const iptm_real *guess, int *since_second, iptm_real *variables, iptm_real *costates,
                       iptm_real *work, iptm_outcome *outcome) {
  const int steps = horizon->steps;
  const size_t variable_count = (size_t)steps * IPTM_BLOCK + IPTM_STATES;
  const size_t costate_count = (size_t)steps * IPTM_STATES;
  iptm_options second_options = *options;
  iptm_outcome second;
  memory m;
  int is_usable, has_second = 1, k;
  (void)lay_out(&m, horizon, work);
  iptm_solve(horizon, options, parameters, guess, variables, costates, m.solve, outcome);
  is_usable = iptm_is_usable(outcome);
  find_ramps(horizon, switching->rate_1_s, parameters, m.ramps);
  if (is_usable) {
    const start_kind kind = find_better_powers(horizon, switching, &m, parameters, variables, costates,
                                               outcome->point.cost, *since_second >= switching->try_every);
    const int is_cheaper = kind != PROMISING && switching->simulates &&
                           find_cheaper_powers(horizon, switching, &m, parameters, variables);
    has_second = kind != NONE || is_cheaper;
    if (second_options.max_iterations > SECOND_ITERATIONS) {
      second_options.max_iterations = SECOND_ITERATIONS;
    }
  } else {
    for (k = 0; k < steps; ++k) m.chosen[k] = switching->candidates[IPTM_CANDIDATES - 1];
  }
  /* One cold start a tick: where the first solve needed it, the second one ends with the warm start. */
  if (outcome->cold_starts > 0 && options->warm_start_iterations > 0 &&
      second_options.max_iterations > options->warm_start_iterations) {
    second_options.max_iterations = options->warm_start_iterations;
  }
  ++*since_second;
  if (!has_second) return outcome->iterations;
  *since_second = 0;
  memcpy(m.start, is_usable ? variables : guess, sizeof(iptm_real) * variable_count);
  put_powers(horizon, &m, m.start);
  iptm_solve(horizon, &second_options, parameters, m.start, m.variables, m.costates, m.solve,
             &second);
  k = outcome->iterations + second.iterations;
  if (iptm_is_usable(&second) &&
      (!is_usable || second.point.cost < outcome->point.cost - LEAST_GAIN)) {
    memcpy(variables, m.variables, sizeof(iptm_real) * variable_count);
    memcpy(costates, m.costates, sizeof(iptm_real) * costate_count);
    *outcome = second;
  }
  return k;
}
