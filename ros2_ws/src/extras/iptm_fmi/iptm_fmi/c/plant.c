/* The vehicle with its pack as a unit: plant.py and actuators.py of the plant in C99, the same operations in the same
 * order. With IPTM_METER it follows a measured speed, and its pack is cooled by a thermostat. */
#include <math.h>
#include <string.h>

#include "plant_constants.h"
#include "plant_numbers.h"
#include "road.h"
#include "unit.h"

void iptm_integrate(int n, const double *numbers, const double *held, const double *lengths_s,
                    const double *accelerations_m_s2, const double *slopes_rad, const double *speeds_m_s,
                    double *found);

#ifdef IPTM_LIMITED
int pack_bounds(const double **arguments, double **results, long long *, double *, int);
#endif

/* The motion of an interval at the stages of its sub-steps, see Motion. */
typedef struct {
  int steps;
  double lengths_s[IPTM_SUB_STEPS_MOST], accelerations_m_s2[IPTM_SUB_STEPS_MOST], speeds_m_s[3 * IPTM_SUB_STEPS_MOST];
  double positions_m[2 * IPTM_SUB_STEPS_MOST + 1];
  double end_m, end_m_s, end_m_s2;
} motion;

static double within(double value, double least, double most) {
  const double raised = value > least ? value : least;
  return raised < most ? raised : most;
}

/* Lay out a stretch of constant acceleration behind what is there. */
static void lay_out(motion *to, double position_m, double speed_m_s, double acceleration_m_s2, double length_s,
                    int count, double least_m_s) {
  const int first = to->steps;
  int i, place;
  for (i = 0; i <= 2 * count; ++i) {
    const double time_s = i == 2 * count ? length_s : i * (length_s / (2 * count));
    const double speed = fmax(speed_m_s + acceleration_m_s2 * time_s, least_m_s);
    to->positions_m[2 * first + i] =
        position_m + time_s * (speed_m_s + 0.5 * acceleration_m_s2 * time_s);
    for (place = 0; place < 3; ++place) {
      const int of = i - place;
      if (of >= 0 && of % 2 == 0 && of / 2 < count) to->speeds_m_s[3 * (first + of / 2) + place] = speed;
    }
  }
  for (i = first; i < first + count; ++i) {
    to->lengths_s[i] = length_s / count;
    to->accelerations_m_s2[i] = acceleration_m_s2;
  }
  to->steps = first + count;
  to->end_m = to->positions_m[2 * to->steps];
}

/* See plan_motion. */
static void plan(motion *to, double position_m, double speed_m_s, double acceleration_m_s2, double length_s) {
  const double least = -INFINITY;
  const double end_m_s = speed_m_s + acceleration_m_s2 * length_s;
  const int count = (int)fmax(2.0, ceil(length_s / IPTM_SUB_STEP_S - 1e-9));
  const int stops = end_m_s <= 0.0;
  to->steps = 0;
  if (speed_m_s < STANDSTILL_SPEED_M_S && acceleration_m_s2 < STANDSTILL_ACCELERATION_M_S2) {
    lay_out(to, position_m, 0.0, 0.0, length_s, count, least);
    to->end_m_s = to->end_m_s2 = 0.0;
  } else if (stops || (end_m_s > IPTM_MAX_SPEED_M_S && acceleration_m_s2 > 0.0)) {
    const double reached_m_s = stops ? 0.0 : IPTM_MAX_SPEED_M_S;
    const double until_s = fmin((reached_m_s - speed_m_s) / acceleration_m_s2, length_s);
    const int before = (int)within(ceil(count * until_s / length_s), 1, count - 1);
    lay_out(to, position_m, speed_m_s, acceleration_m_s2, until_s, before, stops ? ROLLING_M_S : least);
    lay_out(to, to->end_m, reached_m_s, 0.0, length_s - until_s, count - before, least);
    to->end_m_s = reached_m_s;
    to->end_m_s2 = 0.0;
  } else {
    lay_out(to, position_m, speed_m_s, acceleration_m_s2, length_s, count, least);
    to->end_m_s = to->speeds_m_s[3 * count - 1];
    to->end_m_s2 = acceleration_m_s2;
  }
}

/* Integrate the pack along a motion; found: states, integrals, and what is known at the end. */
static void integrate(const double *values, motion *along, double power_w, double length_s, int limits,
                      double *found) {
  double slopes_rad[2 * IPTM_SUB_STEPS_MOST + 1], held[4];
  int i;
  for (i = 0; i <= 2 * along->steps; ++i) {
    slopes_rad[i] = values[V_SLOPE] + iptm_slope_at((int)values[V_ROAD_NODES], values + V_ROAD_POSITION,
                                                    values + V_ROAD_SLOPE, along->positions_m[i]);
  }
  for (i = 0; i < along->steps; ++i) {
    along->accelerations_m_s2[i] = fmax(along->accelerations_m_s2[i], -IPTM_REGENERATIVE_M_S2);
  }
  held[0] = power_w;
  held[1] = values[V_STATE_OF_CHARGE];
#ifdef IPTM_LIMITED
  {
    /* What the motor may feed back at least, and what the pack gives at most. */
    const double *const given[] = {values + V_CELL_1_TEMPERATURE, held + 1, held, &length_s};
    double *const bounds[] = {held + 2};
    if (limits) {
      pack_bounds((const double **)given, (double **)bounds, NULL, NULL, 0);
    } else {
      held[2] = -INFINITY;
      held[3] = INFINITY;
    }
  }
#else
  (void)length_s, (void)limits;
#endif
  memset(found, 0, VALUES * sizeof(*found));
  memcpy(found, values + V_CELL_1_TEMPERATURE, 4 * sizeof(*found));
  iptm_integrate(along->steps, NULL, held, along->lengths_s, along->accelerations_m_s2, slopes_rad,
                 along->speeds_m_s, found);
}

#ifdef IPTM_METER
/* See thermostat_power_w. */
static double thermostat_w(const double *values) {
  const double warmest_k = fmax(values[V_CELL_1_TEMPERATURE], values[V_CELL_N_TEMPERATURE]);
  return fmin(THERMOSTAT_POWER_W * within((warmest_k - THERMOSTAT_ON_K) / THERMOSTAT_SPAN_K, 0.0, 1.0),
              IPTM_MAX_POWER_W);
}
#else
/* See limit_command. */
static double limited(double value, double least, double most, double last, double step) {
  return within(within(within(value, least, most), last - step, last + step), least, most);
}
#endif

iptm_result iptm_unit_begin(iptm_instance *instance) {
  double *const values = instance->now.values;
  double found[VALUES + IPTM_AT_END];
  motion along;
  plan(&along, values[V_POSITION], values[V_SPEED], 0.0, 1.0);
  integrate(values, &along, values[V_COMPRESSOR_POWER], 1.0, 0, found);
  if (!isfinite(found[VALUES]))
    return iptm_fail(instance, IPTM_REFUSED, "the pack cannot supply the state at the start");
  memcpy(values + V_AT_END, found + VALUES, IPTM_AT_END * sizeof(*found));
  return IPTM_DONE;
}

iptm_result iptm_unit_step(iptm_instance *instance, double length_s) {
  double *const values = instance->now.values;
  double found[VALUES + IPTM_AT_END], acceleration, power_w, charge;
  motion along;
  int i;
  const int fault = iptm_road_fault((int)values[V_ROAD_NODES], values + V_ROAD_POSITION);
  if (fault > 0)
    return iptm_fail(instance, IPTM_DISCARDED, "road_position[%d] is %g m; allowed: above %g m", fault + 1,
                     values[V_ROAD_POSITION + fault], values[V_ROAD_POSITION + fault - 1]);
#ifdef IPTM_METER
  acceleration = (values[V_SPEED_MEASURED] - values[V_SPEED]) / length_s;
  power_w = thermostat_w(values);
#else
  acceleration = limited(values[V_ACCELERATION_COMMAND], IPTM_MIN_ACCELERATION_M_S2,
                         IPTM_MAX_ACCELERATION_M_S2,
                         fmax(values[V_ACCELERATION], IPTM_MIN_ACCELERATION_M_S2), IPTM_MAX_JERK_M_S3 * length_s);
  power_w = limited(values[V_COMPRESSOR_POWER_COMMAND], IPTM_MIN_POWER_W, IPTM_MAX_POWER_W,
                    values[V_COMPRESSOR_POWER], IPTM_MAX_POWER_RATE_W_S * length_s);
#endif
  plan(&along, values[V_POSITION], values[V_SPEED], acceleration, length_s);
  integrate(values, &along, power_w, length_s, 1, found);
  /* Traction 4, regenerated 5, battery 6, chiller 7, heat 8, charge 9. */
  if (!isfinite(found[6] + found[9] + found[VALUES]))
    return iptm_fail(instance, IPTM_DISCARDED, "the pack cannot supply %g m/s^2 at %g m/s", acceleration,
                     values[V_SPEED]);
  charge = values[V_STATE_OF_CHARGE] -
           found[9] / 3600.0 /
               (IPTM_CAPACITY_AH * (1.0 - 0.5 * (values[V_CELL_1_LOSS] + values[V_CELL_N_LOSS])));
  if (fabs(charge - within(charge, 0.0, 1.0)) < ROUNDING) charge = within(charge, 0.0, 1.0);
  if (!(charge >= 0.0 && charge <= 1.0))
    return iptm_fail(instance, IPTM_DISCARDED, "the state of charge would be %g; allowed: 0 to 1", charge);
  values[V_STATE_OF_CHARGE] = charge;
  values[V_POSITION] = along.end_m;
  values[V_SPEED] = along.end_m_s;
  values[V_ACCELERATION] = along.end_m_s2;
  values[V_COMPRESSOR_POWER] = power_w;
  memcpy(values + V_CELL_1_TEMPERATURE, found, 4 * sizeof(*found));
  for (i = 4; i < VALUES; ++i) values[V_ENERGIES + i - 4] += found[i];
  values[V_COMPRESSOR_ENERGY] += power_w * length_s;
  memcpy(values + V_AT_END, found + VALUES, IPTM_AT_END * sizeof(*found));
  return IPTM_DONE;
}
