/* FMI 2.0, co-simulation, of one robot (slave.h). Types as the standard has them, section 2.1.2. */
#include "slave.h"

typedef void *fmi2Component, *fmi2FMUstate, *fmi2ComponentEnvironment;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*Logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
typedef struct {
  Logger logger;
  void *(*allocateMemory)(size_t, size_t);
  void (*freeMemory)(void *);
  void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
  fmi2ComponentEnvironment environment;
} fmi2CallbackFunctions;


static void say(const Slave *s, const char *text) {
  const fmi2CallbackFunctions *told = s->to;
  if (told && told->logger) told->logger(told->environment, s->name, fmi2Error, "error", text);
}

static fmi2Status refuse(const Slave *s, fmi2String text) {
  say(s, text);
  return fmi2Error;
}

static fmi2Status status(int done) { return done ? fmi2OK : fmi2Error; }

FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI const char *fmi2GetVersion(void) { return "2.0"; }

FMI fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                                  const fmi2CallbackFunctions *told, fmi2Boolean visible,
                                  fmi2Boolean logging) {
  (void)place, (void)visible, (void)logging;
  return type == fmi2CoSimulation ? slave_new(name, guid, say, (void *)told, NULL) : NULL;
}

FMI void fmi2FreeInstance(fmi2Component c) { slave_free(c); }

FMI fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String *what) {
  (void)c, (void)on, (void)n, (void)what;
  return fmi2OK;
}

FMI fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance,
                                   fmi2Real first, fmi2Boolean ends, fmi2Real last) {
  (void)defined, (void)tolerance, (void)ends, (void)last;
  ((Slave *)c)->begun = first;
  return fmi2OK;
}

FMI fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  (void)c;
  return fmi2OK;
}

FMI fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  slave_start(c);
  return fmi2OK;
}

FMI fmi2Status fmi2Terminate(fmi2Component c) {
  (void)c;
  return fmi2OK;
}

FMI fmi2Status fmi2Reset(fmi2Component c) {
  slave_reset(c);
  return fmi2OK;
}

FMI fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference *at, size_t n, fmi2Real *x) {
  return status(slave_get(c, at, n, x));
}

FMI fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference *at, size_t n,
                           const fmi2Real *x) {
  return status(slave_set(c, at, n, x));
}

FMI fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real h, fmi2Boolean keeps) {
  (void)keeps, (void)now;
  return status(slave_step(c, h));
}

FMI fmi2Status fmi2CancelStep(fmi2Component c) {
  (void)c;
  return fmi2Error;
}

FMI fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference *of, size_t n,
                                            const fmi2ValueReference *by, size_t m, const fmi2Real *x,
                                            fmi2Real *y) {
  return status(slave_slope(c, of, n, by, m, x, y));
}

/* The state of a slave: another one. */
FMI fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  if (*state) return status(slave_take(*state, c));
  *state = slave_copy(c);
  return status(*state != NULL);
}

FMI fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  return status(slave_take(c, state));
}

FMI fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  (void)c;
  if (state) slave_free(*state), *state = NULL;
  return fmi2OK;
}

FMI fmi2Status fmi2GetStatus(fmi2Component c, fmi2StatusKind kind, fmi2Status *x) {
  (void)c, (void)kind;
  *x = fmi2OK;
  return fmi2Discard;
}

FMI fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real *x) {
  const Slave *s = c;
  if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
  *x = s->begun + robot_time(s->robot);
  return fmi2OK;
}

/* What a robot has not: other kinds of variables, serialized states, derivatives in time. */
#define NONE(name, ...) \
  FMI fmi2Status name(fmi2Component c, __VA_ARGS__) { return refuse(c, #name ": not there"); }
#define NO_VARIABLES(kind, type) \
  FMI fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference *at, size_t n, type *x) { \
    return (void)at, (void)x, n ? refuse(c, "no such variable") : fmi2OK; \
  } \
  FMI fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference *at, size_t n, \
                               const type *x) { \
    return (void)at, (void)x, n ? refuse(c, "no such variable") : fmi2OK; \
  }
#pragma GCC diagnostic ignored "-Wunused-parameter"
NO_VARIABLES(Integer, fmi2Integer)
NO_VARIABLES(Boolean, fmi2Boolean)
NO_VARIABLES(String, fmi2String)
NONE(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *n)
NONE(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte *x, size_t n)
NONE(fmi2DeSerializeFMUstate, const fmi2Byte *x, size_t n, fmi2FMUstate *state)
NONE(fmi2SetRealInputDerivatives, const fmi2ValueReference *at, size_t n, const fmi2Integer *order,
     const fmi2Real *x)
NONE(fmi2GetRealOutputDerivatives, const fmi2ValueReference *at, size_t n,
     const fmi2Integer *order, fmi2Real *x)
NONE(fmi2GetIntegerStatus, fmi2StatusKind kind, fmi2Integer *x)
NONE(fmi2GetBooleanStatus, fmi2StatusKind kind, fmi2Boolean *x)
NONE(fmi2GetStringStatus, fmi2StatusKind kind, fmi2String *x)
