/* Loop closures: what is open, and what their multipliers do to the bodies.

   Frame a on body A, frame b on body B, gap d = p_b - p_a, all in the world:

     point      c = u . d                     force  lam u        at p_b, u an axis of a
     direction  c = e_a . e_b                 moment lam e_b x e_a
     distance   c = (d . d - l^2) / (2 l)     force  lam d / l    at p_b

   on B, the opposite at the same point on A; what the bodies need is less by that. */
#include "kernel.h"

typedef struct { Lane R[9], p[3]; } Frame;

/* Frame [R | p] (3, 4) of a node in the world. */
static void frame_of(const Node *n, const double *local, Frame *out) {
  for (int d = 0; d < 3; d++) {
    const Lane *row = n->R + 3 * d;
    for (int e = 0; e < 3; e++)
      out->R[3 * d + e] = row[0] * local[e] + row[1] * local[4 + e] + row[2] * local[8 + e];
    out->p[d] = n->p[d] + row[0] * local[3] + row[1] * local[7] + row[2] * local[11];
  }
}

static void column(const Frame *f, Int axis, Lane *out) {
  for (int d = 0; d < 3; d++) out[d] = f->R[3 * d + axis];
}

/* Add a wrench of the world (force at a point, moment) times a sign to a node's. */
static void add_wrench(Node *n, const Lane *at, const Lane *force, const Lane *moment, double sign) {
  Lane arm[3], M[3], own[3];
  for (int d = 0; d < 3; d++) arm[d] = at[d] - n->p[d];
  cross(arm, force, M);
  for (int d = 0; d < 3; d++) M[d] += moment[d];
  turn_back(n->R, force, own);
  for (int d = 0; d < 3; d++) n->F[d] += sign * own[d];
  turn_back(n->R, M, own);
  for (int d = 0; d < 3; d++) n->N[d] += sign * own[d];
}

void close_loops(const Tables *t, Work *w, const Lane *lam, Lane *c) {
  for (Int k = 0; k < t->loops; k++) {
    Node *A = node_at(w, t->node_a[k]), *B = node_at(w, t->node_b[k]);
    Frame a, b;
    Lane gap[3], F[3] = {lane(0), lane(0), lane(0)}, M[3] = {lane(0), lane(0), lane(0)};
    frame_of(A, t->frame_a + 12 * k, &a);
    frame_of(B, t->frame_b + 12 * k, &b);
    for (int d = 0; d < 3; d++) gap[d] = b.p[d] - a.p[d];
    for (Int at = t->loop_at[k]; at < t->loop_at[k + 1]; at++) {
      Int row = t->row_number[at];
      Lane u[3], e[3], moment[3];
      if (t->row_kind[at] == POINT) {
        column(&a, t->row_a[at], u);
        c[row] = dot(u, gap);
        for (int d = 0; d < 3; d++) F[d] += lam[row] * u[d];
      } else if (t->row_kind[at] == DIRECTION) {
        column(&a, t->row_a[at], u);
        column(&b, t->row_b[at], e);
        c[row] = dot(u, e);
        cross(e, u, moment);
        for (int d = 0; d < 3; d++) M[d] += lam[row] * moment[d];
      } else {
        double l = t->row_length[at];
        c[row] = (dot(gap, gap) - l * l) / (2.0 * l);
        for (int d = 0; d < 3; d++) F[d] += lam[row] * gap[d] / l;
      }
    }
    for (int d = 0; w->wrench && d < 3; d++)
      w->wrench[6 * k + d] = F[d], w->wrench[6 * k + 3 + d] = M[d];
    add_wrench(B, b.p, F, M, -1.0);
    add_wrench(A, b.p, F, M, 1.0);
  }
  if (t->sleeves) push_sleeves(t, w, lam, c);
}
