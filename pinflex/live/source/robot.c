/* One robot in equal steps; see robot.h. */
#include "robot.h"
#include "march.h"
#include <stdlib.h>
#include <string.h>

Int pinflex_work_size(const Tables *t);
void pinflex_poses(const Tables *t, char *memory, Int count, const double *Y, Int wanted,
                   const Int *nodes, double *poses);

enum { ALIGNED = 64 };

struct Robot {
  Tables tables; /* with a damping and masses of its own */
  Alpha at;
  Rows rows;
  Int steps;
  double *damping, *mass, *com, *inertia, *command, *poses;
  double *dy, *dv, *change; /* of a slope */
  Robot *twin;              /* which its slopes are found with */
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

static void put(double *to, const double *from, Int n) {
  for (Int i = 0; i < n; i++) to[i] = from[i];
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
  m->bend = take(block, &used, nv), m->bend_lam = take(block, &used, rows);
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
  r->mass = take(block, &used, t->nodes), r->com = take(block, &used, 3 * t->nodes);
  r->inertia = take(block, &used, 9 * t->nodes);
  r->dy = take(block, &used, nv), r->dv = take(block, &used, nv);
  r->change = take(block, &used, robot_outputs());
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
  robot_payload(r, M->payload_mass);
  return r;
}

void robot_free(Robot *r) {
  if (r) robot_free(r->twin), free(r->raw);
  free(r);
}


void robot_reset(Robot *r) {
  const Tables *t = M->tables;
  Int nm = M->joints->motors;
  r->tables = *t, r->at = *M->settings, r->steps = 0;
  lay_robot(r, r->block);
  r->tables.d = r->damping;
  r->tables.mass = r->mass, r->tables.com = r->com, r->tables.inertia = r->inertia;
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
  r->at.stale = 1;
}

/* Masses at points: the common centre, and what both have about it, I + m' m'' / (m' + m'') (d'd 1 - d d') */
void robot_payload(Robot *r, double m) {
  const Tables *t = M->tables;
  double more = m - M->payload_mass, d[3], square = 0.0;
  put(r->mass, t->mass, t->nodes), put(r->com, t->com, 3 * t->nodes);
  put(r->inertia, t->inertia, 9 * t->nodes);
  r->at.stale = 1;
  if (M->payload_node < 0 || more == 0.0) return;
  double *own = r->mass + M->payload_node, *com = r->com + 3 * M->payload_node;
  double *I = r->inertia + 9 * M->payload_node, both = *own + more, share = *own * more / both;
  for (int i = 0; i < 3; i++) d[i] = M->payload_place[i] - com[i], square += d[i] * d[i];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      I[3 * i + j] += more * M->payload_inertia[3 * i + j] + share * ((i == j) * square - d[i] * d[j]);
  for (int i = 0; i < 3; i++) com[i] += more / both * d[i];
  *own = both;
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

Int robot_outputs(void) { return 3 * M->joints->motors + 6 * M->frames + 3 * M->tips + M->beams; }

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

/* Largest normal stress in magnitude, Pa: E (u' - y v'' - z w''), of fibres at stations; the rows behind
   those of this beam. */
static const double *read_stress(const double *eta, Int n, Int fibres, const double *rim,
                                 const double *rows, double *out) {
  *out = 0.0;
  for (Int k = 0; k < STATIONS; k++, rows += 3 * n) {
    double part[3] = {0.0, 0.0, 0.0};
    for (int d = 0; d < 3; d++)
      for (Int i = 0; i < n; i++) part[d] += rows[d * n + i] * eta[i];
    for (Int f = 0; f < fibres; f++) {
      double stress = part[0] + rim[2 * f] * part[1] + rim[2 * f + 1] * part[2];
      if (fabs(stress) > *out) *out = fabs(stress);
    }
  }
  return rows;
}

/* Poses, deflections and stresses at a pose. */
static void read_pose(const Robot *r, const double *y, double *out) {
  const double *rows = M->tip_rows, *stress = M->beam_rows, *rim = M->beam_rim;
  pinflex_poses(&r->tables, r->work, 1, y, M->frames, M->frame_node, r->poses);
  for (Int k = 0; k < M->frames; k++, out += 6)
    read_frame(r->poses + 12 * k, M->frame_place + 12 * k, out);
  for (Int k = 0; k < M->tips; k++, out += 3)
    rows = read_tip(y + M->tip_at[k], M->tip_n[k], M->tip_curved[k], rows, out);
  for (Int k = 0; k < M->beams; k++, out++) {
    stress = read_stress(y + M->beam_at[k], M->beam_n[k], M->beam_fibres[k], rim, stress, out);
    rim += 2 * M->beam_fibres[k];
  }
}

void robot_read(const Robot *r, double *out) {
  const Stages *st = M->joints;
  const double *y = r->rows.y;
  Int nm = st->motors;
  for (Int k = 0; k < nm; k++) {
    const double *q = y + st->motor_q[k];
    out[k] = r->rows.torque[k];
    out[nm + k] = st->motor_paired[k] ? atan2(q[1], q[0]) : q[0];
    out[2 * nm + k] = r->rows.v[st->motor_v[k]];
  }
  read_pose(r, y, out + 3 * nm);
}

static const double MOVED = 1e-6; /* rad or m: to both sides, whose difference errs by 1e-10 of itself */

int robot_slope(Robot *r, const double *command, double *out) {
  const Tables *t = M->tables;
  const Stages *st = M->joints;
  Int nm = st->motors, rest = robot_outputs() - 3 * nm;
  double most = 0.0;
  if (!r->twin) r->twin = robot_new();
  Robot *w = r->twin;
  if (!w) return 0;
  robot_take(w, r);
  Rows by = {.position = command, .velocity = command + nm, .feed = command + 2 * nm};
  if (!st->prescribed) by.feed = command;
  if (!pinflex_alpha_slope(&w->tables, w->work, &w->at, M->scale, &by, w->dy, w->dv, out)) return 0;
  for (Int i = 0; i < t->nv; i++) most = fmax(most, fabs(w->dy[i]));
  for (Int k = 0; k < nm; k++)
    out[nm + k] = w->dy[st->motor_v[k]], out[2 * nm + k] = w->dv[st->motor_v[k]];
  out += 3 * nm;
  for (Int k = 0; k < rest; k++) out[k] = 0.0;
  for (int side = -1; most > 0.0 && side <= 1; side += 2) {
    for (Int i = 0; i < t->nv; i++) w->dv[i] = side * MOVED / most * w->dy[i];
    retract(t, st, r->rows.y, w->dv, w->rows.y);
    read_pose(w, w->rows.y, w->change);
    for (Int k = 0; k < rest; k++) out[k] += side * w->change[k] * most / (2.0 * MOVED);
  }
  return 1;
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
