/* Rows of sleeves by the coordinates, and what their second derivatives add to the tangent.

   With Z = dz/dy, the motion of frame b in frame a, and E the columns of the beam's eta:

     J = h_z Z + h_eta E,     K -= lam (Z, E)' h'' (Z, E)

   and the wrenches turn with the frames as those of other closures, see closure_tangent.c. */
#include "sleeves.h"
#include "tangent.h"

/* Z, (9, nv): R' (v + w x p), R' (w x e), from B's motion against A's (v, w) at the origin, (6, nv). */
static void relative(Int nv, const Pose *a, const Pose *b, const double *D, double *Z) {
  for (Int j = 0; j < nv; j++) {
    double v[3] = {D[j], D[nv + j], D[2 * nv + j]};
    double turn[3] = {D[3 * nv + j], D[4 * nv + j], D[5 * nv + j]}, x[9];
    crossed(turn, b->p, x);
    for (int d = 0; d < 3; d++) x[d] += v[d];
    for (int axis = 0; axis < 2; axis++) {
      double e[3] = {b->R[axis], b->R[3 + axis], b->R[6 + axis]};
      crossed(turn, e, x + 3 + 3 * axis);
    }
    for (int k = 0; k < 9; k++) {
      const double *y = x + k / 3 * 3;
      Z[k * nv + j] = a->R[k % 3] * y[0] + a->R[3 + k % 3] * y[1] + a->R[6 + k % 3] * y[2];
    }
  }
}

/* Variables of the jets that are coordinates: their columns, in order; how many there are. */
static Int columns(const Sleeve *w, Int part, Int *to) {
  Int stretch = w->on - 1 + part;
  *to = w->t->nv_rigid + (w->reached[part] ? w->t->stretch_eta[stretch] : 0);
  return w->reached[part] ? w->t->track_n[w->t->stretch_track[stretch]] : 0;
}

static void add_row(const Sleeve *w, const double *h, const double *Z, double *J) {
  Int nv = w->t->nv, to;
  memset(J, 0, nv * sizeof(double));
  for (Int k = 0; k < 9; k++)
    for (Int j = 0; j < nv; j++) J[j] += h[2 + k] * Z[k * nv + j];
  for (Int part = 0; part < 3; part++) {
    Int n = columns(w, part, &to);
    for (Int i = 0; i < n; i++) J[to + i] += h[1 + w->reached[part] + i];
  }
}

/* K -= Z' h'' Z of z, and of z and one stretch. */
static void add_second(const Sleeve *w, const double *h, const double *Z, double *moved, double *K) {
  const Room *r = &w->room;
  Int nv = w->t->nv, to;
  for (Int k = 0; k < 9; k++)
    for (Int j = 0; j < nv; j++) {
      double sum = 0.0;
      for (Int i = 0; i < 9; i++)
        sum += h[i < k ? hess(r, 1 + k, 1 + i) : hess(r, 1 + i, 1 + k)] * Z[i * nv + j];
      moved[k * nv + j] = sum;
    }
  for (Int k = 0; k < 9; k++)
    for (Int i = 0; i < nv; i++)
      for (Int j = 0; j < nv; j++) K[i * nv + j] -= Z[k * nv + i] * moved[k * nv + j];
  for (Int part = 0; part < 3; part++) {
    Int n = columns(w, part, &to), first = w->reached[part];
    for (Int i = 0; i < n; i++)
      for (Int k = 0; k < 9; k++) {
        double x = h[hess(r, first + i, 1 + k)];
        for (Int j = 0; j < nv; j++) {
          K[(to + i) * nv + j] -= x * Z[k * nv + j];
          K[j * nv + to + i] -= x * Z[k * nv + j];
        }
      }
  }
}

/* K -= h'' of the coordinates of two stretches. */
static void add_bending(const Sleeve *w, const double *h, double *K) {
  Int nv = w->t->nv, to, from;
  for (Int part = 0; part < 3; part++)
    for (Int other = 0; other < 3; other++) {
      Int n = columns(w, part, &to), m = columns(w, other, &from);
      for (Int i = 0; i < n; i++)
        for (Int j = 0; j < m; j++) {
          Int a = w->reached[part] + i, b = w->reached[other] + j;
          K[(to + i) * nv + from + j] -= h[a < b ? hess(&w->room, b, a) : hess(&w->room, a, b)];
        }
    }
}

/* Wrenches that follow frame a and act at frame b, see closure_tangent.c. */
static void follow(const Pose *b, const double *n, double *S_A, double *S_B) {
  memset(S_A, 0, 36 * sizeof(double)), memset(S_B, 0, 36 * sizeof(double));
  add_skew(n, 1.0, S_B + 3);
  add_twice_skew(b->p, n, 1.0, S_B + 21);
  add_skew(n, -1.0, S_A + 18);
  add_twice_skew(n, b->p, 1.0, S_A + 21);
  for (int axis = 0; axis < 2; axis++) {
    double e[3] = {b->R[axis], b->R[3 + axis], b->R[6 + axis]};
    add_twice_skew(e, n + 3 + 3 * axis, 1.0, S_B + 21);
    add_twice_skew(n + 3 + 3 * axis, e, 1.0, S_A + 21);
  }
}

void sleeve_tangent(const Tables *t, const Work *lanes, Tangent *at, const Lane *lam, double *K,
                    double *J) {
  Int nv = t->nv, size = 6 * nv;
  double *on_A = at->lifted, *on_B = on_A + size, *D = on_B + size, *pushed = D + size;
  for (Int k = 0; k < t->sleeves; k++) {
    Sleeve w;
    Pose a, b;
    Jet h[MOST_SLEEVE_ROWS];
    sleeve_of_lane(t, lanes, k, 0, &w, &a, &b);
    double *Z = take(&w.room, 9 * nv), *moved = take(&w.room, 9 * nv);
    lift(t, at, t->stretch_node[w.on], on_A);
    lift(t, at, t->sleeve_node[k], on_B);
    for (Int i = 0; i < size; i++) D[i] = on_B[i] - on_A[i];
    relative(nv, &a, &b, D, Z);
    sleeve_rows(&w, COORDINATES, K != 0, h);
    Jet total = jet(&w.room, 0.0);
    for (Int i = t->sleeve_at[k]; i < t->sleeve_at[k + 1]; i++) {
      const double *row = h[i - t->sleeve_at[k]];
      add_row(&w, row, Z, J + t->sleeve_row[i] * nv);
      if (K) add_jet(&w.room, total, lam[t->sleeve_row[i]][0], row);
    }
    if (!K) continue;
    double n[9], S_A[36], S_B[36];
    normals(&a, total, n);
    follow(&b, n, S_A, S_B);
    add_product(nv, on_B, S_B, D, -1.0, pushed, K);
    add_product(nv, on_A, S_A, D, 1.0, pushed, K);
    add_second(&w, total, Z, moved, K);
    add_bending(&w, total, K);
  }
}
