/* Closure rows by the coordinates: J = W (J_B - J_A), and what K gets from forces that follow.

   A closure force turns with frame a and acts at frame b. In the bodies' own frames, where the
   derivatives of the tree hold it fixed, it therefore changes with the motion of B against A:

     K -= J_B' S_B (J_B - J_A) - J_A' S_A (J_B - J_A)

   with p = p_b, force F and lam of the loop's rows, [x] the matrix of x cross:

     S_B = [0, [F]; 0, [p][F] + lam [e_b][e_a]],   S_A = [0, 0; -[F], [F][p] + lam [e_a][e_b]]

   and for a distance, on both, lam/l (1; [p]) (1, -[p]). */
#include "tangent.h"
#include <string.h>

typedef struct { double R[9], p[3]; } Frame;

static void frame_of(const Frozen *n, const double *local, Frame *out) {
  for (int d = 0; d < 3; d++) {
    const double *row = n->R + 3 * d;
    for (int e = 0; e < 3; e++)
      out->R[3 * d + e] = row[0] * local[e] + row[1] * local[4 + e] + row[2] * local[8 + e];
    out->p[d] = n->p[d] + row[0] * local[3] + row[1] * local[7] + row[2] * local[11];
  }
}

/* out += k [a][b] in the columns 3 ... 5 of three rows of a (6, 6). */
static void add_twice_skew(const double *a, const double *b, double k, double *out) {
  double ab = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  for (int d = 0; d < 3; d++)
    for (int e = 0; e < 3; e++) out[6 * d + 3 + e] += k * (b[d] * a[e] - (d == e ? ab : 0.0));
}

static void add_skew(const double *a, double k, double *out) {
  out[1] -= k * a[2], out[2] += k * a[1], out[6] += k * a[2];
  out[8] -= k * a[0], out[12] -= k * a[1], out[13] += k * a[0];
}

/* lam/l (1; [p]) (1, -[p]) */
static void add_stretch(const double *p, double k, double *out) {
  for (int d = 0; d < 3; d++) out[7 * d] += k;
  add_skew(p, -k, out + 3);
  add_skew(p, k, out + 18);
  add_twice_skew(p, p, -k, out + 18);
}

/* Columns of a node's support times the map: (6, nv). */
static void lift(const Tables *t, const Tangent *w, Int node, double *out) {
  static const Int widths[] = {1, 1, 1, 3, 3, 6, 3};
  memset(out, 0, 6 * t->nv * sizeof(double));
  for (; node >= 0; node = t->parent[node])
    for (Int j = t->node_v[node]; j < t->node_v[node] + widths[t->kind[node]]; j++)
      for (Int k = t->x_at[j]; k < t->x_at[j + 1]; k++)
        for (int d = 0; d < 6; d++)
          out[d * t->nv + t->col_first[j] + k - t->x_at[j]] += w->column[j].S[d] * w->x[k];
}

/* One row: u along d and e x u about, and its place in the stiffness. */
static void wrench_row(const Tables *t, Int at, const Frame *a, const Frame *b, double lam,
                       double *W, double *force, double *on_a, double *on_b) {
  double u[3], e[3], gap[3];
  for (int d = 0; d < 3; d++) {
    u[d] = a->R[3 * d + t->row_a[at]];
    e[d] = b->R[3 * d + t->row_b[at]];
    gap[d] = (b->p[d] - a->p[d]) / t->row_length[at];
  }
  if (t->row_kind[at] == DIRECTION) {
    W[0] = W[1] = W[2] = 0.0;
    W[3] = e[1] * u[2] - e[2] * u[1], W[4] = e[2] * u[0] - e[0] * u[2];
    W[5] = e[0] * u[1] - e[1] * u[0];
    add_twice_skew(e, u, lam, on_b + 18);
    add_twice_skew(u, e, lam, on_a + 18);
    return;
  }
  const double *n = t->row_kind[at] == POINT ? u : gap, *p = b->p;
  for (int d = 0; d < 3; d++) W[d] = n[d], force[d] += lam * n[d];
  W[3] = p[1] * n[2] - p[2] * n[1], W[4] = p[2] * n[0] - p[0] * n[2];
  W[5] = p[0] * n[1] - p[1] * n[0];
  if (t->row_kind[at] == POINT) return;
  add_stretch(p, lam / t->row_length[at], on_a);
  add_stretch(p, lam / t->row_length[at], on_b);
}

/* K += sign J' S D */
static void add_product(Int nv, const double *J, const double *S, const double *D, double sign,
                        double *pushed, double *K) {
  for (int d = 0; d < 6; d++)
    for (Int j = 0; j < nv; j++) {
      double sum = 0;
      for (int e = 0; e < 6; e++) sum += S[6 * d + e] * D[e * nv + j];
      pushed[d * nv + j] = sum;
    }
  for (int d = 0; d < 6; d++)
    for (Int i = 0; i < nv; i++) {
      double x = sign * J[d * nv + i];
      if (x == 0.0) continue;
      for (Int j = 0; j < nv; j++) K[i * nv + j] += x * pushed[d * nv + j];
    }
}

void close_tangent(const Tables *t, Tangent *w, const Lane *lam, double *K, double *J) {
  Int nv = t->nv, size = 6 * nv;
  double *on_A = w->lifted, *on_B = on_A + size, *D = on_B + size, *pushed = D + size;
  for (Int k = 0; k < t->loops; k++) {
    Int A = t->node_a[k], B = t->node_b[k];
    Frame a, b;
    double S_A[36] = {0}, S_B[36] = {0}, force[3] = {0};
    frame_of(A < 0 ? &w->base : w->frozen + A, t->frame_a + 12 * k, &a);
    frame_of(B < 0 ? &w->base : w->frozen + B, t->frame_b + 12 * k, &b);
    lift(t, w, A, on_A);
    lift(t, w, B, on_B);
    for (Int i = 0; i < size; i++) D[i] = on_B[i] - on_A[i];
    for (Int at = t->loop_at[k]; at < t->loop_at[k + 1]; at++) {
      Int row = t->row_number[at];
      double W[6];
      wrench_row(t, at, &a, &b, lam[row][0], W, force, S_A, S_B);
      for (Int j = 0; j < nv; j++) {
        double sum = 0;
        for (int d = 0; d < 6; d++) sum += W[d] * D[d * nv + j];
        J[row * nv + j] = sum;
      }
    }
    add_skew(force, 1.0, S_B + 3);
    add_twice_skew(b.p, force, 1.0, S_B + 18);
    add_skew(force, -1.0, S_A + 18);
    add_twice_skew(force, b.p, 1.0, S_A + 18);
    add_product(nv, on_B, S_B, D, -1.0, pushed, K);
    add_product(nv, on_A, S_A, D, 1.0, pushed, K);
  }
}
