/* A controller as an FMU (FMI 2.0, co-simulation): torques of N joints as springs and dampers to a goal.

     u = hold + k (goal - q) - k / 10 v

   Value references: q, v, goal, hold, k, u, N of each. What a step is given it answers at its end. */
#include <stdlib.h>

#if defined(_WIN32)
#define FMI __declspec(dllexport)
#else
#define FMI __attribute__((visibility("default")))
#endif

enum { N = 6, Q = 0, V = N, GOAL = 2 * N, HOLD = 3 * N, K = 4 * N, U = 5 * N, ALL = 6 * N };
enum { OK, ERROR = 3 };

FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI const char *fmi2GetVersion(void) { return "2.0"; }
FMI void *fmi2Instantiate(const char *name, int type, const char *guid, const char *place,
                          const void *told, int visible, int logging) {
  (void)name, (void)type, (void)guid, (void)place, (void)told, (void)visible, (void)logging;
  return calloc(ALL, sizeof(double));
}
FMI void fmi2FreeInstance(void *c) { free(c); }
FMI int fmi2SetupExperiment(void *c, int defined, double tolerance, double first, int ends, double last) {
  (void)c, (void)defined, (void)tolerance, (void)first, (void)ends, (void)last;
  return OK;
}
FMI int fmi2EnterInitializationMode(void *c) { return c ? OK : ERROR; }
FMI int fmi2ExitInitializationMode(void *c) { return c ? OK : ERROR; }
FMI int fmi2Terminate(void *c) { return c ? OK : ERROR; }
FMI int fmi2Reset(void *c) { return c ? OK : ERROR; }

FMI int fmi2SetReal(double *x, const unsigned *at, size_t n, const double *values) {
  for (size_t k = 0; k < n; k++) {
    if (at[k] >= U) return ERROR;
    x[at[k]] = values[k];
  }
  return OK;
}
FMI int fmi2GetReal(const double *x, const unsigned *at, size_t n, double *values) {
  for (size_t k = 0; k < n; k++) {
    if (at[k] >= ALL) return ERROR;
    values[k] = x[at[k]];
  }
  return OK;
}
FMI int fmi2DoStep(double *x, double now, double h, int keeps) {
  (void)now, (void)h, (void)keeps;
  for (int k = 0; k < N; k++)
    x[U + k] = x[HOLD + k] + x[K + k] * (x[GOAL + k] - x[Q + k]) - 0.1 * x[K + k] * x[V + k];
  return OK;
}

/* What the standard asks every FMU to export, and this one has not. */
#define NONE(name) \
  FMI int name(void) { return ERROR; }
FMI int fmi2SetDebugLogging(void) { return OK; }
NONE(fmi2GetInteger) NONE(fmi2GetBoolean) NONE(fmi2GetString)
NONE(fmi2SetInteger) NONE(fmi2SetBoolean) NONE(fmi2SetString)
NONE(fmi2GetFMUstate) NONE(fmi2SetFMUstate) NONE(fmi2FreeFMUstate)
NONE(fmi2SerializedFMUstateSize) NONE(fmi2SerializeFMUstate) NONE(fmi2DeSerializeFMUstate)
NONE(fmi2GetDirectionalDerivative) NONE(fmi2SetRealInputDerivatives)
NONE(fmi2GetRealOutputDerivatives) NONE(fmi2CancelStep) NONE(fmi2GetStatus)
NONE(fmi2GetRealStatus) NONE(fmi2GetIntegerStatus) NONE(fmi2GetBooleanStatus)
NONE(fmi2GetStringStatus)
