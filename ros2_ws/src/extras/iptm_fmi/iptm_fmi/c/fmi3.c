/* The functions of FMI 3.0 for co-simulation around a unit; those that it has no use for are in fmi3_unused.c. */
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "unit.h"

typedef struct {
  iptm_instance unit;
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
} component;

static fmi3Status given(component *one, iptm_result result) {
  const fmi3Status status = result == IPTM_DONE ? fmi3OK : result == IPTM_DISCARDED ? fmi3Discard : fmi3Error;
  if (status != fmi3OK && one->log != NULL) one->log(one->environment, status, "iptm", one->unit.message);
  return status;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[]) {
  (void)c, (void)on, (void)n, (void)names;
  return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                         fmi3Boolean early, const fmi3ValueReference needed[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
  component *one;
  (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)needed, (void)n;
  (void)update;
  if (token == NULL || strcmp(token, IPTM_TOKEN) != 0) {
    if (log != NULL) log(environment, fmi3Error, "iptm", "the instantiation token is that of another file");
    return NULL;
  }
  one = (component *)calloc(1, sizeof(component));
  if (one == NULL) return NULL;
  iptm_reset(&one->unit);
  one->environment = environment;
  one->log = log;
  return one;
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean defined, fmi3Float64 tolerance,
                                       fmi3Float64 start_s, fmi3Boolean ends, fmi3Float64 stop_s) {
  component *const one = (component *)c;
  (void)defined, (void)tolerance, (void)ends, (void)stop_s;
  return given(one, iptm_enter(&one->unit, start_s));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
  component *const one = (component *)c;
  return given(one, iptm_begin(&one->unit));
}

fmi3Status fmi3Terminate(fmi3Instance c) {
  ((component *)c)->unit.now.phase = IPTM_ENDED;
  return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c) {
  iptm_reset(&((component *)c)->unit);
  return fmi3OK;
}

/* Values of an array follow each other; a value reference is the place of the first. */
static iptm_result visit(component *one, const fmi3ValueReference places[], size_t n, fmi3Float64 *read,
                         const fmi3Float64 *written, size_t values) {
  size_t i, used = 0;
  for (i = 0; i < n; ++i) {
    unsigned size = places[i] == IPTM_UNIT_VALUES ? 1 : 0, k;
    for (k = 0; k < IPTM_UNIT_VARIABLES; ++k) {
      if (iptm_variables[k].first == places[i]) size = iptm_variables[k].size;
    }
    if (size == 0)
      return iptm_fail(&one->unit, IPTM_REFUSED, "value reference %u is unknown", (unsigned)places[i]);
    if (used + size > values) break;
    for (k = 0; k < size; ++k, ++used) {
      const iptm_result result = read != NULL ? iptm_read(&one->unit, places[i] + k, read + used)
                                              : iptm_write(&one->unit, places[i] + k, written[used]);
      if (result != IPTM_DONE) return result;
    }
  }
  if (i < n || used != values)
    return iptm_fail(&one->unit, IPTM_REFUSED, "%u values for variables of another number", (unsigned)values);
  return IPTM_DONE;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference places[], size_t n, fmi3Float64 values[],
                          size_t count) {
  component *const one = (component *)c;
  return given(one, visit(one, places, n, values, NULL, count));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference places[], size_t n,
                          const fmi3Float64 values[], size_t count) {
  component *const one = (component *)c;
  iptm_write_begins(&one->unit);
  return given(one, iptm_write_ends(&one->unit, visit(one, places, n, NULL, values, count)));
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time_s, fmi3Float64 length_s, fmi3Boolean no_return,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last_s) {
  component *const one = (component *)c;
  const iptm_result result = iptm_step(&one->unit, time_s, length_s);
  (void)no_return;
  *event = *terminate = *early = false;
  *last_s = one->unit.now.time_s;
  return given(one, result);
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
  component *const one = (component *)c;
  return given(one, iptm_keep(&one->unit, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
  component *const one = (component *)c;
  return given(one, iptm_restore(&one->unit, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
  (void)c;
  iptm_drop(state);
  return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
  (void)c, (void)state;
  *size = IPTM_STATE_BYTES;
  return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  component *const one = (component *)c;
  return given(one, iptm_to_bytes(&one->unit, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
  component *const one = (component *)c;
  return given(one, iptm_from_bytes(&one->unit, bytes, size, state));
}
