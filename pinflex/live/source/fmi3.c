/* FMI 3.0, co-simulation, of one robot (slave.h). Types as the standard has them, section 2.2.3. */
#include "slave.h"
#include <stdbool.h>

typedef void *fmi3Instance, *fmi3FMUState, *fmi3InstanceEnvironment;
typedef unsigned int fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*Log)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);

static void say(const Slave *s, const char *text) {
  if (s->log) ((Log)s->log)(s->to, fmi3Error, "error", text);
}

static fmi3Status refuse(const Slave *s, fmi3String text) {
  say(s, text);
  return fmi3Error;
}

static fmi3Status status(int done) { return done ? fmi3OK : fmi3Error; }

FMI const char *fmi3GetVersion(void) { return "3.0"; }

FMI fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String place,
                                             fmi3Boolean visible, fmi3Boolean logging,
                                             fmi3Boolean events, fmi3Boolean early,
                                             const fmi3ValueReference *between, size_t count,
                                             fmi3InstanceEnvironment to, Log log, void *update) {
  (void)place, (void)visible, (void)logging, (void)events, (void)early, (void)between, (void)count;
  (void)update;
  return slave_new(name, token, say, to, (void (*)(void))log);
}

FMI void fmi3FreeInstance(fmi3Instance c) { slave_free(c); }

FMI fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean defined, fmi3Float64 tolerance,
                                           fmi3Float64 first, fmi3Boolean ends, fmi3Float64 last) {
  (void)defined, (void)tolerance, (void)ends, (void)last;
  ((Slave *)c)->begun = first;
  return fmi3OK;
}

FMI fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
  slave_start(c);
  return fmi3OK;
}

FMI fmi3Status fmi3Reset(fmi3Instance c) {
  slave_reset(c);
  return fmi3OK;
}

FMI fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference *at, size_t n, fmi3Float64 *x,
                              size_t values) {
  return n == values ? status(slave_get(c, at, n, x)) : refuse(c, "variables are numbers");
}

FMI fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference *at, size_t n,
                              const fmi3Float64 *x, size_t values) {
  return n == values ? status(slave_set(c, at, n, x)) : refuse(c, "variables are numbers");
}

FMI fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 now, fmi3Float64 h, fmi3Boolean keeps,
                          fmi3Boolean *event, fmi3Boolean *ends, fmi3Boolean *early,
                          fmi3Float64 *last) {
  Slave *s = c;
  (void)now, (void)keeps;
  int done = slave_step(s, h);
  *event = *ends = *early = false, *last = s->begun + robot_time(s->robot);
  return status(done);
}

FMI fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference *of, size_t n,
                                            const fmi3ValueReference *by, size_t m,
                                            const fmi3Float64 *x, size_t seeds, fmi3Float64 *y,
                                            size_t values) {
  if (m != seeds || n != values) return refuse(c, "variables are numbers");
  return status(slave_slope(c, of, n, by, m, x, y));
}

/* The state of a slave: another one. */
FMI fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
  if (*state) return status(slave_take(*state, c));
  *state = slave_copy(c);
  return status(*state != NULL);
}

FMI fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
  return status(slave_take(c, state));
}

FMI fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
  (void)c;
  if (state) slave_free(*state), *state = NULL;
  return fmi3OK;
}

/* What changes nothing, what a robot has not, and variables of other kinds, which may be asked for
   none of. Their further arguments are not read, which C's calling conventions leave to the caller. */
#define NOTHING(name) \
  FMI fmi3Status name(fmi3Instance c) { return (void)c, fmi3OK; }
#define NONE(name) \
  FMI fmi3Status name(fmi3Instance c) { return refuse(c, #name ": not there"); }
#define ONE(name) \
  FMI fmi3Status name(fmi3Instance c, const fmi3ValueReference *at, size_t n) { \
    return (void)at, n ? refuse(c, "no such variable") : fmi3OK; \
  }
#define NO_VARIABLES(kind) ONE(fmi3Get##kind) ONE(fmi3Set##kind)
#define NO_INSTANCE(name) \
  FMI fmi3Instance name(void) { return NULL; }
NOTHING(fmi3SetDebugLogging)
NOTHING(fmi3Terminate)
NOTHING(fmi3EnterStepMode)
NOTHING(fmi3EnterConfigurationMode)
NOTHING(fmi3ExitConfigurationMode)
NO_INSTANCE(fmi3InstantiateModelExchange)
NO_INSTANCE(fmi3InstantiateScheduledExecution)
NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)
NO_VARIABLES(Binary)
NO_VARIABLES(Clock)
NO_VARIABLES(IntervalDecimal)
NO_VARIABLES(IntervalFraction)
NO_VARIABLES(ShiftDecimal)
NO_VARIABLES(ShiftFraction)
ONE(fmi3GetOutputDerivatives)
NONE(fmi3EnterEventMode)
NONE(fmi3GetNumberOfVariableDependencies)
NONE(fmi3GetVariableDependencies)
NONE(fmi3SerializedFMUStateSize)
NONE(fmi3SerializeFMUState)
NONE(fmi3DeserializeFMUState)
NONE(fmi3GetAdjointDerivative)
NONE(fmi3EvaluateDiscreteStates)
NONE(fmi3UpdateDiscreteStates)
NONE(fmi3EnterContinuousTimeMode)
NONE(fmi3CompletedIntegratorStep)
NONE(fmi3SetTime)
NONE(fmi3SetContinuousStates)
NONE(fmi3GetContinuousStateDerivatives)
NONE(fmi3GetEventIndicators)
NONE(fmi3GetContinuousStates)
NONE(fmi3GetNominalsOfContinuousStates)
NONE(fmi3GetNumberOfEventIndicators)
NONE(fmi3GetNumberOfContinuousStates)
NONE(fmi3ActivateModelPartition)
