/* One robot in equal steps; see robot.h. */
#include "robot.h"
#include <stdlib.h>
#include <string.h>

Int pinflex_work_size(const Tables *t);
void pinflex_poses(const Tables *t, char *memory, Int count, const double *Y, Int wanted,
                   const Int *nodes, double *poses);

enum { ALIGNED = 64 };

struct Robot {
  Tables tables; /* with a damping of its own */
  Alpha at;
  Rows rows;
  Int steps;
  double *damping, *command, *poses;
  char *work, *block;
  size_t size;
  void *raw;
};

static const Model *const M = &robot_model;

/* The next array of a block, or how long the block has to be where there is none. */
static double *take(char *block, size_t *used, Int numbers) {
  char *here = block ? block + *used : NULL;
  *used += ((size_t)numbers * sizeof(double) / ALIGNED + 1) * ALIGNED;
  return (double *)here;
}

static State state(char *block, size_t *used) {
  const Tables *t = M->tables;
  State x;
  x.y = take(block, used, t->nq), x.v = take(block, used, t->nv), x.a = take(block, used, t->nv);
  x.s = take(block, used, t->nv), x.lam = take(block, used, t->closures);
  return x;
}

/* Let a robot have its arrays in a block; the length of the block. */
static size_t lay_robot(Robot *r, char *block) {
  const Tables *t = M->tables;
  size_t used = 0;
  Int nv = t->nv, rows = t->closures, n = M->joints->free, nm = M->joints->motors, size = n + rows;
  Alpha *m = &r->at;
  m->now = state(block, &used), m->last = state(block, &used), m->next = state(block, &used);
  m->move = take(block, &used, nv), m->r = take(block, &used, nv);
  m->open = take(block, &used, rows), m->x = take(block, &used, size);
  m->tangent = take(block, &used, nv * (3 * nv + rows)), m->lu = take(block, &used, size * size);
  m->weight = take(block, &used, n), m->motor_rows = take(block, &used, nm * n);
  m->motor_J = take(block, &used, rows * nm), m->narrow = take(block, &used, size * size);
  m->room = take(block, &used, size);
  m->pivot = (Int *)take(block, &used, size + 1), m->order = (Int *)take(block, &used, 3 * size + 1);
  r->rows.y = take(block, &used, t->nq), r->rows.v = take(block, &used, nv);
  r->rows.a = take(block, &used, nv), r->rows.s = take(block, &used, nv);
  r->rows.lam = take(block, &used, rows), r->rows.torque = take(block, &used, nm);
  r->rows.power = take(block, &used, 2);
  r->damping = take(block, &used, t->d_at[nv]), r->command = take(block, &used, 3 * nm);
  r->poses = take(block, &used, 12 * M->frames);
  r->work = (char *)take(block, &used, pinflex_work_size(t) / (Int)sizeof(double) + 1);
  return used;
}

Robot *robot_new(void) {
  Robot *r = calloc(1, sizeof *r);
  if (!r) return NULL;
  r->size = lay_robot(r, NULL);
  r->raw = calloc(1, r->size + ALIGNED);
  if (!r->raw) {
    free(r);
    return NULL;
  }
  r->block = (char *)(((uintptr_t)r->raw + ALIGNED - 1) / ALIGNED * ALIGNED);
  robot_reset(r);
  robot_damping(r, 1.0);
  return r;
}

void robot_free(Robot *r) {
  if (r) free(r->raw);
  free(r);
}

static void put(double *to, const double *from, Int n) {
  for (Int i = 0; i < n; i++) to[i] = from[i];
}

void robot_reset(Robot *r) {
  const Tables *t = M->tables;
  const double *d = r->tables.d;
  Int nm = M->joints->motors;
  r->tables = *t, r->at = *M->settings, r->steps = 0;
  lay_robot(r, r->block);
  r->tables.d = d ? d : t->d;
  r->at.joints = M->joints, r->at.predict = M->predict, r->at.low = M->low, r->at.high = M->high;
  State *both[2] = {&r->at.now, &r->at.last};
  for (int k = 0; k < 2; k++) {
    put(both[k]->y, M->y, t->nq), put(both[k]->v, M->v, t->nv), put(both[k]->a, M->a, t->nv);
    put(both[k]->s, M->s, t->nv), put(both[k]->lam, M->lam, t->closures);
  }
  put(r->rows.y, M->y, t->nq), put(r->rows.v, M->v, t->nv), put(r->rows.a, M->a, t->nv);
  put(r->rows.torque, M->torque, nm);
  r->rows.position = M->position, r->rows.velocity = r->command + nm; /* of pushed motors no matter */
  r->rows.feed = M->joints->prescribed ? r->command + 2 * nm : r->command;
  if (M->joints->prescribed) r->rows.position = r->command;
  r->rows.scale = M->scale;
}

void robot_damping(Robot *r, double k) {
  const Tables *t = M->tables;
  for (Int i = 0; i < t->d_at[t->nv]; i++) r->damping[i] = k * t->d[i];
  r->tables.d = r->damping;
  r->at.stale = 1;
}

Int robot_inputs(void) { return (M->joints->prescribed ? 3 : 1) * M->joints->motors; }

int robot_step(Robot *r, const double *command) {
  for (Int i = 0; i < robot_inputs(); i++)
    if (!isfinite(command[i])) return ROBOT_STUCK;
  put(r->command, command, robot_inputs());
  if (!pinflex_alpha(&r->tables, r->work, &r->at, 1, &r->rows))
    return r->at.stopped < 0 ? ROBOT_STUCK : ROBOT_STOPPED;
  r->steps++;
  return ROBOT_DONE;
}

double robot_time(const Robot *r) { return (double)r->steps * M->dt; }

Int robot_motor(const Robot *r) { return r->at.stopped; }

Int robot_outputs(void) { return 3 * M->joints->motors + 6 * M->frames + 3 * M->tips; }

/* log(R) of R by rows, rad: by the quaternion, whose largest component is divided by */
static void rotation_vector(const double *R, double *out) {
  double q[4] = {1.0 + R[0] + R[4] + R[8], 1.0 + R[0] - R[4] - R[8], 1.0 - R[0] + R[4] - R[8],
                 1.0 - R[0] - R[4] + R[8]};
  int k = 0;
  for (int i = 1; i < 4; i++)
    if (q[i] > q[k]) k = i;
  const double turn[3] = {R[7] - R[5], R[2] - R[6], R[3] - R[1]};
  const double pairs[3] = {R[5] + R[7], R[2] + R[6], R[1] + R[3]}; /* yz, xz, xy */
  double w = k ? turn[k - 1] : q[0], v[3];
  for (int d = 0; d < 3; d++)
    v[d] = !k ? turn[d] : d == k - 1 ? q[k] : pairs[3 - d - (k - 1)];
  double size = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  double angle = 2.0 * atan2(size, fabs(w)), sign = w < 0.0 ? -1.0 : 1.0;
  for (int d = 0; d < 3; d++) out[d] = size > 0.0 ? sign * angle * v[d] / size : 0.0;
}

static void read_frame(const double *node, const double *place, double *out) {
  double R[9];
  for (int i = 0; i < 3; i++) {
    out[i] = node[4 * i + 3];
    for (int k = 0; k < 3; k++) out[i] += node[4 * i + k] * place[4 * k + 3];
    for (int j = 0; j < 3; j++) {
      R[3 * i + j] = 0.0;
      for (int k = 0; k < 3; k++) R[3 * i + j] += node[4 * i + k] * place[4 * k + j];
    }
  }
  rotation_vector(R, out + 3);
}

/* u, v, w = Phi eta + eta' G eta / 2; the rows behind those of this tip */
static const double *read_tip(const double *eta, Int n, Int curved, const double *rows, double *out) {
  const double *G = rows + 3 * n;
  for (int d = 0; d < 3; d++) {
    out[d] = 0.0;
    for (Int i = 0; i < n; i++) {
      double sum = rows[d * n + i];
      for (Int j = 0; curved && j < n; j++) sum += 0.5 * G[(d * n + i) * n + j] * eta[j];
      out[d] += sum * eta[i];
    }
  }
  return curved ? G + 3 * n * n : G;
}

void robot_read(const Robot *r, double *out) {
  const Stages *st = M->joints;
  const double *y = r->rows.y, *rows = M->tip_rows;
  Int nm = st->motors;
  for (Int k = 0; k < nm; k++) {
    const double *q = y + st->motor_q[k];
    out[k] = r->rows.torque[k];
    out[nm + k] = st->motor_paired[k] ? atan2(q[1], q[0]) : q[0];
    out[2 * nm + k] = r->rows.v[st->motor_v[k]];
  }
  out += 3 * nm;
  pinflex_poses(&r->tables, r->work, 1, y, M->frames, M->frame_node, r->poses);
  for (Int k = 0; k < M->frames; k++, out += 6)
    read_frame(r->poses + 12 * k, M->frame_place + 12 * k, out);
  for (Int k = 0; k < M->tips; k++, out += 3)
    rows = read_tip(y + M->tip_at[k], M->tip_n[k], M->tip_curved[k], rows, out);
}

/* An address in one block as it is in another. */
static double *moved(double *p, const char *from, char *to) {
  return (double *)(to + ((char *)p - from));
}

void robot_take(Robot *r, const Robot *from) {
  State *states[3] = {&r->at.now, &r->at.last, &r->at.next};
  Robot own = *r;
  memcpy(r->block, from->block, r->size);
  r->at = from->at, r->steps = from->steps;
  lay_robot(r, r->block); /* its own arrays ... */
  const State *theirs[3] = {&from->at.now, &from->at.last, &from->at.next};
  for (int k = 0; k < 3; k++) { /* ... of which the states have changed places */
    states[k]->y = moved(theirs[k]->y, from->block, r->block);
    states[k]->v = moved(theirs[k]->v, from->block, r->block);
    states[k]->a = moved(theirs[k]->a, from->block, r->block);
    states[k]->s = moved(theirs[k]->s, from->block, r->block);
    states[k]->lam = moved(theirs[k]->lam, from->block, r->block);
  }
  r->rows.position = own.rows.position, r->rows.velocity = own.rows.velocity;
  r->rows.feed = own.rows.feed, r->rows.scale = own.rows.scale;
}

Robot *robot_copy(const Robot *r) {
  Robot *copy = robot_new();
  if (copy) robot_take(copy, r);
  return copy;
}
