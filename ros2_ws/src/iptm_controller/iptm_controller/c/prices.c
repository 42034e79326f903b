#include "prices.h"
#include "prices_constants.h"

#include <math.h>

static const volatile double TWO = 2.0; /* with pow it squares as Python does, where a product may differ in the last bit */

static double least(double x, double y) { return y < x ? y : x; }
static double most(double x, double y) { return y > x ? y : x; }

/* Growth of the logarithm of the aging rate with the C-rate. */
static double load_factor_h(const iptm_valuation *v, double temperature_k) {
  return v->compensation_factor_j_mol /
         (v->throughput_exponent * v->gas_constant_j_mol_k * temperature_k);
}

static double mean_c_rate_1_h(const iptm_valuation *v, double rate_1_s, double temperature_k,
                              double capacity_loss) {
  const double exponent = v->energy_at_1_c_j_mol / (v->gas_constant_j_mol_k * temperature_k) /
                          v->throughput_exponent;
  const double at_1_c = v->rate_at_1_c_1_s * exp(exponent) * pow(capacity_loss, v->memory_exponent);
  const double b = load_factor_h(v, temperature_k), target = log(rate_1_s / at_1_c) + b;
  double c_rate = exp(least(target, 0.0));
  int i;
  for (i = 0; i < C_RATE_ITERATIONS; ++i) {
    c_rate *= (1.0 + target - log(c_rate)) / (1.0 + b * c_rate);
  }
  return c_rate;
}

/* Time after which cooling a kelvin away has saved what it has aged the cells. */
static double payback_s(const iptm_valuation *v, double c_rate_1_h, double load,
                        double sensitivity_1_k) {
  const double power_w = c_rate_1_h * v->capacity_ah * v->parallel * v->voltage_v;
  if (v->performance <= 0.0) return INFINITY;
  return v->heat_capacity_j_k * (1.0 + load) / (v->performance * sensitivity_1_k * power_w);
}

void iptm_value_temperatures(const iptm_valuation *valuation, const iptm_aged *aged,
                             iptm_temperature_value *value) {
  const iptm_valuation *v = valuation;
  const double temperature_k = aged->temperature_k;
  const double mean_1_s = (aged->lost + aged->foreseen_1_s * FORECAST_WEIGHT_S) /
                          (aged->elapsed_s + FORECAST_WEIGHT_S);
  const double rate = most(mean_1_s, LEAST_RATE_1_S);
  const double c_rate =
      mean_c_rate_1_h(v, 0.5 * rate, temperature_k, 0.5 * aged->capacity_loss);
  const double load = load_factor_h(v, temperature_k) * c_rate;
  const double molar_k = v->throughput_exponent * v->gas_constant_j_mol_k * pow(temperature_k, TWO);
  const double sensitivity = v->activation_energy_j_mol / molar_k - load / temperature_k;
  const double remaining_s = most(v->trip_duration_s - aged->time_s - v->horizon_s, 0.0);
  double lasting_s = least(payback_s(v, c_rate, load, sensitivity), remaining_s);
  double price;
  if (isinf(lasting_s)) lasting_s = 0.0; /* neither is known: nothing to base a price on */
  price = v->aging_weight * sensitivity * rate * lasting_s;
  value->cell_1_marginal_cost_1_k = v->share_1 * price;
  value->cell_n_marginal_cost_1_k = v->share_n * price;
  value->aging_rate_1_s = rate;
  value->aging_sensitivity_1_k = sensitivity;
  value->temperature_decay_time_s = lasting_s;
}
