/* One robot as a slave; see slave.h. */
#include "slave.h"
#include <stdlib.h>
#include <string.h>

static const Model *const M = &robot_model;

static int wrong(const Slave *s, const char *text) {
  s->say(s, text);
  return 0;
}

static size_t inputs(void) { return (size_t)robot_inputs(); }
static size_t outputs(void) { return (size_t)robot_outputs(); }
static size_t parameters(void) { return M->payload_node < 0 ? 1 : 2; }

static void begin(Slave *s) {
  Int nm = M->joints->motors;
  for (size_t k = 0; k < inputs(); k++) s->command[k] = 0.0;
  for (Int k = 0; k < nm; k++) s->command[k] = M->joints->prescribed ? M->position[k] : M->torque[k];
  s->damping = 1.0, s->payload = M->payload_mass;
  robot_read(s->robot, s->out);
}

Slave *slave_new(const char *name, const char *guid, Say say, void *to, void (*log)(void)) {
  if (!guid || strcmp(guid, robot_guid) != 0) return NULL;
  Slave *s = calloc(1, sizeof *s);
  if (!s) return NULL;
  double **arrays[] = {&s->command, &s->now, &s->known, &s->out, &s->unknown};
  int whole = 1;
  for (int k = 0; k < 5; k++) {
    *arrays[k] = calloc((k < 3 ? inputs() : outputs()) + 1, sizeof(double));
    whole = whole && *arrays[k];
  }
  s->robot = robot_new(), s->name = calloc(strlen(name ? name : "") + 1, 1);
  if (!whole || !s->robot || !s->name) {
    slave_free(s);
    return NULL;
  }
  strcpy(s->name, name ? name : "");
  s->say = say, s->to = to, s->log = log;
  begin(s);
  return s;
}

void slave_free(Slave *s) {
  if (!s) return;
  robot_free(s->robot);
  free(s->command), free(s->now), free(s->out), free(s->known), free(s->unknown), free(s->name);
  free(s);
}

void slave_start(Slave *s) {
  robot_damping(s->robot, s->damping);
  robot_payload(s->robot, s->payload);
}

void slave_reset(Slave *s) {
  robot_reset(s->robot);
  begin(s);
}

int slave_get(const Slave *s, const unsigned *at, size_t n, double *x) {
  const double after[3] = {s->damping, s->payload, s->begun + robot_time(s->robot)};
  size_t in = inputs(), out = in + outputs(), end = out + parameters();
  for (size_t k = 0; k < n; k++) {
    if (at[k] > end) return wrong(s, "no such variable");
    x[k] = at[k] < in ? s->command[at[k]] : at[k] < out ? s->out[at[k] - in]
           : after[at[k] == end ? 2 : at[k] - out];
  }
  return 1;
}

int slave_set(Slave *s, const unsigned *at, size_t n, const double *x) {
  size_t in = inputs(), out = in + outputs();
  for (size_t k = 0; k < n; k++) {
    if (!isfinite(x[k])) return wrong(s, "a number that is not finite");
    if (at[k] < in) s->command[at[k]] = x[k];
    else if (at[k] == out && x[k] >= 0.0) s->damping = x[k];
    else if (at[k] == out + 1 && parameters() > 1 && x[k] >= 0.0) s->payload = x[k];
    else return wrong(s, "only inputs, and a damping and payload of 0 or more, can be set");
  }
  return 1;
}

/* The inputs of a step that begins tau (s) after they were given. */
static void lead(Slave *s, double tau) {
  Int nm = M->joints->motors;
  memcpy(s->now, s->command, inputs() * sizeof(double));
  for (Int k = 0; M->joints->prescribed && k < nm; k++) {
    double v = s->command[nm + k], a = s->command[2 * nm + k];
    s->now[k] += tau * (v + 0.5 * tau * a);
    s->now[nm + k] += tau * a;
  }
}

int slave_step(Slave *s, double h) {
  double steps = h / M->dt, count = floor(steps + 0.5);
  if (!(count >= 1.0) || fabs(steps - count) > 1e-6 * count)
    return wrong(s, "a communication step is a whole number of steps of dt");
  int said = ROBOT_DONE;
  for (double k = 0.0; k < count && said == ROBOT_DONE; k += 1.0) {
    lead(s, k * M->dt);
    said = robot_step(s->robot, s->now);
  }
  robot_read(s->robot, s->out);
  if (said == ROBOT_STOPPED) return wrong(s, "a motor would pass its stop");
  if (said == ROBOT_STUCK)
    return wrong(s, "no step within the bounds on its cost: the input jumps too far");
  return 1;
}

int slave_slope(Slave *s, const unsigned *of, size_t n, const unsigned *by, size_t m, const double *dx,
                double *dy) {
  size_t in = inputs(), out = in + outputs();
  for (size_t k = 0; k < in; k++) s->known[k] = 0.0;
  for (size_t k = 0; k < m; k++) {
    if (by[k] >= in) return wrong(s, "derivatives are those by inputs");
    s->known[by[k]] += dx[k];
  }
  for (size_t k = 0; k < n; k++)
    if (of[k] < in || of[k] >= out) return wrong(s, "derivatives are those of outputs");
  if (!robot_slope(s->robot, s->known, s->unknown)) return wrong(s, "no derivatives here");
  for (size_t k = 0; k < n; k++) dy[k] = s->unknown[of[k] - in];
  return 1;
}

int slave_take(Slave *s, const Slave *from) {
  if (!s || !from) return 0;
  robot_take(s->robot, from->robot);
  memcpy(s->command, from->command, inputs() * sizeof(double));
  memcpy(s->out, from->out, outputs() * sizeof(double));
  s->damping = from->damping, s->payload = from->payload, s->begun = from->begun;
  return 1;
}

Slave *slave_copy(const Slave *s) {
  Slave *kept = slave_new("", robot_guid, s->say, s->to, s->log);
  if (kept) slave_take(kept, s);
  return kept;
}
