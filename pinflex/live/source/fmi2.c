/* FMI 2.0, co-simulation, of one robot (robot.h). Types as the standard has them, section 2.1.2.

   Value references: inputs, outputs, damping. Inputs are those at the end of a step; over several
   steps of dt led motors go on with the velocity and acceleration that they were given. */
#include "robot.h"
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define FMI __declspec(dllexport)
#else
#define FMI __attribute__((visibility("default")))
#endif

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

typedef struct {
  Robot *robot;
  double *command, *now, *out; /* inputs; those of a step; outputs */
  double damping, begun;
  char *name;
  const fmi2CallbackFunctions *told;
} Slave;

extern const char robot_guid[]; /* in model.c, of the FMU it was written for */
static const Model *const M = &robot_model;

static fmi2Status say(const Slave *s, fmi2Status status, fmi2String text) {
  if (s->told && s->told->logger)
    s->told->logger(s->told->environment, s->name, status, "error", text);
  return status;
}

static void start(Slave *s) {
  Int nm = M->joints->motors;
  for (Int k = 0; k < robot_inputs(); k++) s->command[k] = 0.0;
  for (Int k = 0; k < nm; k++) s->command[k] = M->joints->prescribed ? M->position[k] : M->torque[k];
  robot_read(s->robot, s->out);
}

static void discard(Slave *s) {
  if (!s) return;
  robot_free(s->robot);
  free(s->command), free(s->now), free(s->out), free(s->name), free(s);
}

FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI const char *fmi2GetVersion(void) { return "2.0"; }

FMI fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                                  const fmi2CallbackFunctions *told, fmi2Boolean visible,
                                  fmi2Boolean logging) {
  (void)place, (void)visible, (void)logging;
  if (type != fmi2CoSimulation || !guid || strcmp(guid, robot_guid) != 0) return NULL;
  Slave *s = calloc(1, sizeof *s);
  if (!s) return NULL;
  size_t in = (size_t)robot_inputs() + 1, out = (size_t)robot_outputs() + 1;
  s->robot = robot_new(), s->told = told, s->damping = 1.0;
  s->command = calloc(in, sizeof(double)), s->now = calloc(in, sizeof(double));
  s->out = calloc(out, sizeof(double)), s->name = calloc(strlen(name ? name : "") + 1, 1);
  if (!s->robot || !s->command || !s->now || !s->out || !s->name) {
    discard(s);
    return NULL;
  }
  strcpy(s->name, name ? name : "");
  start(s);
  return s;
}

FMI void fmi2FreeInstance(fmi2Component c) { discard(c); }

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
  Slave *s = c;
  robot_damping(s->robot, s->damping);
  return fmi2OK;
}

FMI fmi2Status fmi2Terminate(fmi2Component c) {
  (void)c;
  return fmi2OK;
}

FMI fmi2Status fmi2Reset(fmi2Component c) {
  Slave *s = c;
  robot_reset(s->robot);
  s->damping = 1.0;
  start(s);
  return fmi2OK;
}

FMI fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference *at, size_t n, fmi2Real *x) {
  const Slave *s = c;
  size_t in = (size_t)robot_inputs(), out = in + (size_t)robot_outputs();
  for (size_t k = 0; k < n; k++) {
    if (at[k] > out) return say(s, fmi2Error, "no such variable");
    x[k] = at[k] < in ? s->command[at[k]] : at[k] < out ? s->out[at[k] - in] : s->damping;
  }
  return fmi2OK;
}

FMI fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference *at, size_t n,
                           const fmi2Real *x) {
  Slave *s = c;
  size_t in = (size_t)robot_inputs(), damping = in + (size_t)robot_outputs();
  for (size_t k = 0; k < n; k++) {
    if (!isfinite(x[k])) return say(s, fmi2Error, "a number that is not finite");
    if (at[k] < in) s->command[at[k]] = x[k];
    else if (at[k] == damping && x[k] >= 0.0) s->damping = x[k];
    else return say(s, fmi2Error, "only inputs, and a damping of 0 or more, can be set");
  }
  return fmi2OK;
}

/* The inputs of a step that begins tau (s) after they were given. */
static void lead(Slave *s, double tau) {
  Int nm = M->joints->motors;
  memcpy(s->now, s->command, (size_t)robot_inputs() * sizeof(double));
  for (Int k = 0; M->joints->prescribed && k < nm; k++) {
    double v = s->command[nm + k], a = s->command[2 * nm + k];
    s->now[k] += tau * (v + 0.5 * tau * a);
    s->now[nm + k] += tau * a;
  }
}

FMI fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real h, fmi2Boolean keeps) {
  Slave *s = c;
  (void)keeps, (void)now;
  double steps = h / M->dt, count = floor(steps + 0.5);
  if (!(count >= 1.0) || fabs(steps - count) > 1e-6 * count)
    return say(s, fmi2Error, "a communication step is a whole number of steps of dt");
  fmi2Status found = fmi2OK;
  for (double k = 0.0; k < count && found == fmi2OK; k += 1.0) {
    lead(s, k * M->dt);
    int said = robot_step(s->robot, s->now);
    if (said == ROBOT_STOPPED) found = say(s, fmi2Error, "a motor would pass its stop");
    if (said == ROBOT_STUCK)
      found = say(s, fmi2Error, "no step within the bounds on its cost: the input jumps too far");
  }
  robot_read(s->robot, s->out);
  return found;
}

FMI fmi2Status fmi2CancelStep(fmi2Component c) {
  (void)c;
  return fmi2Error;
}

/* The state of a slave: another one. */
FMI fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  const Slave *s = c;
  Slave *kept = *state ? *state : fmi2Instantiate("", fmi2CoSimulation, robot_guid, "", s->told, 0, 0);
  if (!kept) return fmi2Error;
  robot_take(kept->robot, s->robot);
  memcpy(kept->command, s->command, (size_t)robot_inputs() * sizeof(double));
  memcpy(kept->out, s->out, (size_t)robot_outputs() * sizeof(double));
  kept->damping = s->damping, *state = kept;
  return fmi2OK;
}

FMI fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  fmi2FMUstate here = c;
  return state ? fmi2GetFMUstate(state, &here) : fmi2Error;
}

FMI fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  (void)c;
  if (state) discard(*state), *state = NULL;
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

/* What a robot has not: other kinds of variables, serialized states, derivatives. */
#define NONE(name, ...) \
  FMI fmi2Status name(fmi2Component c, __VA_ARGS__) { return say(c, fmi2Error, #name ": not there"); }
#define NO_VARIABLES(kind, type) \
  FMI fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference *at, size_t n, type *x) { \
    return (void)at, (void)x, n ? say(c, fmi2Error, "no such variable") : fmi2OK; \
  } \
  FMI fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference *at, size_t n, \
                               const type *x) { \
    return (void)at, (void)x, n ? say(c, fmi2Error, "no such variable") : fmi2OK; \
  }
#pragma GCC diagnostic ignored "-Wunused-parameter"
NO_VARIABLES(Integer, fmi2Integer)
NO_VARIABLES(Boolean, fmi2Boolean)
NO_VARIABLES(String, fmi2String)
NONE(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *n)
NONE(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte *x, size_t n)
NONE(fmi2DeSerializeFMUstate, const fmi2Byte *x, size_t n, fmi2FMUstate *state)
NONE(fmi2GetDirectionalDerivative, const fmi2ValueReference *of, size_t n,
     const fmi2ValueReference *by, size_t m, const fmi2Real *x, fmi2Real *y)
NONE(fmi2SetRealInputDerivatives, const fmi2ValueReference *at, size_t n, const fmi2Integer *order,
     const fmi2Real *x)
NONE(fmi2GetRealOutputDerivatives, const fmi2ValueReference *at, size_t n,
     const fmi2Integer *order, fmi2Real *x)
NONE(fmi2GetIntegerStatus, fmi2StatusKind kind, fmi2Integer *x)
NONE(fmi2GetBooleanStatus, fmi2StatusKind kind, fmi2Boolean *x)
NONE(fmi2GetStringStatus, fmi2StatusKind kind, fmi2String *x)
