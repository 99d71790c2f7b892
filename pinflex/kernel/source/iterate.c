/* Newton's iteration of a step until it has converged, failed, or needs a new tangent.

   It stops where the correction that is left, |dz| rate / (1 - rate), is below a goal and the loops
   were shut, or within `slack` times that where it cannot go on. Norms are those of displacements,
   in the weight of stiffness or mass. */
#include "newton.h"

double weighed(const Newton *n, const double *x) {
  double sum = 0.0;
  for (Int i = 0; i < n->measured; i++)
    sum += x[i] * inner(n->weight + i * n->measured, x, n->measured);
  return sum;
}

/* Largest sqrt(x' W x) of stages: x = change (if `changed`), the move and the start's eta (if
   `moved`), or both. */
static double norm(const Tables *t, const Stages *st, const Newton *n, int changed, int moved) {
  double largest = 0.0, *x = st->part; /* free between corrections */
  for (Int k = 0; k < st->s; k++) {
    for (Int i = 0; i < n->measured; i++) {
      Int row = n->measured_at[i];
      x[i] = changed ? st->change[k * t->nv + row] : 0.0;
      if (!moved) continue;
      x[i] += st->move[k * t->nv + row];
      if (row >= t->nv_rigid) x[i] += st->y0[row + t->nq_rigid - t->nv_rigid];
    }
    double sum = weighed(n, x);
    if (!(sum <= largest)) largest = sum; /* not a number counts as large */
  }
  return sqrt(fabs(largest));
}

double reached(const Tables *t, const Stages *st, const Newton *n) { return norm(t, st, n, 0, 1); }

/* Whether what is left, and what the loops were open by, is within `slack` times what it may be. */
static int close(const Tables *t, const Stages *st, const Newton *n, double slack) {
  double rate = n->rate, left = rate < 0.9 ? n->size * rate / (1.0 - rate) : INFINITY;
  double gap = 0.0, goal = slack * n->goal;
  for (Int i = 0; i < st->s * t->closures; i++) gap = fmax(gap, fabs(st->open[i]));
  /* Round-off has no rate. */
  int small = left <= goal || (n->iteration > 0 && n->size < 0.1 * goal);
  return small && (t->closures == 0 || gap < slack * n->open);
}

/* How an iteration ends that cannot go on. */
static int ended(const Tables *t, const Stages *st, const Newton *n) {
  return close(t, st, n, n->slack) ? CONVERGED : FAILED;
}

/* What the last correction says: -1 to go on, else how the iteration ends. */
static int judge(const Tables *t, const Stages *st, Newton *n) {
  double far = fmax(n->reach, n->goal);
  if (close(t, st, n, 1.0)) return CONVERGED;
  if (n->size > 1e3 * far || (n->iteration >= n->fresh + 2 && n->rate > 0.5))
    return n->fresh >= 0 || n->size > far ? ended(t, st, n) : AGED;
  return -1;
}

int newton(const Tables *t, char *memory, const Stages *st, Newton *n) {
  for (; n->iteration < n->most; n->iteration++) {
    if (!n->placed) pinflex_place(t, st);
    n->placed = 0;
    pinflex_balance(t, memory, st);
    pinflex_correct(t, st);
    double size = norm(t, st, n, 1, 0);
    if (!isfinite(size)) return FAILED;
    if (n->iteration == 0) {
      n->reach = fmax(fmax(n->scale, norm(t, st, n, 1, 1)), 1e-300);
      n->goal = fmax(n->least * n->reach, n->round_off);
    }
    n->rate = n->iteration ? size / fmax(n->size, 1e-300) : n->known;
    n->size = size;
    int end = judge(t, st, n);
    if (end == AGED) {
      if (++n->iteration == n->most) return ended(t, st, n);
      pinflex_place(t, st);
      n->placed = 1, n->fresh = n->iteration;
    }
    if (end >= 0) return end;
  }
  return ended(t, st, n);
}
