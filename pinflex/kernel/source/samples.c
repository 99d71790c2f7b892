/* States within steps, off the polynomials of their stages: x(z) = sum_k L_k(z) x_k, z = 0 at the
   start of a step and 1 at its end, v and y by the integrals of a. */
#include "march.h"

enum { WIDE = 12 }; /* MOST_STAGES + 1, rounded up to whole lanes */
_Static_assert(WIDE > MOST_STAGES && WIDE % LANES == 0, "a value at the start beside the stages");

/* Weights of the nodes for the polynomial through them, or its integral of some order, at z: their rows,
   of which each is of a power of z. */
static void rows_of(const double *basis, Int n, Int integrals, Lane *rows) {
  double *to = (double *)rows;
  for (Int p = 0; p < n; p++) {
    double over = 1.0;
    for (Int k = 1; k <= integrals; k++) over *= (double)(p + k);
    for (Int k = 0; k < WIDE; k++) to[p * WIDE + k] = k < n ? basis[p * n + k] / over : 0.0;
  }
}

static void weights(const Lane *rows, Int n, double z, Int integrals, double *w) {
  Lane *sum = (Lane *)w;
  double power = 1.0;
  for (Int k = 0; k < integrals; k++) power *= z;
  for (Int k = 0; k < WIDE / LANES; k++) sum[k] = lane(0.0);
  for (Int p = 0; p < n; p++, power *= z)
    for (Int k = 0; k < WIDE / LANES; k++) sum[k] += power * rows[p * (WIDE / LANES) + k];
}

/* Through the value at the start too: below the first node a polynomial runs wild. */
static void through(Int s, Int n, const double *w, const double *x0, const double *x, double *out) {
  for (Int i = 0; i < n; i++) out[i] = w[0] * x0[i];
  blend(s, n, n, 1.0, w + 1, x, out);
}

/* States at `count` times in s, of[i] the step that each lies in; inputs (count, columns) where they
   are given. Arrays are (count, .). */
EXPORT void pinflex_samples(const Tables *t, const March *m, Int count, const double *time,
                            const Int *of, const double *given, double *y, double *v, double *a,
                            double *lam, double *torque, double *work) {
  const Stages *st = m->stages;
  const Steps *x = &m->steps;
  Int s = st->s, nv = t->nv, rows = t->closures, motors = st->motors;
  Lane once[MOST_STAGES * WIDE / LANES], twice[MOST_STAGES * WIDE / LANES],
       at_0[(MOST_STAGES + 1) * WIDE / LANES], room[3 * WIDE / LANES];
  double *B1 = (double *)room, *B2 = B1 + WIDE, *W = B2 + WIDE, *move = st->part;
  rows_of(m->basis, s, 1, once), rows_of(m->basis, s, 2, twice), rows_of(m->basis_0, s + 1, 0, at_0);
  for (Int i = 0; i < count; i++) {
    Int k = of[i], at = k * s;
    double h = x->h[k], z = (time[i] - x->t[k]) / h;
    const double *input = given ? given + i * m->inputs->columns : m->input;
    if (!given) prescribed(m->inputs, time[i], m->input);
    weights(once, s, z, 1, B1);
    weights(twice, s, z, 2, B2);
    weights(at_0, s + 1, z, 0, W);
    for (Int j = 0; j < nv; j++) v[j] = x->v0[k * nv + j], move[j] = h * z * v[j];
    blend(s, nv, nv, h, B1, x->a + at * nv, v);
    blend(s, nv, nv, h * h, B2, x->a + at * nv, move);
    if (st->balls + st->bodies) blend(s, nv, nv, h, B1, x->turn + at * nv, move);
    retract(t, st, x->y0 + k * t->nq, move, y);
    through(s, nv, W, x->a0 + k * nv, x->a + at * nv, a);
    through(s, rows, W, x->lam0 + k * rows, x->lam + at * rows, lam);
    through(s, motors, W, x->torque0 + k * motors, x->torque + at * motors, torque);
    for (Int j = 0; j < led(st); j++)
      v[st->motor_v[j]] = input[motors + j], a[st->motor_v[j]] = input[2 * motors + j];
    write_motors(st, input, y);
    work[0] = work[1] = 0.0;
    blend(s, 2, 2, h, B1, x->power + 2 * at, work);
    y += t->nq, v += nv, a += nv, lam += rows, torque += motors, work += 2;
  }
}
