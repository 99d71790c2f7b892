/* Steps that end where a law of pieces bends: at contacts and releases.

   A step keeps to the pieces it began in. Where a coordinate or an elongation leaves its piece, x is the
   polynomial through its values at the start and the stages; the step is taken anew up to the root of
   that, then corrected by x' until x is at the border. So the order of the method holds on both sides. */
#include "march.h"
#include <stddef.h>

/* Landed; tries; what a step may end off a border by, of what it began off it by and moved. */
enum { TRIES = 12, HALVINGS = 60 };
#define SHORT 0.05 /* of its length: so far from a border a step that was cut to end there goes on */
#define NEAR(x) (1e-13 * (1.0 + fabs(x)))
#define SHUT 0.1 /* of what loops may be open by: so far off a border is at it */
#define FAR(x) (1e-9 * (1.0 + fabs(x)))

/* x of all laws at the start and the stages, (s + 1, kinks). */
static void reach(const Tables *t, char *memory, March *m) {
  Stages *st = m->stages;
  Int s = st->s, nv = t->nv, nq = t->nq;
  double *move = st->part;
  copy(m->placed, m->y, nq);
  for (Int i = 0; i < s; i++) {
    double *y = m->placed + (i + 1) * nq;
    for (Int j = 0; j < nv; j++) move[j] = st->move[i * nv + j] + st->change[i * nv + j];
    retract(t, st, m->y, move, y);
    write_motors(st, st->position + i * st->motors, y);
  }
  pinflex_elongations(t, memory, s + 1, m->placed, m->x);
}

/* Coefficients of the polynomial of one law. */
static void polynomial(const Tables *t, const March *m, Int k, double *c) {
  Int n = m->stages->s + 1;
  for (Int p = 0; p < n; p++) {
    c[p] = 0.0;
    for (Int i = 0; i < n; i++) c[p] += m->basis_0[p * n + i] * m->x[i * t->kinks + k];
  }
}

static double value(const double *c, Int n, double z) {
  double x = 0.0;
  for (Int p = n - 1; p >= 0; p--) x = x * z + c[p];
  return x;
}

static double rate_at_end(const double *c, Int n) {
  double x = 0.0;
  for (Int p = 1; p < n; p++) x += (double)p * c[p];
  return x;
}

/* Where a piece ends on a side, 1 or -1. */
static double border(const Tables *t, const March *m, Int k, Int side) {
  Int p = t->kink_at[k] + m->piece[k];
  if (side > 0) return p + 1 < t->kink_at[k + 1] ? t->kink_start[p + 1] : INFINITY;
  return p > t->kink_at[k] ? t->kink_start[p] : -INFINITY;
}

/* The part of the step after which one law leaves its piece on a side; 2: it does not. */
static double leaves(const Tables *t, const March *m, Int k, Int side) {
  const Stages *st = m->stages;
  Int n = st->s + 1, stride = t->kinks;
  double end = border(t, m, k, side), c[MOST_STAGES + 1];
  double from = fmax((double)side * m->x[k], (double)side * end) + NEAR(end);
  for (Int i = 1; i < n; i++) {
    if (!((double)side * m->x[i * stride + k] > from)) continue;
    double low = i > 1 ? st->c[i - 2] : 0.0, high = st->c[i - 1];
    polynomial(t, m, k, c);
    for (Int j = 0; j < HALVINGS; j++) {
      double middle = 0.5 * (low + high);
      if ((double)side * (value(c, n, middle) - end) > 0.0) high = middle;
      else low = middle;
    }
    return high;
  }
  return 2.0;
}

/* The first law that leaves its piece in the step, into `event` and `side`. */
static double first_out(const Tables *t, March *m) {
  double first = 2.0;
  for (Int k = 0; k < t->kinks; k++)
    for (Int side = -1; side <= 1; side += 2) {
      double z = leaves(t, m, k, side);
      if (z < first) first = z, m->event = k, m->side = side;
    }
  return first;
}

int land(const Tables *t, char *memory, March *m, double size) {
  Int n = m->stages->s + 1, k = m->event, side = m->side;
  double c[MOST_STAGES + 1], z, off, rate;
  reach(t, memory, m);
  z = first_out(t, m);
  if (z < 1.0 - 1e-6 || !m->landing) {
    if (z > 1.0) return PASSES;
    if (!m->landing) m->planned = size;
    m->size = z * size, m->landing++;
    if (m->size < m->shortest) return AT_ONCE;
    return m->landing > TRIES ? LOST : AGAIN;
  }
  m->event = k, m->side = side;
  polynomial(t, m, k, c);
  off = value(c, n, 1.0) - border(t, m, k, side), rate = rate_at_end(c, n) / size;
  if (fabs(off) <= fmax(NEAR(border(t, m, k, side)), SHUT * m->open) || m->landing > TRIES / 2) {
    m->speed = rate;
    return fabs(off) <= FAR(border(t, m, k, side)) ? LANDS : LOST;
  }
  if (z > 1.0 && fabs(off) > FAR(0.0) && !(fabs(off / rate) < SHORT * size)) {
    m->landing = 0; /* what a longer step has met, a shorter one does not come to */
    return PASSES;
  }
  m->size = size - fmin(fmax(off / rate, -0.5 * size), 0.5 * size);
  m->size = fmin(m->size, m->stop_at[m->stop] - m->t);
  m->landing++;
  return m->size > 0.0 ? AGAIN : LOST;
}
