/* States within steps, off the polynomials of their stages: x(z) = sum_k L_k(z) x_k, z = 0 at the
   start of a step and 1 at its end, v and y by the integrals of a. */
#include "march.h"

/* Weights of the nodes for the polynomial through them, or its integral of some order, at z. */
static void weights(const double *restrict basis, Int n, double z, Int integrals,
                    double *restrict w) {
  double power = 1.0;
  for (Int k = 0; k < integrals; k++) power *= z;
  for (Int k = 0; k < n; k++) w[k] = 0.0;
  for (Int p = 0; p < n; p++) {
    double over = 1.0;
    for (Int k = 1; k <= integrals; k++) over *= (double)(p + k);
    double x = integrals ? power / over : power;
    for (Int k = 0; k < n; k++) w[k] += x * basis[p * n + k];
    power *= z;
  }
}

/* out += k sum_l w_l x_l */
static void add_stages(Int s, Int n, double k, const double *w, const double *restrict x,
                       double *restrict out) {
  for (Int l = 0; l < s; l++) {
    double share = k * w[l];
    for (Int i = 0; i < n; i++) out[i] += share * x[l * n + i];
  }
}

/* Through the value at the start too: below the first node a polynomial runs wild. */
static void through(Int s, Int n, const double *w, const double *x0, const double *x, double *out) {
  for (Int i = 0; i < n; i++) out[i] = w[0] * x0[i];
  add_stages(s, n, 1.0, w + 1, x, out);
}

/* States at `count` times in s, of[i] the step that each lies in; inputs (count, columns) where they
   are given. Arrays are (count, .). */
EXPORT void pinflex_samples(const Tables *t, const March *m, Int count, const double *time,
                            const Int *of, const double *given, double *y, double *v, double *a,
                            double *lam, double *torque, double *work) {
  const Stages *st = m->stages;
  const Steps *x = &m->steps;
  Int s = st->s, nv = t->nv, rows = t->closures, motors = st->motors;
  double B1[MOST_STAGES], B2[MOST_STAGES], W[MOST_STAGES + 1], *move = st->part;
  for (Int i = 0; i < count; i++) {
    Int k = of[i], at = k * s;
    double h = x->h[k], z = (time[i] - x->t[k]) / h;
    const double *input = given + i * m->inputs->columns;
    if (!given) prescribed(m->inputs, time[i], m->input), input = m->input;
    weights(m->basis, s, z, 1, B1);
    weights(m->basis, s, z, 2, B2);
    weights(m->basis_0, s + 1, z, 0, W);
    for (Int j = 0; j < nv; j++) v[j] = x->v0[k * nv + j], move[j] = h * z * v[j];
    add_stages(s, nv, h, B1, x->a + at * nv, v);
    add_stages(s, nv, h * h, B2, x->a + at * nv, move);
    if (st->balls + st->bodies) add_stages(s, nv, h, B1, x->turn + at * nv, move);
    retract(t, st, x->y0 + k * t->nq, move, y);
    through(s, nv, W, x->a0 + k * nv, x->a + at * nv, a);
    through(s, rows, W, x->lam0 + k * rows, x->lam + at * rows, lam);
    through(s, motors, W, x->torque0 + k * motors, x->torque + at * motors, torque);
    for (Int j = 0; j < led(st); j++)
      v[st->motor_v[j]] = input[motors + j], a[st->motor_v[j]] = input[2 * motors + j];
    write_motors(st, input, y);
    work[0] = work[1] = 0.0;
    add_stages(s, 2, h, B1, x->power + 2 * at, work);
    y += t->nq, v += nv, a += nv, lam += rows, torque += motors, work += 2;
  }
}
