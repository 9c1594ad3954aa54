/* FMI 2.0 for model exchange and co-simulation around unit.c */
typedef Unit *Instance, *State;
typedef unsigned int Reference;
typedef int Bool, Status;
typedef const char *Text;
typedef struct {
  Bool again, terminate, nominals, values, next_defined;
  double next;
} EventInfo;
enum { OK, WARNING, DISCARD, ERROR };

API Text fmi2GetTypesPlatform(void) { return "default"; }
API Text fmi2GetVersion(void) { return "2.0"; }
API Instance fmi2Instantiate(Text name, int type, Text guid, Text folder, const void *host, Bool visible, Bool log) {
  Unit *u = guid && !strcmp(guid, GUID) ? (Unit *)malloc(sizeof *u) : NULL;
  if (u) cold(u);
  return u;
}
API void fmi2FreeInstance(Instance u) { free(u); }
API Status fmi2SetDebugLogging(Instance u, Bool on, size_t n, const Text names[]) { return OK; }
API Status fmi2SetupExperiment(Instance u, Bool defined, double rtol, double start, Bool stops, double stop) {
  if (defined && rtol > 0) u->rtol = rtol;
  return OK;
}
API Status fmi2Reset(Instance u) { cold(u); return OK; }
#define NOTHING(name) API Status name(Instance u) { return OK; }
NOTHING(fmi2EnterInitializationMode)
NOTHING(fmi2ExitInitializationMode)
NOTHING(fmi2Terminate)
NOTHING(fmi2EnterEventMode)
NOTHING(fmi2EnterContinuousTimeMode)
NOTHING(fmi2CancelStep)
API Status fmi2GetReal(Instance u, const Reference v[], size_t n, double x[]) {
  for (size_t i = 0; i < n; i++) x[i] = get_value(u, v[i]);
  return OK;
}
API Status fmi2SetReal(Instance u, const Reference v[], size_t n, const double x[]) {
  for (size_t i = 0; i < n; i++)
    if (set_value(u, v[i], x[i])) return ERROR;
  return OK;
}
#define ABSENT(name, type) \
  API Status fmi2Get##name(Instance u, const Reference v[], size_t n, type x[]) { return n ? ERROR : OK; } \
  API Status fmi2Set##name(Instance u, const Reference v[], size_t n, const type x[]) { return n ? ERROR : OK; }
ABSENT(Integer, int)
ABSENT(Boolean, Bool)
ABSENT(String, Text)
API Status fmi2GetFMUstate(Instance u, State *s) {
  if (!*s) *s = (Unit *)malloc(sizeof(Unit));
  if (!*s) return ERROR;
  memcpy(*s, u, sizeof(Unit));
  return OK;
}
API Status fmi2SetFMUstate(Instance u, State s) { memcpy(u, s, sizeof(Unit)); return OK; }
API Status fmi2FreeFMUstate(Instance u, State *s) { free(*s); *s = NULL; return OK; }
API Status fmi2SerializedFMUstateSize(Instance u, State s, size_t *n) { *n = sizeof(Unit); return OK; }
API Status fmi2SerializeFMUstate(Instance u, State s, char b[], size_t n) { memcpy(b, s, sizeof(Unit)); return OK; }
API Status fmi2DeSerializeFMUstate(Instance u, const char b[], size_t n, State *s) {
  return n == sizeof(Unit) ? fmi2GetFMUstate((Instance)(void *)b, s) : ERROR;
}
API Status fmi2GetDirectionalDerivative(Instance u, const Reference f[], size_t nf, const Reference x[], size_t nx,
                                        const double dx[], double df[]) { return ERROR; }
API Status fmi2NewDiscreteStates(Instance u, EventInfo *e) { memset(e, 0, sizeof *e); return OK; }
API Status fmi2CompletedIntegratorStep(Instance u, Bool keep, Bool *event, Bool *stop) { *event = *stop = 0; return OK; }
API Status fmi2SetTime(Instance u, double t) { return OK; }
API Status fmi2SetContinuousStates(Instance u, const double x[], size_t n) { memcpy(u, x, n * sizeof *x); return OK; }
API Status fmi2GetContinuousStates(Instance u, double x[], size_t n) { memcpy(x, u, n * sizeof *x); return OK; }
API Status fmi2GetDerivatives(Instance u, double x[], size_t n) {
  for (size_t i = 0; i < n; i++) x[i] = get_value(u, DERIVATIVE + i);
  return OK;
}
API Status fmi2GetEventIndicators(Instance u, double z[], size_t n) { return OK; }
API Status fmi2GetNominalsOfContinuousStates(Instance u, double x[], size_t n) {
  for (size_t i = 0; i < n; i++) x[i] = 1;
  return OK;
}
API Status fmi2SetRealInputDerivatives(Instance u, const Reference v[], size_t n, const int o[], const double x[]) {
  return ERROR;
}
API Status fmi2GetRealOutputDerivatives(Instance u, const Reference v[], size_t n, const int o[], double x[]) {
  return ERROR;
}
API Status fmi2DoStep(Instance u, double t, double h, Bool keep) { return advance_unit(u, h * 1e9) ? ERROR : OK; }
#define STATUS(name, type) API Status fmi2Get##name##Status(Instance u, int kind, type *s) { return DISCARD; }
API Status fmi2GetStatus(Instance u, int kind, Status *s) { return DISCARD; }
STATUS(Real, double)
STATUS(Integer, int)
STATUS(Boolean, Bool)
STATUS(String, Text)
