/* One attempt at a step: stages predicted by the step before, Newton's iteration, and what the
   step leaves. Its coarseness is the last Legendre coefficient of the displacement over the largest
   displacement so far. Its plain form is `PlainRadau.step` in pinflex/integrators/plain/radau.py. */
#include "chain.h"
#include "march.h"
#include "newton.h"
#include <stddef.h>

#define LEAST_RATE 1e-3 /* of Newton's iteration that is taken from a step before it was cut */
#define NEARLY 0.02 /* of the length of a step that is cut once more: its factors serve */

/* Whether the stages are those of the same step, which was longer or shorter by a little. */
static int cut(const March *m) { return m->landing && m->solved > 0.0; }

/* Inputs at the stages, and where the step starts. */
void take_inputs(const Tables *t, March *m, double h) {
  Stages *st = m->stages;
  Int n = m->inputs->columns, motors = st->motors;
  copy(st->y0, m->y, t->nq);
  copy(st->v0, m->v, t->nv);
  for (Int i = 0; i < st->s; i++) {
    double *x = m->input + i * n;
    /* The last stage of a step that ends where accelerations or torques jump: others than those
       inside would leave an error of the order of h in every speed. */
    if (!m->given) prescribed_before(m->inputs, m->t + h * st->c[i], x);
    copy(st->position + i * motors, x, motors);
    copy(st->velocity + i * motors, x + motors, motors);
    copy(st->feed + i * motors, x + 2 * motors, motors);
    copy(st->scale + i * t->forces, x + 3 * motors, t->forces);
  }
}

/* Weights (s,) of the nodes of a step at a place of its polynomials, a part of it. */
static void weights(const March *m, double place, double *w) {
  Int s = m->stages->s;
  for (Int k = 0; k < s; k++) {
    w[k] = 0.0;
    for (Int p = s - 1; p >= 0; p--) w[k] = w[k] * place + m->basis[p * s + k];
  }
}

static void moved(Int s, const double *weight, const double *from, Int n, double *to) {
  for (Int j = 0; j < n; j++) {
    double column[MOST_STAGES];
    for (Int k = 0; k < s; k++) column[k] = from[k * n + j];
    for (Int i = 0; i < s; i++) {
      double sum = 0.0;
      for (Int k = 0; k < s; k++) sum += weight[i * s + k] * column[k];
      to[i * n + j] = sum;
    }
  }
}

/* Stages from the polynomials of the last step, continued: x_i = sum_k L_k(1 + h c_i / h_last) x_k,
   or from the start; of a step that is cut, from its own as long as it was. */
static void predict(const Tables *t, March *m, double h) {
  Stages *st = m->stages;
  Int s = st->s, nv = t->nv, rows = t->closures, last = m->count;
  int again = cut(m);
  double w[MOST_STAGES * MOST_STAGES], over = again ? m->solved : m->steps.h[last];
  if (again || m->follows) {
    for (Int i = 0; i < s; i++)
      weights(m, (again ? 0.0 : 1.0) + h / over * st->c[i], w + i * s);
    moved(s, w, again ? st->a : m->steps.a + last * s * nv, nv, st->a);
    moved(s, w, again ? st->lam : m->steps.lam + last * s * rows, rows, st->lam);
  } else {
    for (Int i = 0; i < s; i++) copy(st->a + i * nv, m->a, nv), copy(st->lam + i * rows, m->lam, rows);
  }
  for (Int i = 0; i < s; i++)
    for (Int k = 0; k < led(st); k++) st->a[i * nv + st->motor_v[k]] = st->feed[i * st->motors + k];
  for (Int j = 0; j < s * nv; j++) st->turn[j] = st->change[j] = 0.0;
}

/* Room for a tangent that no step of the batch was solved by. */
static Int free_tangent(const March *m) {
  for (Int slot = 0; slot < m->tangents; slot++) {
    int used = 0;
    for (Int k = 1; k <= m->count; k++) used |= m->steps.tangent[k] == slot;
    if (!used) return slot;
  }
  return m->tangent;
}

/* A new tangent at the stage in the middle. */
static void refresh(const Tables *t, char *memory, March *m) {
  Stages *st = m->stages;
  Int k = st->s / 2, nv = t->nv, square = nv * nv;
  m->tangent = free_tangent(m);
  double *M = m->tangent_at + m->tangent * tangent_width(t), *C = M + square, *K = C + square;
  Int wanted = t->joined_at[t->blocks] && !m->by_mass ? WITHIN_BLOCKS : WITH_RATES;
  pinflex_tangent(t, memory, wanted, st->y + k * t->nq, st->v + k * nv, st->a + k * nv,
                  st->lam + k * t->closures, st->scale + k * t->forces, M, C, K, K + square);
  pull_tangent(t, st, C, K);
  pinflex_joined(t, memory, K + square + nv * t->closures);
  for (Int i = 0; m->by_mass && i < m->measured; i++)
    for (Int j = 0; j < m->measured; j++)
      m->weight[i * m->measured + j] = M[m->measured_at[i] * nv + m->measured_at[j]];
  m->stale = 0, m->factored_h = 0.0, m->refreshed++;
}

/* Factors of Newton's matrices for a step, where they are not at hand. */
int factor(const Tables *t, March *m, double h) {
  Stages *st = m->stages;
  const double *M = m->tangent_at + m->tangent * tangent_width(t);
  if (fabs(m->factored_h - h) <= (cut(m) ? NEARLY : m->same_step) * h) return 1;
  if (!pinflex_factor_tangent(t, st, M)) return 0;
  m->factored_h = h, m->factored++;
  return 1;
}

static int iterate(const Tables *t, char *memory, March *m, Newton *n) {
  Stages *st = m->stages;
  double trace = 0.0;
  pinflex_place(t, st);
  if (m->stale) refresh(t, memory, m), n->fresh = 0;
  if (!factor(t, m, st->h)) return 0;
  for (Int i = 0; i < m->measured; i++) trace += m->weight[i * (m->measured + 1)];
  n->round_off = m->round_off * sqrt(trace);
  for (;;) {
    int end = newton(t, memory, st, n);
    m->iterations += end == AGED ? 0 : n->iteration < n->most ? n->iteration + 1 : n->most;
    if (end != AGED) return end == CONVERGED;
    refresh(t, memory, m);
    if (!factor(t, m, st->h)) return 0;
  }
}

int attempt(const Tables *t, char *memory, March *m, double h) {
  Stages *st = m->stages;
  Newton n = {.most = m->most, .placed = 1, .fresh = -1, .measured = m->measured,
              .measured_at = m->measured_at, .weight = m->weight, .least = m->least,
              .open = m->open, .slack = m->slack, .scale = m->scale, .known = 1.0};
  double trace = 0.0, *sum = st->part;
  st->h = h;
  take_inputs(t, m, h);
  predict(t, m, h);
  if (cut(m)) n.known = fmax(m->steps.rate[m->count + 1], LEAST_RATE);
  m->solved = 0.0;
  if (!iterate(t, memory, m, &n)) return 0;
  m->solved = h;
  m->stale = n.iteration > 0 && n.rate > m->slow;
  m->scale = fmax(fmax(m->scale, reached(t, st, &n)), 1e-300);
  for (Int i = 0; i < m->measured; i++) {
    trace += m->weight[i * (m->measured + 1)], sum[i] = 0.0;
    for (Int k = 0; k < st->s; k++)
      sum[i] += m->last[k] * st->move[k * t->nv + m->measured_at[i]];
  }
  double seen = fmax(m->scale, m->seen * sqrt(trace) / m->resolution);
  m->steps.coarseness[m->count + 1] = sqrt(fabs(weighed(&n, sum))) / seen;
  m->steps.rate[m->count + 1] = n.rate;
  return 1;
}

/* The forces in the rows of prescribed motors with the last correction in them:
   r + M da + h C A da + K dz - J' dlam. */
static void chain_forces(const Tables *t, const March *m, double *torque) {
  const Stages *st = m->stages;
  Int s = st->s, n = st->free, nv = t->nv;
  const double *M = m->tangent_at + m->tangent * tangent_width(t);
  double *da = chain_room(t, st), *dv = da + nv, *dz = dv + nv, *out = dz + nv;
  for (Int j = 0; j < 3 * nv; j++) da[j] = 0.0;
  for (Int i = 0; i < s; i++) {
    for (Int j = 0; j < n; j++) {
      Int at = st->free_at[j];
      da[at] = st->da[i * n + j], dz[at] = st->change[i * nv + at], dv[at] = 0.0;
      for (Int l = 0; l < s; l++) dv[at] += st->h * st->A[i * s + l] * st->da[l * n + j];
    }
    chain_product(t, st, M, da, dv, dz, out);
    for (Int k = 0; k < st->motors; k++)
      torque[i * st->motors + k] = st->r[i * nv + st->motor_v[k]] + out[st->motor_v[k]];
  }
}

static void motor_forces(const Tables *t, const March *m, double *torque) {
  const Stages *st = m->stages;
  Int s = st->s, n = st->free, nv = t->nv, square = nv * nv, rows = t->closures;
  const double *M = m->tangent_at + m->tangent * tangent_width(t), *J = M + 3 * square;
  double *dv = st->part; /* h A da of a stage */
  if (st->joined) {
    if (led(st)) chain_forces(t, m, torque);
    return;
  }
  for (Int i = 0; i < s; i++) {
    for (Int j = 0; j < n; j++) dv[j] = 0.0;
    if (led(st)) blend(s, n, n, st->h, st->A + i * s, st->da, dv);
    for (Int k = 0; k < led(st); k++) {
      Int row = st->motor_v[k];
      double sum = st->r[i * nv + row];
      for (Int j = 0; j < n; j++) {
        const double *at = M + row * nv + st->free_at[j];
        sum += at[0] * st->da[i * n + j] + at[square] * dv[j]
               + at[2 * square] * st->change[i * nv + st->free_at[j]];
      }
      for (Int j = 0; j < rows; j++) sum -= st->dlam[i * rows + j] * J[j * nv + row];
      torque[i * st->motors + k] = sum;
    }
  }
}

/* What has jumped at the start of a step, with the forces that are held: the polynomial of its stages
   there, for what is read inside the step. To find it from the mass matrix takes as long as four
   iterations: that is done after the run, for the samples there (`after_jumps` in corrector.py). */
static void from_stages(const March *m, const double *x, Int n, double *start) {
  for (Int i = 0; i < n; i++) start[i] = 0.0;
  for (Int k = 0; k < m->stages->s; k++)
    for (Int i = 0; i < n; i++) start[i] += m->basis[k] * x[k * n + i];
}

/* The step with its last correction in everything that follows from it. */
void keep(const Tables *t, char *memory, March *m, double h) {
  Stages *st = m->stages;
  Steps *to = &m->steps;
  Int k = m->count + 1, s = st->s, nv = t->nv, n = st->free, motors = st->motors;
  double *torque = to->torque + k * s * motors, *move = to->move + k * s * nv, *dv = st->part,
         taken[MOST_STAGES];
  to->t[k] = m->t, to->h[k] = h, to->tangent[k] = m->tangent;
  to->serial[k] = m->refreshed;
  copy(to->y0 + k * t->nq, m->y, t->nq);
  copy(to->v0 + k * nv, m->v, nv);
  copy(to->a0 + k * nv, m->a, nv);
  copy(to->lam0 + k * t->closures, m->lam, t->closures);
  copy(to->torque0 + k * motors, m->torque, motors);
  copy(to->turn + k * s * nv, st->turn, s * nv);
  copy(to->a + k * s * nv, st->a, s * nv);
  copy(to->lam + k * s * t->closures, st->lam, s * t->closures);
  copy(to->position + k * s * motors, st->position, s * motors);
  copy(to->velocity + k * s * motors, st->velocity, s * motors);
  for (Int i = 0; i < s * nv; i++) move[i] = st->move[i] + st->change[i];
  motor_forces(t, m, torque);
  for (Int i = 0; i < s; i++) {
    double *v = st->v + i * nv, *y = st->y + i * t->nq;
    for (Int j = 0; j < n; j++) dv[j] = 0.0;
    blend(s, n, n, h, st->A + i * s, st->da, dv);
    for (Int j = 0; j < n; j++) v[st->free_at[j]] += dv[j];
    if (t->dampers || t->kinks || !st->prescribed) {
      retract(t, st, m->y, move + i * nv, y);
      write_motors(st, st->position + i * motors, y);
    }
    Told told = told_at(st, i);
    pull(t, st, &told, y, v, torque + i * motors, NULL);
    to->power[2 * (k * s + i)] = motor_power(t, st, torque + i * motors, v);
  }
  pinflex_losses(t, memory, s, st->y, st->v, taken);
  for (Int i = 0; i < s; i++) to->power[2 * (k * s + i) + 1] = taken[i];
  if (m->jumped) {
    from_stages(m, st->a, nv, to->a0 + k * nv);
    from_stages(m, st->lam, t->closures, to->lam0 + k * t->closures);
    from_stages(m, torque, motors, to->torque0 + k * motors);
    m->jumped = 0;
  }
}
