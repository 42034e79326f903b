/* Prices of the temperatures at the end of the horizon by the law of the paper: TemperatureValuation in C99, the
 * same operations in the same order. */
#ifndef IPTM_PRICES_H
#define IPTM_PRICES_H

/* Numbers of pack, aging law and trip. */
typedef struct {
  double aging_weight, horizon_s, trip_duration_s; /* trip_duration_s: infinite where it is not known */
  double share_1, share_n;                         /* how the coolant mixes the cells */
  double performance, heat_capacity_j_k;
  double rate_at_1_c_1_s, energy_at_1_c_j_mol;     /* of eq. (12) at a C-rate of 1, without its exponential */
  double activation_energy_j_mol, compensation_factor_j_mol, gas_constant_j_mol_k;
  double throughput_exponent, memory_exponent;
  double capacity_ah, parallel, voltage_v;
} iptm_valuation;

/* A trip so far. */
typedef struct {
  double time_s, temperature_k, capacity_loss; /* now: mean of the cells, and sum of their losses */
  double elapsed_s, lost;                      /* since the trip began */
  double foreseen_1_s;                         /* aging rate of both cells that was expected then */
} iptm_aged;

/* As in TemperatureValue. */
typedef struct {
  double cell_1_marginal_cost_1_k, cell_n_marginal_cost_1_k;
  double aging_rate_1_s, aging_sensitivity_1_k, temperature_decay_time_s;
} iptm_temperature_value;

void iptm_value_temperatures(const iptm_valuation *valuation, const iptm_aged *aged,
                             iptm_temperature_value *value);

#endif
