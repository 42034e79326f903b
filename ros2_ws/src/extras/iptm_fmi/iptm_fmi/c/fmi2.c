/* The functions of FMI 2.0 for co-simulation around a unit. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "unit.h"

typedef struct {
  iptm_instance unit;
  fmi2CallbackFunctions callbacks;
  char name[64];
} component;

static const char *const CATEGORY = "iptm";

static fmi2Status given(component *one, iptm_result result) {
  const fmi2Status status = result == IPTM_DONE ? fmi2OK : result == IPTM_DISCARDED ? fmi2Discard : fmi2Error;
  if (status != fmi2OK && one->callbacks.logger != NULL)
    one->callbacks.logger(one->callbacks.componentEnvironment, one->name, status, CATEGORY, "%s",
                          one->unit.message);
  return status;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
  (void)c, (void)on, (void)n, (void)names;
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
  component *one;
  (void)resources, (void)visible, (void)logging;
  if (callbacks == NULL) return NULL;
  if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, IPTM_TOKEN) != 0) {
    if (callbacks->logger != NULL)
      callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, CATEGORY,
                        "GUID or type is another one; allowed: co-simulation with the GUID of this file");
    return NULL;
  }
  one = (component *)calloc(1, sizeof(component));
  if (one == NULL) return NULL;
  iptm_reset(&one->unit);
  one->callbacks = *callbacks;
  if (name != NULL) strncpy(one->name, name, sizeof(one->name) - 1);
  return one;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start_s,
                               fmi2Boolean ends, fmi2Real stop_s) {
  component *const one = (component *)c;
  (void)defined, (void)tolerance, (void)ends, (void)stop_s;
  return given(one, iptm_start_at(&one->unit, start_s));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  component *const one = (component *)c;
  return given(one, iptm_enter(&one->unit, one->unit.now.time_s));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  component *const one = (component *)c;
  return given(one, iptm_begin(&one->unit));
}

fmi2Status fmi2Terminate(fmi2Component c) {
  ((component *)c)->unit.now.phase = IPTM_ENDED;
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
  iptm_reset(&((component *)c)->unit);
  return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference places[], size_t n, fmi2Real values[]) {
  component *const one = (component *)c;
  iptm_result result = IPTM_DONE;
  size_t i;
  for (i = 0; i < n && result == IPTM_DONE; ++i) result = iptm_read(&one->unit, places[i], values + i);
  return given(one, result);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference places[], size_t n, const fmi2Real values[]) {
  component *const one = (component *)c;
  iptm_result result = IPTM_DONE;
  size_t i;
  iptm_write_begins(&one->unit);
  for (i = 0; i < n && result == IPTM_DONE; ++i) result = iptm_write(&one->unit, places[i], values[i]);
  return given(one, iptm_write_ends(&one->unit, result));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time_s, fmi2Real length_s, fmi2Boolean no_return) {
  component *const one = (component *)c;
  (void)no_return;
  return given(one, iptm_step(&one->unit, time_s, length_s));
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  component *const one = (component *)c;
  return given(one, iptm_keep(&one->unit, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  component *const one = (component *)c;
  return given(one, iptm_restore(&one->unit, state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  (void)c;
  iptm_drop(state);
  return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
  (void)c, (void)state;
  *size = IPTM_STATE_BYTES;
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  component *const one = (component *)c;
  return given(one, iptm_to_bytes(&one->unit, state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  component *const one = (component *)c;
  return given(one, iptm_from_bytes(&one->unit, bytes, size, state));
}

/* What a unit of real values has none of. */
#define IPTM_NO_VALUES(kind)                                                                                 \
  fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##kind v[]) {        \
    (void)c, (void)r, (void)v;                                                                               \
    return n == 0 ? fmi2OK : fmi2Error;                                                                      \
  }                                                                                                          \
  fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##kind v[]) {  \
    (void)c, (void)r, (void)v;                                                                               \
    return n == 0 ? fmi2OK : fmi2Error;                                                                      \
  }
IPTM_NO_VALUES(Integer)
IPTM_NO_VALUES(Boolean)
IPTM_NO_VALUES(String)

#define IPTM_NO_STATUS(name, type)                                                \
  fmi2Status fmi2Get##name(fmi2Component c, const fmi2StatusKind s, type *value) { \
    (void)c, (void)s, (void)value;                                                \
    return fmi2Discard;                                                           \
  }
IPTM_NO_STATUS(Status, fmi2Status)
IPTM_NO_STATUS(RealStatus, fmi2Real)
IPTM_NO_STATUS(IntegerStatus, fmi2Integer)
IPTM_NO_STATUS(BooleanStatus, fmi2Boolean)
IPTM_NO_STATUS(StringStatus, fmi2String)

fmi2Status fmi2CancelStep(fmi2Component c) {
  (void)c;
  return fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t nu,
                                        const fmi2ValueReference k[], size_t nk, const fmi2Real dk[],
                                        fmi2Real du[]) {
  (void)c, (void)u, (void)nu, (void)k, (void)nk, (void)dk, (void)du;
  return fmi2Error;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real v[]) {
  (void)c, (void)r, (void)n, (void)order, (void)v;
  return fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real v[]) {
  (void)c, (void)r, (void)n, (void)order, (void)v;
  return fmi2Error;
}
