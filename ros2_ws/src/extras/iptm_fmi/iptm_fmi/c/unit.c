#include "unit.h"
#include "unit_constants.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double LATEST_S = 1e12;

void iptm_reset(iptm_instance *instance) {
  memset(instance, 0, sizeof(*instance));
  memcpy(instance->now.values, iptm_starts, sizeof(iptm_starts));
}

iptm_result iptm_fail(iptm_instance *instance, iptm_result result, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  (void)vsnprintf(instance->message, sizeof(instance->message), format, arguments);
  va_end(arguments);
  return result;
}

static const iptm_variable *variable_at(unsigned place) {
  unsigned i;
  for (i = 0; i < IPTM_UNIT_VARIABLES; ++i) {
    if (place - iptm_variables[i].first < iptm_variables[i].size) return &iptm_variables[i];
  }
  return NULL;
}

iptm_result iptm_read(iptm_instance *instance, unsigned place, double *value) {
  const iptm_variable *const variable = variable_at(place);
  if (place == IPTM_UNIT_VALUES) {
    *value = instance->now.time_s;
    return IPTM_DONE;
  }
  if (variable == NULL)
    return iptm_fail(instance, IPTM_REFUSED, "value reference %u; allowed: below %d", place, IPTM_UNIT_VALUES);
  if (instance->now.phase == IPTM_MADE && variable->kind == IPTM_OUTPUT)
    return iptm_fail(instance, IPTM_REFUSED, "%s is read before the initialization", variable->name);
  *value = instance->now.values[place];
  return IPTM_DONE;
}

iptm_result iptm_write(iptm_instance *instance, unsigned place, double value) {
  const iptm_variable *const variable = variable_at(place);
  if (variable == NULL)
    return iptm_fail(instance, IPTM_REFUSED, "value reference %u; allowed: below %d", place, IPTM_UNIT_VALUES);
  if (variable->kind == IPTM_OUTPUT)
    return iptm_fail(instance, IPTM_REFUSED, "%s is an output; allowed: inputs and starts", variable->name);
  if (variable->kind != IPTM_INPUT && instance->now.phase > IPTM_STARTING)
    return iptm_fail(instance, IPTM_REFUSED, "%s is fixed once the initialization has ended", variable->name);
  if (!(variable->least <= value && value <= variable->most))
    return iptm_fail(instance, IPTM_DISCARDED, "%s is %g; allowed: %g to %g", variable->name, value,
                     variable->least, variable->most);
  instance->now.values[place] = value;
  return IPTM_DONE;
}

void iptm_write_begins(iptm_instance *instance) {
  memcpy(instance->before.values, instance->now.values, sizeof(instance->now.values));
}

iptm_result iptm_write_ends(iptm_instance *instance, iptm_result result) {
  if (result != IPTM_DONE)
    memcpy(instance->now.values, instance->before.values, sizeof(instance->now.values));
  return result;
}

iptm_result iptm_start_at(iptm_instance *instance, double start_s) {
  if (!(start_s > -LATEST_S && start_s < LATEST_S))
    return iptm_fail(instance, IPTM_REFUSED, "the start is at %g s; allowed: within %g s", start_s, LATEST_S);
  instance->now.time_s = start_s;
  return IPTM_DONE;
}

iptm_result iptm_enter(iptm_instance *instance, double start_s) {
  if (instance->now.phase != IPTM_MADE)
    return iptm_fail(instance, IPTM_REFUSED, "the initialization is entered twice");
  if (iptm_start_at(instance, start_s) != IPTM_DONE) return IPTM_REFUSED;
  instance->now.phase = IPTM_STARTING;
  return IPTM_DONE;
}

iptm_result iptm_begin(iptm_instance *instance) {
  if (instance->now.phase != IPTM_STARTING)
    return iptm_fail(instance, IPTM_REFUSED, "the initialization has not been entered");
  if (iptm_unit_begin(instance) != IPTM_DONE) return IPTM_REFUSED;
  instance->now.phase = IPTM_STEPPING;
  return IPTM_DONE;
}

iptm_result iptm_step(iptm_instance *instance, double time_s, double length_s) {
  iptm_result result;
  if (instance->now.phase != IPTM_STEPPING)
    return iptm_fail(instance, IPTM_REFUSED, "a step outside of a simulation");
  if (!(fabs(time_s - instance->now.time_s) <= TOLERANCE_S))
    return iptm_fail(instance, IPTM_REFUSED, "the step begins at %g s; allowed: %g s", time_s,
                     instance->now.time_s);
  if (!(length_s > 0.0 && length_s <= IPTM_LONGEST_STEP_S))
    return iptm_fail(instance, IPTM_REFUSED, "the step is %g s long; allowed: above 0 to %g s", length_s,
                     (double)IPTM_LONGEST_STEP_S);
  memcpy(&instance->before, &instance->now, sizeof(iptm_state));
  result = iptm_unit_step(instance, length_s);
  if (result == IPTM_DONE) {
    instance->now.time_s += length_s;
  } else {
    memcpy(&instance->now, &instance->before, sizeof(iptm_state));
  }
  return result;
}

iptm_result iptm_keep(iptm_instance *instance, void **kept) {
  return iptm_from_bytes(instance, &instance->now, IPTM_STATE_BYTES, kept);
}

iptm_result iptm_restore(iptm_instance *instance, const void *kept) {
  if (kept == NULL) return iptm_fail(instance, IPTM_REFUSED, "no state");
  memcpy(&instance->now, kept, IPTM_STATE_BYTES);
  return IPTM_DONE;
}

iptm_result iptm_to_bytes(iptm_instance *instance, const void *kept, void *bytes, size_t size) {
  if (kept == NULL || bytes == NULL || size < IPTM_STATE_BYTES)
    return iptm_fail(instance, IPTM_REFUSED, "room for %lu bytes; allowed: a state of %lu", (unsigned long)size,
                     (unsigned long)IPTM_STATE_BYTES);
  memcpy(bytes, kept, IPTM_STATE_BYTES);
  return IPTM_DONE;
}

iptm_result iptm_from_bytes(iptm_instance *instance, const void *bytes, size_t size, void **kept) {
  if (bytes == NULL || kept == NULL || size != IPTM_STATE_BYTES)
    return iptm_fail(instance, IPTM_REFUSED, "%lu bytes; allowed: a state of %lu", (unsigned long)size,
                     (unsigned long)IPTM_STATE_BYTES);
  if (*kept == NULL) *kept = malloc(IPTM_STATE_BYTES);
  if (*kept == NULL) return iptm_fail(instance, IPTM_REFUSED, "no memory for a state");
  memcpy(*kept, bytes, IPTM_STATE_BYTES);
  return IPTM_DONE;
}

void iptm_drop(void **kept) {
  if (kept == NULL) return;
  free(*kept);
  *kept = NULL;
}
