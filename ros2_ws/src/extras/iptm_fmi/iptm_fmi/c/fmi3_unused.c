/* Functions of FMI 3.0 that a unit of co-simulation with values of Float64 has no use for: they fail. */
#include "fmi3Functions.h"

#define IPTM_NO_VALUES(kind)                                                                                     \
  fmi3Status fmi3Get##kind(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3##kind v[], size_t m) {   \
    (void)c, (void)r, (void)v, (void)m;                                                                          \
    return n == 0 ? fmi3OK : fmi3Error;                                                                          \
  }                                                                                                              \
  fmi3Status fmi3Set##kind(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3##kind v[],         \
                           size_t m) {                                                                           \
    (void)c, (void)r, (void)v, (void)m;                                                                          \
    return n == 0 ? fmi3OK : fmi3Error;                                                                          \
  }
IPTM_NO_VALUES(Float32)
IPTM_NO_VALUES(Int8)
IPTM_NO_VALUES(UInt8)
IPTM_NO_VALUES(Int16)
IPTM_NO_VALUES(UInt16)
IPTM_NO_VALUES(Int32)
IPTM_NO_VALUES(UInt32)
IPTM_NO_VALUES(Int64)
IPTM_NO_VALUES(UInt64)
IPTM_NO_VALUES(Boolean)
IPTM_NO_VALUES(String)

fmi3Instance fmi3InstantiateModelExchange(fmi3String a, fmi3String b, fmi3String c, fmi3Boolean d,
                                          fmi3Boolean e, fmi3InstanceEnvironment f,
                                          fmi3LogMessageCallback g) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g;
  return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String a, fmi3String b, fmi3String c, fmi3Boolean d,
                                               fmi3Boolean e, fmi3InstanceEnvironment f,
                                               fmi3LogMessageCallback g, fmi3ClockUpdateCallback h,
                                               fmi3LockPreemptionCallback i, fmi3UnlockPreemptionCallback j) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g, (void)h, (void)i, (void)j;
  return NULL;
}

fmi3Status fmi3EnterEventMode(fmi3Instance a) {
  (void)a;
  return fmi3Error;
}

fmi3Status fmi3GetBinary(fmi3Instance a, const fmi3ValueReference b[], size_t c, size_t d[], fmi3Binary e[],
                         size_t f) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f;
  return fmi3Error;
}

fmi3Status fmi3GetClock(fmi3Instance a, const fmi3ValueReference b[], size_t c, fmi3Clock d[]) {
  (void)a, (void)b, (void)c, (void)d;
  return fmi3Error;
}

fmi3Status fmi3SetBinary(fmi3Instance a, const fmi3ValueReference b[], size_t c, const size_t d[],
                         const fmi3Binary e[], size_t f) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f;
  return fmi3Error;
}

fmi3Status fmi3SetClock(fmi3Instance a, const fmi3ValueReference b[], size_t c, const fmi3Clock d[]) {
  (void)a, (void)b, (void)c, (void)d;
  return fmi3Error;
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance a, fmi3ValueReference b, size_t *c) {
  (void)a, (void)b, (void)c;
  return fmi3Error;
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance a, fmi3ValueReference b, size_t c[],
                                       fmi3ValueReference d[], size_t e[], fmi3DependencyKind f[], size_t g) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g;
  return fmi3Error;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance a, const fmi3ValueReference b[], size_t c,
                                        const fmi3ValueReference d[], size_t e, const fmi3Float64 f[],
                                        size_t g, fmi3Float64 h[], size_t i) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g, (void)h, (void)i;
  return fmi3Error;
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance a, const fmi3ValueReference b[], size_t c,
                                    const fmi3ValueReference d[], size_t e, const fmi3Float64 f[], size_t g,
                                    fmi3Float64 h[], size_t i) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g, (void)h, (void)i;
  return fmi3Error;
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance a) {
  (void)a;
  return fmi3Error;
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance a) {
  (void)a;
  return fmi3Error;
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance a, const fmi3ValueReference b[], size_t c, fmi3Float64 d[],
                                  fmi3IntervalQualifier e[]) {
  (void)a, (void)b, (void)c, (void)d, (void)e;
  return fmi3Error;
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance a, const fmi3ValueReference b[], size_t c, fmi3UInt64 d[],
                                   fmi3UInt64 e[], fmi3IntervalQualifier f[]) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f;
  return fmi3Error;
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance a, const fmi3ValueReference b[], size_t c, fmi3Float64 d[]) {
  (void)a, (void)b, (void)c, (void)d;
  return fmi3Error;
}

fmi3Status fmi3GetShiftFraction(fmi3Instance a, const fmi3ValueReference b[], size_t c, fmi3UInt64 d[],
                                fmi3UInt64 e[]) {
  (void)a, (void)b, (void)c, (void)d, (void)e;
  return fmi3Error;
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance a, const fmi3ValueReference b[], size_t c,
                                  const fmi3Float64 d[]) {
  (void)a, (void)b, (void)c, (void)d;
  return fmi3Error;
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance a, const fmi3ValueReference b[], size_t c,
                                   const fmi3UInt64 d[], const fmi3UInt64 e[]) {
  (void)a, (void)b, (void)c, (void)d, (void)e;
  return fmi3Error;
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance a, const fmi3ValueReference b[], size_t c,
                               const fmi3Float64 d[]) {
  (void)a, (void)b, (void)c, (void)d;
  return fmi3Error;
}

fmi3Status fmi3SetShiftFraction(fmi3Instance a, const fmi3ValueReference b[], size_t c, const fmi3UInt64 d[],
                                const fmi3UInt64 e[]) {
  (void)a, (void)b, (void)c, (void)d, (void)e;
  return fmi3Error;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance a) {
  (void)a;
  return fmi3Error;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance a, fmi3Boolean *b, fmi3Boolean *c, fmi3Boolean *d,
                                    fmi3Boolean *e, fmi3Boolean *f, fmi3Float64 *g) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g;
  return fmi3Error;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance a) {
  (void)a;
  return fmi3Error;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance a, fmi3Boolean b, fmi3Boolean *c, fmi3Boolean *d) {
  (void)a, (void)b, (void)c, (void)d;
  return fmi3Error;
}

fmi3Status fmi3SetTime(fmi3Instance a, fmi3Float64 b) {
  (void)a, (void)b;
  return fmi3Error;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance a, const fmi3Float64 b[], size_t c) {
  (void)a, (void)b, (void)c;
  return fmi3Error;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance a, fmi3Float64 b[], size_t c) {
  (void)a, (void)b, (void)c;
  return fmi3Error;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance a, fmi3Float64 b[], size_t c) {
  (void)a, (void)b, (void)c;
  return fmi3Error;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance a, fmi3Float64 b[], size_t c) {
  (void)a, (void)b, (void)c;
  return fmi3Error;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance a, fmi3Float64 b[], size_t c) {
  (void)a, (void)b, (void)c;
  return fmi3Error;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance a, size_t *b) {
  (void)a, (void)b;
  return fmi3Error;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance a, size_t *b) {
  (void)a, (void)b;
  return fmi3Error;
}

fmi3Status fmi3EnterStepMode(fmi3Instance a) {
  (void)a;
  return fmi3Error;
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance a, const fmi3ValueReference b[], size_t c,
                                    const fmi3Int32 d[], fmi3Float64 e[], size_t f) {
  (void)a, (void)b, (void)c, (void)d, (void)e, (void)f;
  return fmi3Error;
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance a, fmi3ValueReference b, fmi3Float64 c) {
  (void)a, (void)b, (void)c;
  return fmi3Error;
}
