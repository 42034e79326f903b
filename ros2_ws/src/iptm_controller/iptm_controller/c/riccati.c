#include "riccati.h"

#include <string.h>

#include "stages.h"
#include "riccati_constants.h"

enum { LOWER = IPTM_STATES * (IPTM_STATES + 1) / 2, FEEDBACK = IPTM_INPUTS * IPTM_STATES };

/* Scalars of an iterate and of its Newton step, see line_search.py. */
typedef struct {
  iptm_real stationarity, dynamics, inequalities, complementarity, complementarity_sum;
  iptm_real z_sum, lam_sum, corrected_pivots;
  iptm_real cost_slope_affine, cost_slope_centring, log_slope_affine, log_slope_centring;
  iptm_real primal_step_affine, dual_step_affine, s_dz_affine, z_ds_affine, ds_dz_affine;
} summary;

/* Variables, multipliers of the dynamics, slacks and multipliers of the inequality constraints. */
typedef struct {
  iptm_real *w, *lam, *s, *z;
} vectors;

/* Everything a solve works on: pointers into the memory of the caller. */
typedef struct {
  const iptm_horizon *horizon;
  const iptm_real *parameters;
  int variables, costates, inequalities; /* sizes of the vectors */
  vectors at, next, affine, centring;    /* iterate, trial point and the two parts of the step */
  /* Results of linearise, in its order, packed step after step. */
  iptm_real *dynamics_jacobian, *hessian, *gradient_affine, *gradient_centring, *dynamics_residual;
  iptm_real *inequality_jacobian, *inequality_residual, *cost_gradient, *norms[8];
  /* Cost to go at the nodes 1 to N + 1, where it is zero, and feedback of the steps. */
  iptm_real *P, *p_affine, *p_centring, *corrected, *K, *k_affine, *k_centring;
  /* Results of evaluate. */
  iptm_real *values, *residual, *costs;
  iptm_real *soft_slacks, *best_w;
  iptm_point *filter;
  iptm_point point, best;
  summary sums;
  iptm_real largest_violation, smallest_violation; /* bounds of the filter */
  int filter_size, has_best;
} method;

/* The larger and the smaller of two numbers; the first one where one is not a number. */
static iptm_real larger(iptm_real x, iptm_real y) { return y > x ? y : x; }
static iptm_real smaller(iptm_real x, iptm_real y) { return y < x ? y : x; }

/* As fmax of the C library, which ignores what is not a number; a selection where neither can be foreseen. */
static iptm_real maximum(iptm_real x, iptm_real y) {
  const iptm_real found = x > y ? x : y;
  return islessgreater(x, y) ? found : fmax(x, y);
}

static iptm_real *cut(iptm_real **free, size_t size) {
  iptm_real *start = *free;
  *free += size;
  return start;
}

static void cut_vectors(iptm_real **free, const method *m, vectors *v) {
  v->w = cut(free, (size_t)m->variables);
  v->lam = cut(free, (size_t)m->costates + IPTM_STATES) + IPTM_STATES; /* zeros stand for lam_0 */
  v->s = cut(free, (size_t)m->inequalities);
  v->z = cut(free, (size_t)m->inequalities);
}

/* Lay the memory out; returns the reals in use. */
static size_t lay_out(method *m, const iptm_horizon *horizon, iptm_real *work) {
  const size_t steps = (size_t)horizon->steps;
  iptm_real *free = work;
  int i;
  m->horizon = horizon;
  m->variables = horizon->steps * IPTM_BLOCK + IPTM_STATES;
  m->costates = horizon->steps * IPTM_STATES;
  m->inequalities = horizon->steps * IPTM_INEQUALITIES;
  cut_vectors(&free, m, &m->at);
  cut_vectors(&free, m, &m->next);
  cut_vectors(&free, m, &m->affine);
  cut_vectors(&free, m, &m->centring);
  m->dynamics_jacobian = cut(&free, steps * IPTM_DYNAMICS_NONZEROS);
  m->hessian = cut(&free, steps * IPTM_HESSIAN_NONZEROS);
  m->gradient_affine = cut(&free, steps * IPTM_BLOCK);
  m->gradient_centring = cut(&free, steps * IPTM_BLOCK);
  m->dynamics_residual = cut(&free, steps * IPTM_STATES);
  m->inequality_jacobian = cut(&free, steps * IPTM_INEQUALITY_NONZEROS);
  m->inequality_residual = cut(&free, steps * IPTM_INEQUALITIES);
  m->cost_gradient = cut(&free, steps * IPTM_BLOCK);
  for (i = 0; i < 8; ++i) m->norms[i] = cut(&free, steps);
  m->P = cut(&free, (steps + 1) * LOWER);
  m->p_affine = cut(&free, (steps + 1) * IPTM_STATES);
  m->p_centring = cut(&free, (steps + 1) * IPTM_STATES);
  m->corrected = cut(&free, steps + 1);
  m->K = cut(&free, steps * FEEDBACK);
  m->k_affine = cut(&free, steps * IPTM_INPUTS);
  m->k_centring = cut(&free, steps * IPTM_INPUTS);
  m->values = cut(&free, steps * IPTM_INEQUALITIES);
  m->residual = cut(&free, steps * IPTM_STATES);
  m->costs = cut(&free, steps);
  m->soft_slacks = cut(&free, steps * IPTM_SLACKS);
  m->best_w = cut(&free, (size_t)m->variables);
  m->filter = (iptm_point *)(void *)free;
  free += ((size_t)horizon->most_iterations + 1) * sizeof(iptm_point) / sizeof(iptm_real);
  return (size_t)(free - work);
}

size_t iptm_work_size(const iptm_horizon *horizon) {
  method m;
  iptm_real origin;
  return lay_out(&m, horizon, &origin);
}

/* Point to states, inputs, next states and parameters of the first step of a kind. */
static void stage_arguments(const method *m, const iptm_real *w, int first, int offset,
                            const iptm_real **arg) {
  arg[0] = w + (ptrdiff_t)IPTM_BLOCK * first;
  arg[1] = arg[0] + IPTM_STATES;
  arg[2] = arg[0] + IPTM_BLOCK;
  arg[3] = m->parameters + offset;
  arg[4] = m->parameters;
}

static void evaluate(method *m, const iptm_real *w) {
  int kind, first = 0, offset = IPTM_GLOBALS;
  for (kind = 0; kind < IPTM_KINDS; ++kind) {
    const int count = m->horizon->kind_steps[kind];
    const iptm_real *arg[5];
    iptm_real *res[3];
    stage_arguments(m, w, first, offset, arg);
    res[0] = m->values + (ptrdiff_t)IPTM_INEQUALITIES * first;
    res[1] = m->residual + (ptrdiff_t)IPTM_STATES * first;
    res[2] = m->costs + first;
    iptm_evaluate[kind](arg, res, count);
    first += count;
    offset += count * iptm_kind_parameters[kind];
  }
}

static void linearise(method *m) {
  int kind, first = 0, offset = IPTM_GLOBALS;
  for (kind = 0; kind < IPTM_KINDS; ++kind) {
    const int count = m->horizon->kind_steps[kind];
    const iptm_real *arg[9];
    iptm_real *res[16];
    int i;
    stage_arguments(m, m->at.w, first, offset, arg);
    arg[6] = m->at.lam + (ptrdiff_t)IPTM_STATES * first;
    arg[5] = arg[6] - IPTM_STATES;
    arg[7] = m->at.s + (ptrdiff_t)IPTM_INEQUALITIES * first;
    arg[8] = m->at.z + (ptrdiff_t)IPTM_INEQUALITIES * first;
    res[0] = m->dynamics_jacobian + (ptrdiff_t)IPTM_DYNAMICS_NONZEROS * first;
    res[1] = m->hessian + (ptrdiff_t)IPTM_HESSIAN_NONZEROS * first;
    res[2] = m->gradient_affine + (ptrdiff_t)IPTM_BLOCK * first;
    res[3] = m->gradient_centring + (ptrdiff_t)IPTM_BLOCK * first;
    res[4] = m->dynamics_residual + (ptrdiff_t)IPTM_STATES * first;
    res[5] = m->inequality_jacobian + (ptrdiff_t)IPTM_INEQUALITY_NONZEROS * first;
    res[6] = m->inequality_residual + (ptrdiff_t)IPTM_INEQUALITIES * first;
    res[7] = m->cost_gradient + (ptrdiff_t)IPTM_BLOCK * first;
    for (i = 0; i < 8; ++i) res[8 + i] = m->norms[i] + first;
    iptm_linearise[kind](arg, res, count);
    first += count;
    offset += count * iptm_kind_parameters[kind];
  }
}

static void backward(method *m, iptm_real delta) {
  const int steps = m->horizon->steps;
  int k;
  memset(m->P + (ptrdiff_t)LOWER * steps, 0, sizeof(iptm_real) * LOWER);
  memset(m->p_affine + (ptrdiff_t)IPTM_STATES * steps, 0, sizeof(iptm_real) * IPTM_STATES);
  memset(m->p_centring + (ptrdiff_t)IPTM_STATES * steps, 0, sizeof(iptm_real) * IPTM_STATES);
  m->corrected[steps] = 0.0;
  for (k = steps - 1; k >= 0; --k) {
    const ptrdiff_t step = k;
    const iptm_real *const arg[] = {
        m->P + LOWER * (step + 1),
        m->p_affine + IPTM_STATES * (step + 1),
        m->p_centring + IPTM_STATES * (step + 1),
        m->corrected + step + 1,
        m->dynamics_jacobian + IPTM_DYNAMICS_NONZEROS * step,
        m->hessian + IPTM_HESSIAN_NONZEROS * step,
        m->gradient_affine + IPTM_BLOCK * step,
        m->gradient_centring + IPTM_BLOCK * step,
        m->dynamics_residual + IPTM_STATES * step,
        &delta,
    };
    iptm_real *const res[] = {
        m->P + LOWER * step,
        m->p_affine + IPTM_STATES * step,
        m->p_centring + IPTM_STATES * step,
        m->corrected + step,
        m->K + FEEDBACK * step,
        m->k_affine + IPTM_INPUTS * step,
        m->k_centring + IPTM_INPUTS * step,
    };
    riccati_backward(arg, res);
  }
}

static void forward(method *m) {
  const int steps = m->horizon->steps;
  int k;
  memset(m->affine.w, 0, sizeof(iptm_real) * IPTM_STATES);
  memset(m->centring.w, 0, sizeof(iptm_real) * IPTM_STATES);
  for (k = 0; k < steps; ++k) {
    const ptrdiff_t step = k, block = IPTM_BLOCK * step, row = IPTM_INEQUALITIES * step;
    const ptrdiff_t state = IPTM_STATES * step;
    const iptm_real *const arg[] = {
        m->affine.w + block,
        m->centring.w + block,
        m->P + LOWER * (step + 1),
        m->p_affine + state + IPTM_STATES,
        m->p_centring + state + IPTM_STATES,
        m->K + FEEDBACK * step,
        m->k_affine + IPTM_INPUTS * step,
        m->k_centring + IPTM_INPUTS * step,
        m->dynamics_jacobian + IPTM_DYNAMICS_NONZEROS * step,
        m->dynamics_residual + state,
        m->inequality_jacobian + IPTM_INEQUALITY_NONZEROS * step,
        m->inequality_residual + row,
        m->at.s + row,
        m->at.z + row,
        m->at.lam + state,
    };
    iptm_real *const res[] = {
        m->affine.w + block + IPTM_BLOCK,
        m->centring.w + block + IPTM_BLOCK,
        m->affine.w + block + IPTM_STATES,
        m->centring.w + block + IPTM_STATES,
        m->affine.lam + state,
        m->centring.lam + state,
        m->affine.s + row,
        m->centring.s + row,
        m->affine.z + row,
        m->centring.z + row,
    };
    riccati_forward(arg, res);
  }
}

static iptm_real largest(const iptm_real *x, int size, iptm_real start) {
  iptm_real result = start;
  int i;
  for (i = 0; i < size; ++i) result = maximum(result, x[i]);
  return result;
}

static iptm_real total(const iptm_real *x, int size) {
  iptm_real sum = 0.0;
  int i;
  for (i = 0; i < size; ++i) sum += x[i];
  return sum;
}

static iptm_real dot(const iptm_real *x, const iptm_real *y, int size) {
  iptm_real sum = 0.0;
  int i;
  for (i = 0; i < size; ++i) sum += x[i] * y[i];
  return sum;
}

/* Compute the Newton step with delta added to the diagonal of the Hessian, and its summary. */
static void newton_step(method *m, iptm_real delta) {
  const int steps = m->horizon->steps, blocks = steps * IPTM_BLOCK, rows = m->inequalities;
  const vectors *at = &m->at, *affine = &m->affine, *centring = &m->centring;
  summary *sums = &m->sums;
  iptm_real log_affine = 0.0, log_centring = 0.0, primal = -INFINITY, dual = -INFINITY;
  int i;
  linearise(m);
  backward(m, delta);
  forward(m);
  /* x_0 is given: nothing is asked of the gradient there. */
  sums->stationarity = maximum(-INFINITY, 0.0);
  sums->stationarity = largest(m->norms[0] + 1, steps - 1, sums->stationarity);
  sums->stationarity = largest(m->norms[1], steps, sums->stationarity);
  sums->dynamics = largest(m->norms[2], steps, -INFINITY);
  sums->inequalities = largest(m->norms[3], steps, -INFINITY);
  sums->complementarity = largest(m->norms[4], steps, -INFINITY);
  sums->complementarity_sum = total(m->norms[5], steps);
  sums->z_sum = total(m->norms[6], steps);
  sums->lam_sum = total(m->norms[7], steps);
  sums->corrected_pivots = m->corrected[0];
  sums->cost_slope_affine = dot(m->cost_gradient, affine->w, blocks);
  sums->cost_slope_centring = dot(m->cost_gradient, centring->w, blocks);
  for (i = 0; i < rows; ++i) {
    const iptm_real relative = affine->s[i] / at->s[i];
    log_affine += relative;
    log_centring += centring->s[i] / at->s[i];
    primal = maximum(primal, -relative);
    dual = maximum(dual, -(affine->z[i] / at->z[i]));
  }
  sums->log_slope_affine = log_affine;
  sums->log_slope_centring = log_centring;
  sums->primal_step_affine = 1.0 / maximum(1.0, primal);
  sums->dual_step_affine = 1.0 / maximum(1.0, dual);
  sums->s_dz_affine = dot(at->s, affine->z, rows);
  sums->z_ds_affine = dot(at->z, affine->s, rows);
  sums->ds_dz_affine = dot(affine->s, affine->z, rows);
}

static int summary_is_usable(const summary *sums) {
  if (!isfinite(sums->cost_slope_affine + sums->cost_slope_centring + sums->ds_dz_affine)) return 0;
  return sums->corrected_pivots == 0.0 || sums->primal_step_affine > LEAST_PRIMAL_STEP;
}

static iptm_real kkt_error(const method *m) {
  const summary *sums = &m->sums;
  const iptm_real mean = (sums->z_sum + sums->lam_sum) / (m->inequalities + m->costates);
  const iptm_real dual_scale = larger(MULTIPLIER_SCALE, mean) / MULTIPLIER_SCALE;
  const iptm_real complementarity_scale =
      larger(MULTIPLIER_SCALE, sums->z_sum / m->inequalities) / MULTIPLIER_SCALE;
  iptm_real error = sums->stationarity / dual_scale;
  error = larger(error, sums->dynamics);
  error = larger(error, sums->inequalities);
  return larger(error, sums->complementarity / complementarity_scale);
}

static iptm_real barrier_parameter(const method *m, iptm_real tolerance, iptm_real safeguard) {
  const summary *sums = &m->sums;
  const iptm_real primal = sums->primal_step_affine, dual = sums->dual_step_affine;
  const iptm_real affine_sum = sums->complementarity_sum + primal * sums->z_ds_affine +
                            dual * sums->s_dz_affine + primal * dual * sums->ds_dz_affine;
  const iptm_real ratio = smaller(larger(affine_sum / sums->complementarity_sum, 0.0), 1.0);
  const iptm_real mean = sums->complementarity_sum / m->inequalities;
  const iptm_real floor = smaller(mean, safeguard * larger(sums->stationarity, sums->inequalities));
  return larger(larger(pow(ratio, CENTRING_EXPONENT) * mean, floor), LEAST_BARRIER * tolerance);
}

static iptm_real barrier_objective(const iptm_point *point, iptm_real mu) {
  return point->cost - mu * point->log_sum;
}

static int improves(const iptm_point *trial, iptm_real phi, const iptm_point *other, iptm_real mu,
                    iptm_real tolerance) {
  const iptm_real bound = barrier_objective(other, mu) - MARGIN * other->violation + tolerance;
  return trial->violation <= (1.0 - MARGIN) * other->violation + IPTM_VIOLATION_ROUND_OFF ||
         phi <= bound;
}

static int is_descent_step(const method *m, iptm_real slope, iptm_real length) {
  const iptm_real violation = m->point.violation;
  if (slope >= 0.0 || violation > m->smallest_violation) return 0;
  return length * pow(-slope, SWITCHING_SLOPE_EXPONENT) >
         pow(violation, SWITCHING_VIOLATION_EXPONENT);
}

/* Judge a trial point; the filter is augmented unless the step is one of descent. */
static int accepts(method *m, const iptm_point *trial, iptm_real mu, iptm_real slope,
                   iptm_real length) {
  const iptm_real phi = barrier_objective(trial, mu), phi_now = barrier_objective(&m->point, mu);
  const iptm_real tolerance = IPTM_ROUND_OFF * larger(1.0, fabs(phi_now));
  int i;
  if (!(trial->violation <= m->largest_violation)) return 0;
  for (i = 0; i < m->filter_size; ++i) {
    if (!improves(trial, phi, &m->filter[i], mu, tolerance)) return 0;
  }
  if (is_descent_step(m, slope, length)) return phi <= phi_now + ARMIJO * length * slope + tolerance;
  if (!improves(trial, phi, &m->point, mu, tolerance)) return 0;
  m->filter[m->filter_size++] = m->point;
  return 1;
}

/* Cost, logarithms and violation of an iterate from what evaluate returned for it. */
static iptm_point filter_point(const method *m, const iptm_real *s) {
  iptm_point point = {0.0, 0.0, 0.0, 0.0};
  int i;
  point.cost = total(m->costs, m->horizon->steps);
  for (i = 0; i < m->costates; ++i) {
    const iptm_real size = fabs(m->residual[i]);
    point.violation += size;
    point.largest_violation = maximum(point.largest_violation, size);
  }
  for (i = 0; i < m->inequalities; ++i) {
    const iptm_real size = fabs(m->values[i] - s[i]);
    point.log_sum += log(s[i]);
    point.violation += size;
    point.largest_violation = maximum(point.largest_violation, size);
  }
  return point;
}

/* Take a step to the fraction to the boundary times backtracking, and evaluate there. */
static iptm_point trial_point(method *m, iptm_real mu, iptm_real backtracking, iptm_real *length) {
  const vectors *at = &m->at, *next = &m->next, *affine = &m->affine, *centring = &m->centring;
  iptm_real primal = -INFINITY, dual = -INFINITY;
  int i;
  for (i = 0; i < m->inequalities; ++i) {
    next->s[i] = affine->s[i] + mu * centring->s[i];
    next->z[i] = affine->z[i] + mu * centring->z[i];
    primal = maximum(primal, -(next->s[i] / at->s[i]));
    dual = maximum(dual, -(next->z[i] / at->z[i]));
  }
  *length = backtracking / maximum(1.0, primal / FRACTION_TO_BOUNDARY);
  dual = maximum(1.0, dual / FRACTION_TO_BOUNDARY);
  for (i = 0; i < m->variables; ++i) {
    next->w[i] = at->w[i] + *length * (affine->w[i] + mu * centring->w[i]);
  }
  for (i = 0; i < m->costates; ++i) {
    next->lam[i] = at->lam[i] + *length * (affine->lam[i] + mu * centring->lam[i]);
  }
  evaluate(m, next->w);
  for (i = 0; i < m->inequalities; ++i) {
    /* Slack reset: a slack below its constraint costs barrier objective and violation for nothing. */
    next->s[i] = maximum(at->s[i] + *length * next->s[i], m->values[i]);
    next->z[i] = at->z[i] + next->z[i] / dual;
  }
  return filter_point(m, next->s);
}

/* Backtrack until a trial point is accepted; returns the number of trials, 0 if none is. */
static int line_search(method *m, iptm_real mu, iptm_point *there) {
  const summary *sums = &m->sums;
  iptm_real slope = sums->cost_slope_affine + mu * sums->cost_slope_centring;
  iptm_real backtracking = 1.0;
  int trial;
  slope -= mu * (sums->log_slope_affine + mu * sums->log_slope_centring);
  for (trial = 1; trial <= MAX_TRIALS; ++trial) {
    iptm_real length;
    *there = trial_point(m, mu, backtracking, &length);
    if (accepts(m, there, mu, slope, length)) return trial;
    backtracking *= BACKTRACKING;
  }
  return 0;
}

/* Move to the next iterate, regularising the Hessian until a step is accepted; returns 0 if none is. */
static int move(method *m, iptm_real *delta, iptm_real tolerance, iptm_real safeguard) {
  int attempt;
  for (attempt = 0; attempt < MAX_REGULARISATIONS; ++attempt) {
    iptm_point there;
    vectors passed;
    int trials;
    if (attempt > 0) {
      *delta = larger(REGULARISATION_FACTOR * *delta, FIRST_REGULARISATION);
      newton_step(m, *delta);
    }
    if (!summary_is_usable(&m->sums)) continue;
    trials = line_search(m, barrier_parameter(m, tolerance, safeguard), &there);
    if (trials == 0) continue;
    if (attempt == 0 && trials == 1) {
      *delta = *delta > LEAST_REGULARISATION ? *delta / REGULARISATION_FACTOR : 0.0;
    }
    passed = m->at;
    m->at = m->next;
    m->next = passed;
    m->point = there;
    return 1;
  }
  return 0;
}

/* Make the first iterate: z from the barrier, soft slacks as their penalties would have them. */
static void begin(method *m, const iptm_real *guess, iptm_real mu, int relax) {
  const int steps = m->horizon->steps, hard = IPTM_BLOCK - IPTM_SLACKS;
  const int hard_rows = IPTM_INEQUALITIES - IPTM_SLACKS;
  vectors *at = &m->at;
  int kind, first = 0, offset = IPTM_GLOBALS, k, i;
  for (kind = 0; kind < IPTM_KINDS; ++kind) {
    const int count = m->horizon->kind_steps[kind];
    const iptm_real *arg[5];
    iptm_real *res[1];
    stage_arguments(m, guess, first, offset, arg);
    res[0] = m->soft_slacks + (ptrdiff_t)IPTM_SLACKS * first;
    iptm_least_slacks[kind](arg, res, count);
    first += count;
    offset += count * iptm_kind_parameters[kind];
  }
  memcpy(at->w, guess, sizeof(iptm_real) * (size_t)m->variables);
  memset(at->lam - IPTM_STATES, 0, sizeof(iptm_real) * ((size_t)m->costates + IPTM_STATES));
  memset(m->next.lam - IPTM_STATES, 0, sizeof(iptm_real) * IPTM_STATES);
  for (k = 0; k < steps; ++k) {
    iptm_real *slacks = at->w + (ptrdiff_t)IPTM_BLOCK * k + hard;
    for (i = 0; i < IPTM_SLACKS; ++i) {
      /* A soft slack that is not needed is held off zero by its whole price: slack times price is mu. */
      const int place = IPTM_SLACKS * k + i;
      slacks[i] = maximum(slacks[i], relax * m->soft_slacks[place]);
      slacks[i] = maximum(slacks[i], mu / m->horizon->soft_prices[place]);
    }
  }
  evaluate(m, at->w);
  for (k = 0; k < steps; ++k) {
    const iptm_real *slacks = at->w + (ptrdiff_t)IPTM_BLOCK * k + hard;
    const ptrdiff_t row = (ptrdiff_t)IPTM_INEQUALITIES * k;
    for (i = 0; i < IPTM_INEQUALITIES; ++i) {
      const iptm_real s =
          i < hard_rows ? maximum(m->values[row + i], LEAST_SLACK) : slacks[i - hard_rows];
      at->s[row + i] = s;
      at->z[row + i] = mu / s;
    }
  }
  m->point = filter_point(m, at->s);
}

static int parameter_count(const iptm_horizon *horizon) {
  int kind, count = IPTM_GLOBALS;
  for (kind = 0; kind < IPTM_KINDS; ++kind) {
    count += horizon->kind_steps[kind] * iptm_kind_parameters[kind];
  }
  return count;
}

/* Iterate from a start; iterations is counted up. */
static iptm_termination run_from(method *m, const iptm_options *options, const iptm_real *guess,
                                 int most_iterations, int is_cold, int *iterations) {
  const iptm_real safeguard = is_cold ? COLD_START_SAFEGUARD : 0.0;
  const iptm_real tolerance = larger(options->tolerance, IPTM_LEAST_TOLERANCE);
  iptm_real delta = 0.0, given, reference;
  int iteration;
  begin(m, guess, is_cold ? COLD_START_BARRIER : options->initial_barrier, is_cold);
  /* A sum is finite only if every term is. */
  given = total(guess, m->variables) + total(m->parameters, parameter_count(m->horizon));
  if (!isfinite(given + m->point.cost + m->point.violation)) {
    memcpy(m->at.w, guess, sizeof(iptm_real) * (size_t)m->variables);
    m->point.cost = m->point.log_sum = NAN;
    m->point.violation = m->point.largest_violation = INFINITY;
    return IPTM_NOT_FINITE;
  }
  reference = larger(1.0, m->point.violation);
  m->largest_violation = MAX_VIOLATION_FACTOR * reference;
  m->smallest_violation = MIN_VIOLATION_FACTOR * reference;
  m->filter_size = 0;
  for (iteration = 0;; ++iteration, ++*iterations) {
    iptm_real error;
    if (!(m->point.largest_violation > FEASIBILITY_TOLERANCE) &&
        (!m->has_best || m->point.cost < m->best.cost)) {
      memcpy(m->best_w, m->at.w, sizeof(iptm_real) * (size_t)m->variables);
      m->best = m->point;
      m->has_best = 1;
    }
    newton_step(m, delta);
    error = kkt_error(m);
    if (!isfinite(error)) return IPTM_NOT_FINITE;
    if (error <= tolerance) return IPTM_CONVERGED;
    if (iteration >= most_iterations) return IPTM_ITERATIONS;
    if (options->clock_s != NULL && options->clock_s() > options->until_s) return IPTM_DEADLINE;
    if (!move(m, &delta, tolerance, safeguard)) return IPTM_STALLED;
  }
}

void iptm_solve(const iptm_horizon *horizon, const iptm_options *options, const iptm_real *parameters,
                const iptm_real *guess, iptm_real *variables, iptm_real *costates, iptm_real *work,
                iptm_outcome *outcome) {
  method m;
  const iptm_real *answer;
  iptm_termination termination;
  const int most = options->max_iterations;
  const int few = options->warm_start_iterations < most ? options->warm_start_iterations : most;
#ifdef IPTM_NUMBERS_GIVEN
  iptm_numbers = horizon->numbers;
#endif
  (void)lay_out(&m, horizon, work);
  m.parameters = parameters;
  m.has_best = 0;
  outcome->iterations = 0;
  outcome->cold_starts = 0;
  termination = run_from(&m, options, guess, few, 0, &outcome->iterations);
  if ((termination == IPTM_ITERATIONS || termination == IPTM_STALLED) &&
      most > outcome->iterations) {
    outcome->cold_starts = 1;
    termination =
        run_from(&m, options, guess, most - outcome->iterations, 1, &outcome->iterations);
  }
  answer = m.at.w;
  outcome->point = m.point;
  if (termination != IPTM_CONVERGED && m.has_best) {
    answer = m.best_w;
    outcome->point = m.best;
  }
  outcome->termination = (int)termination;
  memcpy(variables, answer, sizeof(iptm_real) * (size_t)m.variables);
  memcpy(costates, m.at.lam, sizeof(iptm_real) * (size_t)m.costates);
}

int iptm_is_usable(const iptm_outcome *outcome) {
  return outcome->point.largest_violation <= FEASIBILITY_TOLERANCE;
}
