/* The steps of a run once more with one stage more, from the start that the corrections so far have
   led to: what they differ by is the error of the run (pinflex/integrators/corrector.py). */
#include "chain.h"
#include "march.h"
#include <stddef.h>

/* Where a step starts: at the end of the correction before it; after a switch of motion or loads
   accelerations begin anew. */
static void restart(const Tables *t, const March *run, March *m, Int k, const double *end_a) {
  const Steps *x = &run->steps;
  const double *a = x->a0 + k * t->nv;
  Int same = end_a != NULL, motors = m->stages->motors;
  m->t = x->t[k];
  if (!end_a) {
    copy(m->y, x->y0 + k * t->nq, t->nq);
    copy(m->v, x->v0 + k * t->nv, t->nv);
  }
  for (Int i = 0; same && i < t->nv; i++) same = a[i] == end_a[i];
  if (same) return;
  copy(m->a, a, t->nv);
  copy(m->lam, x->lam0 + k * t->closures, t->closures);
  copy(m->torque, x->torque0 + k * motors, motors);
}

/* Stages from the polynomials of the step. */
static void guess(const Tables *t, const March *run, March *m, Int k, const double *W) {
  Stages *st = m->stages;
  Int s = run->stages->s, nv = t->nv, rows = t->closures;
  blends(st->s, s, nv, W, run->steps.a + k * s * nv, st->a);
  blends(st->s, s, nv, W, run->steps.turn + k * s * nv, st->turn);
  blends(st->s, s, rows, W, run->steps.lam + k * s * rows, st->lam);
  for (Int i = 0; i < st->s; i++)
    for (Int j = 0; j < led(st); j++) st->a[i * nv + st->motor_v[j]] = st->feed[i * st->motors + j];
  for (Int i = 0; i < st->s * nv; i++) st->change[i] = 0.0;
}

/* K moved + C rate of a chain, both of free rows. */
static void chain_follow(const Tables *t, const March *m, const double *moved, const double *rate,
                         double *r) {
  const Stages *st = m->stages;
  double *none = chain_room(t, st), *dv = none + t->nv, *dz = dv + t->nv;
  for (Int j = 0; j < 3 * t->nv; j++) none[j] = 0.0;
  for (Int j = 0; j < st->free; j++) dv[st->free_at[j]] = rate[j], dz[st->free_at[j]] = moved[j];
  chain_product(t, st, m->tangent_at + m->tangent * tangent_width(t), none, dv, dz, r);
}

/* Answer of the stages to the error so far, by the tangent alone: r = K (dy + h c dv) + C dv. */
static void follow(const Tables *t, const March *run, March *m, Int k) {
  Stages *st = m->stages;
  Int n = st->free, nv = t->nv, rows = t->closures;
  double *dy = st->move, *moved = st->da, *rate = st->part; /* free until the stages are placed */
  displacement(t, st, run->steps.y0 + k * t->nq, m->y, dy);
  const double *v = run->steps.v0 + k * nv;
  for (Int j = 0; j < n; j++) rate[j] = m->v[st->free_at[j]] - v[st->free_at[j]];
  for (Int i = 0; i < st->s; i++) {
    double *r = st->r + i * nv;
    for (Int j = 0; j < n; j++) moved[j] = dy[st->free_at[j]] + st->h * st->c[i] * rate[j];
    if (st->joined) chain_follow(t, m, moved, rate, r);
    for (Int l = 0; l < n && !st->joined; l++)
      r[st->free_at[l]] = inner(st->K + l * n, moved, n) + inner(st->C + l * n, rate, n);
    for (Int l = 0; l < rows; l++) st->open[i * rows + l] = inner(st->J + l * n, moved, n);
  }
  pinflex_correct(t, st);
}

/* What turns in space depends on what was corrected. */
static void turned(const Tables *t, March *m) {
  const Stages *st = m->stages;
  Int all = st->s * t->nv, k = m->count + 1;
  if (!(st->balls + st->bodies)) return;
  pinflex_place(t, st);
  copy(m->steps.turn + k * all, st->turn, all);
  copy(m->steps.move + k * all, st->move, all);
}

/* Correct `count` steps of a batch. end_a: accelerations (nv,) at the end of the step before them;
   NULL: there is none. given: inputs (count, s, columns), or NULL. Steps that contracted by more than
   `slow` are corrected twice. 0 where equations are singular. */
EXPORT int pinflex_correct_steps(const Tables *t, char *memory, const March *run, March *m, Int count,
                                 const double *W, const double *end_a, const double *given) {
  Stages *st = m->stages;
  const Steps *x = &run->steps;
  Int s = run->stages->s, columns = m->inputs->columns;
  m->tangent_at = run->tangent_at;
  for (Int k = 1; k <= count; k++) {
    double h = x->h[k];
    m->count = k - 1, m->tangent = x->tangent[k], st->h = h, m->given = given != NULL;
    if (m->refreshed != x->serial[k]) m->refreshed = x->serial[k], m->factored_h = 0.0;
    restart(t, run, m, k, end_a);
    if (given) copy(m->input, given + (k - 1) * st->s * columns, st->s * columns);
    take_inputs(t, m, h);
    guess(t, run, m, k, W);
    if (!factor(t, m, h)) return 0;
    if (end_a) follow(t, run, m, k);
    for (int again = x->rate[k] > m->slow; again >= 0; again--) {
      pinflex_place(t, st);
      pinflex_balance(t, memory, st);
      pinflex_correct(t, st);
      m->iterations++;
    }
    m->steps.coarseness[k] = x->coarseness[k], m->steps.rate[k] = x->rate[k];
    keep(t, memory, m, h);
    turned(t, m);
    m->count = k;
    advance(t, m);
    end_a = x->a + (k * s + s - 1) * t->nv;
  }
  return 1;
}
