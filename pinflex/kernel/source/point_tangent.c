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

/* Rows of the map and of its rates from the columns of the block on, (9, wide). */
static void spread_rows(const Tables *t, Tangent *w, const Point *point) {
  Int wide = w->along.wide;
  const double *from[3] = {w->x, w->dx, w->ddx};
  memset(w->along.map, 0, 9 * wide * sizeof(Lane));
  for (int d = 0; d < 3; d++) {
    Int row = point->first + d, at = t->x_at[row], n = t->x_at[row + 1] - at;
    Int skip = t->col_first[row] - t->block_at[point->block];
    for (int k = 0; k < 3; k++)
      memcpy((double *)(w->along.map + (3 * k + d) * wide) + skip, from[k] + at, n * sizeof(double));
  }
}

static void fixed(const double *x, Lane *out) {
  for (int d = 0; d < 3; d++) out[d] = lane(x[d]);
}

/* N times three rows. */
static void turn_rows(const double *N, const Lane *x, Int wide, Lane *out) {
  for (int d = 0; d < 3; d++)
    out[d] = N[3 * d] * x[0] + N[3 * d + 1] * x[wide] + N[3 * d + 2] * x[2 * wide];
}

/* need += m (1, c x) of a vector */
static void add_wrench(double m, const Lane *c, const Lane *x, Int wide, Lane *need) {
  Lane arm[3];
  cross(c, x, arm);
  for (int d = 0; d < 3; d++) need[d * wide] += m * x[d], need[(3 + d) * wide] += m * arm[d];
}

/* Of four coordinates; e, p and s take the place of their rows. */
static void four(const Frozen *up, const Point *point, Int wide, Lane *row, Lane *need) {
  Lane w[3], alpha[3], c[3], dc[3], F[3], e[3], de[3], dde[3], swept[3], p[3], s[3];
  fixed(up->v + 3, w), fixed(up->a + 3, alpha), fixed(point->c, c), fixed(point->dc, dc), fixed(point->F, F);
  turn_rows(point->N, row, wide, e);
  turn_rows(point->N, row + 3 * wide, wide, de);
  turn_rows(point->N, row + 6 * wide, wide, dde);
  cross(w, e, swept);
  for (int d = 0; d < 3; d++) p[d] = 2.0 * (swept[d] + de[d]), swept[d] += 2.0 * de[d];
  cross(w, swept, s);
  cross(alpha, e, swept);
  for (int d = 0; d < 3; d++) s[d] += swept[d] + dde[d];
  add_wrench(point->m, c, e, wide, need);
  add_wrench(point->m, c, p, wide, need + 6 * wide);
  add_wrench(point->m, c, s, wide, need + 12 * wide);
  cross(e, F, swept);
  for (int d = 0; d < 3; d++) need[(15 + d) * wide] += swept[d];
  cross(dc, e, swept);
  for (int d = 0; d < 3; d++) need[(18 + d) * wide] += 2.0 * point->m * swept[d];
  for (int d = 0; d < 3; d++)
    row[d * wide] = e[d], row[(3 + d) * wide] = p[d], row[(6 + d) * wide] = s[d];
}

/* m e.e, m e.p and m e.s of all pairs of coordinates, (3, n, wide). */
static void add_own(double m, Int n, Int lanes, Int wide, const Lane *row, Lane *own) {
  for (Int k = 0; k < n; k++) {
    double e[3];
    for (int d = 0; d < 3; d++) e[d] = m * ((const double *)(row + d * wide))[k];
    for (int part = 0; part < 3; part++) {
      const Lane *x = row + 3 * part * wide;
      Lane *to = own + (part * n + k) * wide;
      for (Int c = 0; c < lanes; c++)
        to[c] += e[0] * x[c] + e[1] * x[wide + c] + e[2] * x[2 * wide + c];
    }
  }
}

/* What the points of one link on one node need together. */
static void meet_points(const Tables *t, Tangent *w, Int block, Int node) {
  Int nv = t->nv, at = t->block_at[block], n = t->block_at[block + 1] - at;
  double *out[3] = {w->M, w->C, w->K};
  go_to(t, w, node);
  meet(t, &w->along, block, node);
  for (int part = 0; part < 3; part++)
    for (Int k = 0; k < n; k++) {
      const double *own = (const double *)(w->along.own + (part * n + k) * w->along.wide);
      for (Int j = 0; j < n; j++) out[part][(at + k) * nv + at + j] += own[j];
    }
}

void point_tangent(const Tables *t, const Work *lanes, Tangent *w) {
  Int wide = w->along.wide, block = -1, node = -1;
  for (Int k = 0; k < t->points; k++) {
    Point point;
    point_of(t, lanes, w, k, &point);
    Int n = t->block_at[point.block + 1] - t->block_at[point.block], used = (n + LANES - 1) / LANES;
    if (block != point.block || node != point.node) {
      if (block >= 0) meet_points(t, w, block, node);
      block = point.block, node = point.node;
      begin_needs(&w->along);
      memset(w->along.own, 0, 3 * n * wide * sizeof(Lane));
    }
    spread_rows(t, w, &point);
    const Frozen *up = node < 0 ? &w->base : w->frozen + node;
    for (Int c = 0; c < used; c++) four(up, &point, wide, w->along.map + c, w->along.need + c);
    add_own(point.m, n, used, wide, w->along.map, w->along.own);
    if (node >= 0) carry(&point, &w->frozen[node].I);
  }
  if (block >= 0) meet_points(t, w, block, node);
}
