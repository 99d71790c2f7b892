/* Closure rows by the coordinates: J = W (J_B - J_A), and what K gets from forces that follow.

   A closure force turns with frame a and acts at frame b. In the bodies' own frames, where the
   derivatives of the tree hold it fixed, it therefore changes with the motion of B against A:

     K -= J_B' S_B (J_B - J_A) - J_A' S_A (J_B - J_A)

   with p = p_b, force F and lam of the loop's rows, [x] the matrix of x cross:

     S_B = [0, [F]; 0, [p][F] + lam [e_b][e_a]],   S_A = [0, 0; -[F], [F][p] + lam [e_a][e_b]]

   and for a distance, on both, lam/l (1; [p]) (1, -[p]). */
#include "tangent.h"

/* lam/l (1; [p]) (1, -[p]) */
static void add_stretch(const double *p, double k, double *out) {
  for (int d = 0; d < 3; d++) out[7 * d] += k;
  add_skew(p, -k, out + 3);
  add_skew(p, k, out + 18);
  add_twice_skew(p, p, -k, out + 21);
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
    crossed(e, u, W + 3);
    add_twice_skew(e, u, lam, on_b + 21);
    add_twice_skew(u, e, lam, on_a + 21);
    return;
  }
  const double *n = t->row_kind[at] == POINT ? u : gap, *p = b->p;
  for (int d = 0; d < 3; d++) W[d] = n[d], force[d] += lam * n[d];
  crossed(p, n, W + 3);
  if (t->row_kind[at] == POINT) return;
  add_stretch(p, lam / t->row_length[at], on_a);
  add_stretch(p, lam / t->row_length[at], on_b);
}

/* Rows of J of loop k, with B's motion against A's in D, (6, nv), and what they add to stiffness. */
static void loop_rows(const Tables *t, Int k, const Frame *a, const Frame *b, const Lane *lam,
                      const double *D, double *J, double *force, double *S_A, double *S_B) {
  Int nv = t->nv;
  for (Int at = t->loop_at[k]; at < t->loop_at[k + 1]; at++) {
    Int row = t->row_number[at];
    double W[6];
    wrench_row(t, at, a, b, lam ? lam[row][0] : 0.0, W, force, S_A, S_B);
    for (Int j = 0; j < nv; j++) {
      double sum = 0;
      for (int d = 0; d < 6; d++) sum += W[d] * D[d * nv + j];
      J[row * nv + j] = sum;
    }
  }
}

/* Frames of loop k, and motions of its bodies and of B against A by the coordinates. */
static void loop_motion(const Tables *t, Tangent *w, Int k, Frame *a, Frame *b, double *on_A,
                        double *on_B, double *D) {
  Int A = t->node_a[k], B = t->node_b[k];
  frame_of(A < 0 ? &w->base : w->frozen + A, t->frame_a + 12 * k, a);
  frame_of(B < 0 ? &w->base : w->frozen + B, t->frame_b + 12 * k, b);
  lift(t, w, A, on_A);
  lift(t, w, B, on_B);
  for (Int i = 0; i < 6 * t->nv; i++) D[i] = on_B[i] - on_A[i];
}

void close_jacobian(const Tables *t, Tangent *w, double *J) {
  Int size = 6 * t->nv;
  double *on_A = w->lifted, *on_B = on_A + size, *D = on_B + size;
  for (Int k = 0; k < t->loops; k++) {
    Frame a, b;
    double S_A[36] = {0}, S_B[36] = {0}, force[3] = {0};
    loop_motion(t, w, k, &a, &b, on_A, on_B, D);
    loop_rows(t, k, &a, &b, 0, D, J, force, S_A, S_B);
  }
  coupling_jacobian(t, w, J);
}

void close_tangent(const Tables *t, Tangent *w, const Lane *lam, double *K, double *J) {
  Int nv = t->nv, size = 6 * nv;
  double *on_A = w->lifted, *on_B = on_A + size, *D = on_B + size, *pushed = D + size;
  for (Int k = 0; k < t->loops; k++) {
    Frame a, b;
    double S_A[36] = {0}, S_B[36] = {0}, force[3] = {0};
    loop_motion(t, w, k, &a, &b, on_A, on_B, D);
    loop_rows(t, k, &a, &b, lam, D, J, force, S_A, S_B);
    add_skew(force, 1.0, S_B + 3);
    add_twice_skew(b.p, force, 1.0, S_B + 21);
    add_skew(force, -1.0, S_A + 18);
    add_twice_skew(force, b.p, 1.0, S_A + 21);
    add_product(nv, on_B, S_B, D, -1.0, pushed, K);
    add_product(nv, on_A, S_A, D, 1.0, pushed, K);
  }
  coupling_jacobian(t, w, J);
}
