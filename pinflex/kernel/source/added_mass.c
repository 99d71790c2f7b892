/* Masses that differ with the direction: M (6, 6) about the origin of a node, in its axes. Of the
   node's motion v and spatial acceleration a, in which gravity has no part, it needs

     f = M a + v x* (M v)

   and with the columns S, Y, Z, U of tangent.c, Z here of the acceleration without gravity, f changes by

     da_j: M S_j     dv_j: B S_j + M U_j     dq_j: B Y_j + M Z_j
     B s = v x* (M s) + s x* (M v) - M (v x s)

   beside S_j x* f of joints below, which the tree brings. That of a payload which comes or goes counts in
   the share of its weight. Source: Lamb, Hydrodynamics, art. 124. */
#include "tangent.h"

void add_masses(const Tables *t, Work *w, const Lane *scale) {
  for (Int k = 0; k < t->added; k++) {
    const Lane share = added_share(t, k, scale);
    Node *n = node_at(w, t->added_node[k]);
    Lane g[3], swept[3], v[6], a[6], h[6], f[6];
    const Lane down[3] = {lane(t->gravity[0]), lane(t->gravity[1]), lane(t->gravity[2])};
    turn_back(n->R, down, g);
    cross(n->w, n->v, swept);
    for (int d = 0; d < 3; d++) {
      v[d] = n->v[d], v[3 + d] = n->w[d];
      a[d] = n->a[d] + g[d] - swept[d], a[3 + d] = n->alpha[d];
    }
    for (int d = 0; d < 6; d++) {
      const double *row = t->added_inertia + 36 * k + 6 * d;
      h[d] = f[d] = lane(0);
      for (int e = 0; e < 6; e++) h[d] += row[e] * v[e], f[d] += row[e] * a[e];
    }
    for (int part = 0; part < 2; part++) { /* w x h and, of the moment, v x h */
      cross(n->w, h + 3 * part, swept);
      for (int d = 0; d < 3; d++) f[3 * part + d] += swept[d];
    }
    cross(n->v, h, swept);
    for (int d = 0; d < 3; d++) n->F[d] += share * f[d], n->N[d] += share * (f[3 + d] + swept[d]);
  }
}

/* M s, both in the world. */
static void inertia_of(const double *M, const Frozen *n, const double *s, double *out) {
  double own[6], f[6], arm[3];
  crossed(n->p, s + 3, arm);
  for (int d = 0; d < 3; d++) arm[d] = s[d] - arm[d];
  for (int d = 0; d < 3; d++) {
    own[d] = n->R[d] * arm[0] + n->R[3 + d] * arm[1] + n->R[6 + d] * arm[2];
    own[3 + d] = n->R[d] * s[3] + n->R[3 + d] * s[4] + n->R[6 + d] * s[5];
  }
  for (int d = 0; d < 6; d++) f[d] = times(M + 6 * d, own, 6);
  rotated(n->R, f, out);
  rotated(n->R, f + 3, out + 3);
  crossed(n->p, out, arm);
  for (int d = 0; d < 3; d++) out[3 + d] += arm[d];
}

/* out += B s */
static void add_swing(const double *M, const Frozen *n, const double *s, double *out) {
  double h[6], part[6], swept[6];
  inertia_of(M, n, s, h);
  wrench_cross(n->v, h, part);
  for (int d = 0; d < 6; d++) out[d] += part[d];
  inertia_of(M, n, n->v, h);
  wrench_cross(s, h, part);
  for (int d = 0; d < 6; d++) out[d] += part[d];
  motion_cross(n->v, s, swept);
  inertia_of(M, n, swept, part);
  for (int d = 0; d < 6; d++) out[d] -= part[d];
}

/* Columns of a node by the coordinates, (nv,): S_j x_j, Y_j x_j + S_j x_j' and so on, see path.c. */
static void lift_columns(const Tables *t, const Tangent *w, Int node, Column *to) {
  memset(to, 0, t->nv * sizeof(Column));
  for (; node >= 0; node = t->parent[node])
    for (Int i = t->node_v[node]; i < t->node_v[node] + width(t->kind[node]); i++) {
      const Column *c = w->column + i;
      Column *out = to + t->block_at[t->block_of[i]];
      Int at = t->x_at[i];
      for (Int p = at; p < at + columns_of(t, t->block_of[i]); p++, out++)
        for (int d = 0; d < 6; d++) {
          out->S[d] += c->S[d] * w->x[p];
          out->Y[d] += c->Y[d] * w->x[p] + c->S[d] * w->dx[p];
          out->U[d] += c->U[d] * w->x[p] + 2.0 * c->S[d] * w->dx[p];
          out->Z[d] += c->Z[d] * w->x[p] + c->U[d] * w->dx[p] + c->S[d] * w->ddx[p];
        }
    }
}

/* Column j of M, C and K by what a node needs for a share of its mass. */
static void added_column(const Tables *t, Tangent *w, Int k, Int j, double share, const Column *columns) {
  const double *M = t->added_inertia + 36 * k;
  const Frozen *n = w->frozen + t->added_node[k];
  const Column *c = columns + j;
  double Z[6], by_a[6], by_v[6], by_q[6];
  crossed(t->gravity, c->S + 3, Z);
  for (int d = 0; d < 3; d++) Z[d] += c->Z[d], Z[3 + d] = c->Z[3 + d];
  inertia_of(M, n, c->S, by_a);
  inertia_of(M, n, c->U, by_v);
  inertia_of(M, n, Z, by_q);
  add_swing(M, n, c->S, by_v);
  add_swing(M, n, c->Y, by_q);
  for (Int i = 0; i < t->nv; i++) {
    const double *S = columns[i].S;
    w->M[i * t->nv + j] += share * times(S, by_a, 6);
    w->C[i * t->nv + j] += share * times(S, by_v, 6);
    w->K[i * t->nv + j] += share * times(S, by_q, 6);
  }
}

void added_tangent(const Tables *t, Tangent *w, const Lane *scale) {
  Column *columns = (Column *)w->lifted;
  for (Int k = 0; k < t->added; k++) {
    lift_columns(t, w, t->added_node[k], columns);
    for (Int j = 0; j < t->nv; j++) added_column(t, w, k, j, added_share(t, k, scale)[0], columns);
  }
}
