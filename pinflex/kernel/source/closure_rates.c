/* Second derivatives of the closures along the motion at which a tangent was taken.

   With d the gap, u an axis of a, e one of b, of a frame that turns by w, alpha: u' = w x u and
   u'' = alpha x u + w x u'; gravity, which is in both accelerations, leaves their difference.

     point      c'' = u'' . d + 2 u' . d' + u . d''
     direction  c'' = u'' . e + 2 u' . e' + u . e''
     distance   c'' = (d' . d' + d . d'') / l */
#include "tangent.h"

typedef struct { double x[3], dx[3], ddx[3]; } Moving;

/* A vector that turns with a node. */
static void turning(const Frozen *n, const double *R, Int axis, Moving *u) {
  double swept[3];
  for (int d = 0; d < 3; d++) u->x[d] = R[3 * d + axis];
  crossed(n->v + 3, u->x, u->dx);
  crossed(n->v + 3, u->dx, u->ddx);
  crossed(n->a + 3, u->x, swept);
  for (int d = 0; d < 3; d++) u->ddx[d] += swept[d];
}

/* A point that moves with a node, whose v and a are those of the world's origin. */
static void moving(const Frozen *n, const double *p, Moving *x) {
  double swept[3];
  crossed(n->v + 3, p, x->dx);
  for (int d = 0; d < 3; d++) x->x[d] = p[d], x->dx[d] += n->v[d];
  crossed(n->v + 3, x->dx, x->ddx);
  crossed(n->a + 3, p, swept);
  for (int d = 0; d < 3; d++) x->ddx[d] += n->a[d] + swept[d];
}

static double product_rate(const Moving *u, const Moving *d) {
  return times(u->ddx, d->x, 3) + 2.0 * times(u->dx, d->dx, 3) + times(u->x, d->ddx, 3);
}

void closure_rates(const Tables *t, double *memory, double *out) {
  Tangent w;
  tangent_layout(t, memory, &w);
  memset(&w.base, 0, sizeof w.base);
  for (int d = 0; d < 3; d++) w.base.R[4 * d] = 1.0, w.base.a[d] = -t->gravity[d];
  for (Int k = 0; k < t->loops; k++) {
    const Frozen *A = t->node_a[k] < 0 ? &w.base : w.frozen + t->node_a[k];
    const Frozen *B = t->node_b[k] < 0 ? &w.base : w.frozen + t->node_b[k];
    Frame a, b;
    Moving gap, from, u, e;
    frame_of(A, t->frame_a + 12 * k, &a);
    frame_of(B, t->frame_b + 12 * k, &b);
    moving(A, a.p, &from);
    moving(B, b.p, &gap);
    for (int d = 0; d < 3; d++)
      gap.x[d] -= from.x[d], gap.dx[d] -= from.dx[d], gap.ddx[d] -= from.ddx[d];
    for (Int at = t->loop_at[k]; at < t->loop_at[k + 1]; at++) {
      double *c = out + t->row_number[at];
      turning(A, a.R, t->row_a[at], &u);
      turning(B, b.R, t->row_b[at], &e);
      if (t->row_kind[at] == POINT)
        *c = product_rate(&u, &gap);
      else if (t->row_kind[at] == DIRECTION)
        *c = product_rate(&u, &e);
      else
        *c = (times(gap.dx, gap.dx, 3) + times(gap.x, gap.ddx, 3)) / t->row_length[at];
    }
  }
  coupling_rates(t, &w, out);
}
