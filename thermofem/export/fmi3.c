/* FMI 3.0 for model exchange and co-simulation around unit.c */
#include <stdbool.h>
#include <stdint.h>
typedef Unit *Instance, *State;
typedef uint32_t Reference;
typedef int Status;
typedef const char *Text;
enum { OK, WARNING, DISCARD, ERROR };

API Text fmi3GetVersion(void) { return "3.0"; }
static Instance instantiate(Text token) {
  Unit *u = token && !strcmp(token, GUID) ? (Unit *)malloc(sizeof *u) : NULL;
  if (u) cold(u);
  return u;
}
API Instance fmi3InstantiateModelExchange(Text name, Text token, Text folder, bool visible, bool log, void *host,
                                          void *logger) { return instantiate(token); }
API Instance fmi3InstantiateCoSimulation(Text name, Text token, Text folder, bool visible, bool log, bool events,
                                         bool early, const Reference needed[], size_t n, void *host, void *logger,
                                         void *update) { return instantiate(token); }
API Instance fmi3InstantiateScheduledExecution(Text name, Text token, Text folder, bool visible, bool log, void *host,
                                               void *logger, void *clock, void *lock, void *unlock) { return NULL; }
API void fmi3FreeInstance(Instance u) { free(u); }
API Status fmi3SetDebugLogging(Instance u, bool on, size_t n, const Text names[]) { return OK; }
API Status fmi3EnterInitializationMode(Instance u, bool defined, double rtol, double start, bool stops, double stop) {
  if (defined && rtol > 0) u->rtol = rtol;
  return OK;
}
API Status fmi3Reset(Instance u) { cold(u); return OK; }
#define NOTHING(name) API Status name(Instance u) { return OK; }
NOTHING(fmi3ExitInitializationMode)
NOTHING(fmi3EnterEventMode)
NOTHING(fmi3EnterContinuousTimeMode)
NOTHING(fmi3EnterStepMode)
NOTHING(fmi3EnterConfigurationMode)
NOTHING(fmi3ExitConfigurationMode)
NOTHING(fmi3Terminate)
NOTHING(fmi3EvaluateDiscreteStates)
API Status fmi3GetFloat64(Instance u, const Reference v[], size_t n, double x[], size_t m) {
  for (size_t i = 0; i < n; i++) x[i] = get_value(u, v[i]);
  return OK;
}
API Status fmi3SetFloat64(Instance u, const Reference v[], size_t n, const double x[], size_t m) {
  for (size_t i = 0; i < n; i++)
    if (set_value(u, v[i], x[i])) return ERROR;
  return OK;
}
#define ABSENT(name, type) \
  API Status fmi3Get##name(Instance u, const Reference v[], size_t n, type x[], size_t m) { return n ? ERROR : OK; } \
  API Status fmi3Set##name(Instance u, const Reference v[], size_t n, const type x[], size_t m) { return n ? ERROR : OK; }
ABSENT(Float32, float)
ABSENT(Int8, int8_t)
ABSENT(UInt8, uint8_t)
ABSENT(Int16, int16_t)
ABSENT(UInt16, uint16_t)
ABSENT(Int32, int32_t)
ABSENT(UInt32, uint32_t)
ABSENT(Int64, int64_t)
ABSENT(UInt64, uint64_t)
ABSENT(Boolean, bool)
ABSENT(String, Text)
API Status fmi3GetBinary(Instance u, const Reference v[], size_t n, size_t s[], const uint8_t *x[], size_t m) {
  return n ? ERROR : OK;
}
API Status fmi3SetBinary(Instance u, const Reference v[], size_t n, const size_t s[], const uint8_t *const x[], size_t m) {
  return n ? ERROR : OK;
}
#define CLOCK(name, ...) API Status fmi3##name(Instance u, const Reference v[], size_t n, __VA_ARGS__) { return n ? ERROR : OK; }
CLOCK(GetClock, bool x[])
CLOCK(SetClock, const bool x[])
CLOCK(GetIntervalDecimal, double x[], int q[])
CLOCK(SetIntervalDecimal, const double x[])
CLOCK(GetIntervalFraction, uint64_t c[], uint64_t r[], int q[])
CLOCK(SetIntervalFraction, const uint64_t c[], const uint64_t r[])
CLOCK(GetShiftDecimal, double x[])
CLOCK(SetShiftDecimal, const double x[])
CLOCK(GetShiftFraction, uint64_t c[], uint64_t r[])
CLOCK(SetShiftFraction, const uint64_t c[], const uint64_t r[])
API Status fmi3GetNumberOfVariableDependencies(Instance u, Reference v, size_t *n) { return ERROR; }
API Status fmi3GetVariableDependencies(Instance u, Reference v, size_t e[], Reference d[], size_t de[], int kind[],
                                       size_t n) { return ERROR; }
API Status fmi3GetFMUState(Instance u, State *s) {
  if (!*s) *s = (Unit *)malloc(sizeof(Unit));
  if (!*s) return ERROR;
  memcpy(*s, u, sizeof(Unit));
  return OK;
}
API Status fmi3SetFMUState(Instance u, State s) { memcpy(u, s, sizeof(Unit)); return OK; }
API Status fmi3FreeFMUState(Instance u, State *s) { free(*s); *s = NULL; return OK; }
API Status fmi3SerializedFMUStateSize(Instance u, State s, size_t *n) { *n = sizeof(Unit); return OK; }
API Status fmi3SerializeFMUState(Instance u, State s, uint8_t b[], size_t n) { memcpy(b, s, sizeof(Unit)); return OK; }
API Status fmi3DeserializeFMUState(Instance u, const uint8_t b[], size_t n, State *s) {
  return n == sizeof(Unit) ? fmi3GetFMUState((Instance)(void *)b, s) : ERROR;
}
API Status fmi3GetDirectionalDerivative(Instance u, const Reference f[], size_t nf, const Reference x[], size_t nx,
                                        const double dx[], size_t mx, double df[], size_t mf) { return ERROR; }
API Status fmi3GetAdjointDerivative(Instance u, const Reference f[], size_t nf, const Reference x[], size_t nx,
                                    const double df[], size_t mf, double dx[], size_t mx) { return ERROR; }
API Status fmi3UpdateDiscreteStates(Instance u, bool *again, bool *terminate, bool *nominals, bool *values,
                                    bool *defined, double *next) {
  *again = *terminate = *nominals = *values = *defined = false;
  return OK;
}
API Status fmi3CompletedIntegratorStep(Instance u, bool keep, bool *event, bool *stop) {
  *event = *stop = false;
  return OK;
}
API Status fmi3SetTime(Instance u, double t) { return OK; }
API Status fmi3SetContinuousStates(Instance u, const double x[], size_t n) { memcpy(u, x, n * sizeof *x); return OK; }
API Status fmi3GetContinuousStates(Instance u, double x[], size_t n) { memcpy(x, u, n * sizeof *x); return OK; }
API Status fmi3GetContinuousStateDerivatives(Instance u, double x[], size_t n) {
  for (size_t i = 0; i < n; i++) x[i] = get_value(u, DERIVATIVE + i);
  return OK;
}
API Status fmi3GetNominalsOfContinuousStates(Instance u, double x[], size_t n) {
  for (size_t i = 0; i < n; i++) x[i] = 1;
  return OK;
}
API Status fmi3GetEventIndicators(Instance u, double z[], size_t n) { return OK; }
API Status fmi3GetNumberOfEventIndicators(Instance u, size_t *n) { *n = 0; return OK; }
API Status fmi3GetNumberOfContinuousStates(Instance u, size_t *n) { *n = STATES; return OK; }
API Status fmi3GetOutputDerivatives(Instance u, const Reference v[], size_t n, const int32_t o[], double x[], size_t m) {
  return ERROR;
}
API Status fmi3DoStep(Instance u, double t, double h, bool keep, bool *event, bool *stop, bool *early, double *last) {
  *event = *stop = *early = false;
  *last = t + h;
  return advance_unit(u, h * 1e9) ? ERROR : OK;
}
API Status fmi3ActivateModelPartition(Instance u, Reference clock, double t) { return ERROR; }
