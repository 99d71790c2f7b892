/* What mass points add to the tangent, many coordinates of their link side by side.

   A point of mass m at c of a node that turns by w, alpha moves by its own coordinates, N the axes of
   its joint in the world and x their rows of the map, by e = N x, and is accelerated by them as

     v: p = 2 (w x e + N x')     q: s = alpha x e + w x (w x e + 2 N x') + N x''

   It moves by c' in all, and needs, in the terms of path.c and with the force F on it,

     a = m (1, c x) e    v = m (1, c x) p    q = m (1, c x) s + (0, e x F)    b = 2 m c' x e

   and by itself  m e.e,  m e.p,  m e.s. */
#include "tangent.h"

/* A point as it moves with its node. */
typedef struct { double m, N[9], c[3], dc[3], F[3]; Int block, node, first; } Point;

static void point_of(const Tables *t, const Work *lanes, const Tangent *w, Int k, Point *out) {
  Int first = t->point_v[k], node = t->point_node[k];
  const Frozen *up = node < 0 ? &w->base : w->frozen + node;
  const double *R = t->point_R + 9 * k;
  double s[3], swept[3], force[3];
  out->m = t->point_mass[k], out->block = t->block_of[first], out->node = node, out->first = first;
  for (int d = 0; d < 3; d++) {
    s[d] = t->point_p[3 * k + d] + times(R + 3 * d, w->u + 3 * k, 3);
    force[d] = lanes->V[first + d][0];
    for (int e = 0; e < 3; e++)
      out->N[3 * d + e] = up->R[3 * d] * R[e] + up->R[3 * d + 1] * R[3 + e] + up->R[3 * d + 2] * R[6 + e];
  }
  rotated(up->R, s, out->c);
  for (int d = 0; d < 3; d++) out->c[d] += up->p[d];
  crossed(up->v + 3, out->c, swept);
  rotated(out->N, w->rate + first, out->dc);
  for (int d = 0; d < 3; d++) out->dc[d] += up->v[d] + swept[d];
  rotated(out->N, force, out->F);
}

/* Its moments, and those of its momentum, on its node. */
static void carry(const Point *point, Moments *to) {
  Moments I;
  point_moments(point->m, point->c, &I);
  for (int d = 0; d < 3; d++) {
    I.P[d] = point->m * point->dc[d];
    for (int e = 0; e < 3; e++) I.Z[3 * d + e] = I.P[d] * point->c[e];
  }
  add_moments(to, &I);
}

static void fixed(const double *x, Lane *out) {
  for (int d = 0; d < 3; d++) out[d] = lane(x[d]);
}

/* N times four coordinates of the rows of the point. */
static void turn_rows(const Tables *t, const Point *point, const double *rows, Int c, Lane *out) {
  Lane x[3];
  for (int d = 0; d < 3; d++) x[d] = *(Lane *)(rows + t->x_at[point->first + d] + LANES * c);
  turn_by(point->N, x, out);
}

/* need += m (1, c x) of a vector */
static void add_wrench(double m, const Lane *c, const Lane *x, Int wide, Lane *need) {
  Lane arm[3];
  cross(c, x, arm);
  for (int d = 0; d < 3; d++) need[d * wide] += m * x[d], need[(3 + d) * wide] += m * arm[d];
}

/* Of four coordinates: what is needed, and e, p and s. */
static void four(const Tables *t, Tangent *at, const Frozen *up, const Point *point, Int c) {
  Int wide = at->along.wide;
  Lane *need = at->along.need + c, *row = at->along.map + c;
  Lane w[3], alpha[3], arm[3], dc[3], F[3], e[3], de[3], dde[3], swept[3], p[3], s[3];
  fixed(up->v + 3, w), fixed(up->a + 3, alpha), fixed(point->c, arm), fixed(point->dc, dc);
  fixed(point->F, F);
  turn_rows(t, point, at->x, c, e);
  turn_rows(t, point, at->dx, c, de);
  turn_rows(t, point, at->ddx, c, dde);
  add_wrench(point->m, arm, e, wide, need);
  for (int d = 0; d < 3; d++) row[d * wide] = e[d];
  if (at->along.mass) return;
  cross(w, e, swept);
  for (int d = 0; d < 3; d++) p[d] = 2.0 * (swept[d] + de[d]), swept[d] += 2.0 * de[d];
  cross(w, swept, s);
  cross(alpha, e, swept);
  for (int d = 0; d < 3; d++) s[d] += swept[d] + dde[d];
  add_wrench(point->m, arm, p, wide, need + 6 * wide);
  add_wrench(point->m, arm, s, wide, need + 12 * wide);
  cross(e, F, swept);
  for (int d = 0; d < 3; d++) need[(15 + d) * wide] += swept[d];
  cross(dc, e, swept);
  for (int d = 0; d < 3; d++) need[(18 + d) * wide] += 2.0 * point->m * swept[d];
  for (int d = 0; d < 3; d++)
    row[(3 + d) * wide] = p[d], row[(6 + d) * wide] = s[d];
}

void point_tangent(const Tables *t, const Work *lanes, Tangent *w) {
  Int wide = w->along.wide;
  begin_needs(&w->along);
  for (Int k = 0; k < t->points; k++) {
    Point point;
    point_of(t, lanes, w, k, &point);
    const Frozen *up = point.node < 0 ? &w->base : w->frozen + point.node;
    if (point.node >= 0) carry(&point, &w->frozen[point.node].I);
    if (!in_part(&w->along, point.block)) continue;
    for (Int c = 0; c < lanes_of(columns_of(t, point.block)); c++) four(t, w, up, &point, c);
    for (int d = 0; d < 3; d++) {
      const Lane *e = w->along.map + d * wide;
      add_own(t, &w->along, point.block, point.m, (const double *)e, e, 3 * wide);
    }
    /* Points of one link on one node are met together. */
    Int next = k + 1 < t->points ? t->block_of[t->point_v[k + 1]] : -1;
    if (next == point.block && t->point_node[k + 1] == point.node) continue;
    go_to(t, w, point.node);
    meet(t, &w->along, point.block, point.node);
    begin_needs(&w->along);
  }
}
