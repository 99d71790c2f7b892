/* What dead loads and springs between frames add to C and K, beside what moves along with bodies.

   A dead load F, M at p does not turn with its body: K -= J' [0, [F]; 0, [p][F] + [M]] J. Of a
   spring that pulls by T along u = d / |d| from p_a to p_b, with e = p_b' - p_a' by the coordinates,
   s = u . e the stretch and f = T / |d| (k where a spring of no length has its ends together), the
   force on a changes by

     u ((k - f) s + c g) + f (e + d x w_a),   and by the rates: u (c s)

   where w_a is the turn of the body, which carries the force along; on b likewise, and opposite. Of
   a damper, whose ends part by q = v_b - v_a, the speed u . q changes with the coordinates by

     g = u . q' + (e - u s) . q / |d|,     v' = V + W x p + w x v

   of a point at p, with V, W by which its body's speeds accelerate it (V in path.c) and its turn w. */
#include "tangent.h"
#include <string.h>

static const Frozen *body(const Tangent *w, Int node) {
  return node < 0 ? &w->base : w->frozen + node;
}

static void point_at(const Frozen *n, const double *local, double *p) {
  rotated(n->R, local, p);
  for (int d = 0; d < 3; d++) p[d] += n->p[d];
}

static void dead_load(const Tables *t, Tangent *w, Int k, double scale, double *K) {
  Int nv = t->nv, size = 6 * nv;
  const double *load = t->force_load + 6 * k;
  double *J = w->lifted, *pushed = J + size, p[3], F[3], M[3], S[36] = {0};
  for (int d = 0; d < 3; d++) F[d] = scale * load[d], M[d] = scale * load[3 + d];
  point_at(body(w, t->force_node[k]), t->force_place + 3 * k, p);
  add_skew(F, 1.0, S + 3);
  add_twice_skew(p, F, 1.0, S + 21);
  add_skew(M, 1.0, S + 21);
  lift(t, w, t->force_node[k], J);
  add_product(nv, J, S, J, -1.0, pushed, K);
}

/* Column j of the motion of a point that moves with a body. */
static void point_column(Int nv, const double *J, const double *p, Int j, double *out) {
  double turn[3] = {J[3 * nv + j], J[4 * nv + j], J[5 * nv + j]}, swept[3];
  crossed(turn, p, swept);
  for (int d = 0; d < 3; d++) out[d] = J[d * nv + j] + swept[d];
}

/* K and C of one end, whose body has Jacobian J: sign is 1 for a, -1 for b. */
static void spring_end(const Tables *t, const double *J, const double *p, const double *d,
                       const double *u, const double *e, const double *faster, double per_length,
                       const double *law, double sign, double *pushed, double *C, double *K) {
  Int nv = t->nv;
  for (int rates = 0; rates < 2; rates++) {
    for (Int j = 0; j < nv; j++) {
      double turn[3] = {J[3 * nv + j], J[4 * nv + j], J[5 * nv + j]}, column[3], own[3], line[3];
      for (int i = 0; i < 3; i++) column[i] = e[i * nv + j];
      double stretch = times(u, column, 3);
      crossed(d, turn, own);
      for (int i = 0; i < 3; i++) {
        if (rates) line[i] = u[i] * law[1] * stretch;
        else
          line[i] = u[i] * ((law[0] - per_length) * stretch + law[1] * faster[j])
                    + per_length * (column[i] + own[i]);
        pushed[i * nv + j] = line[i];
      }
      crossed(p, line, own);
      for (int i = 0; i < 3; i++) pushed[(3 + i) * nv + j] = own[i];
    }
    add_transposed(nv, J, pushed, -sign, rates ? C : K);
  }
}

/* Velocity of a point that moves with a body. */
static void point_speed(const Frozen *n, const double *p, double *v) {
  crossed(n->v + 3, p, v);
  for (int d = 0; d < 3; d++) v[d] += n->v[d];
}

/* faster += sign u . v' of one end, at p, whose body has Jacobian J. */
static void add_faster(const Tables *t, Tangent *w, Int node, const double *J, const double *p,
                       const double *u, double sign, double *room, double *faster) {
  Int nv = t->nv;
  double v[3], moved[3], swept[3];
  point_speed(body(w, node), p, v);
  lift_speeds(t, w, node, room);
  for (Int j = 0; j < nv; j++) {
    double turn[3] = {J[3 * nv + j], J[4 * nv + j], J[5 * nv + j]};
    point_column(nv, room, p, j, moved);
    crossed(turn, v, swept);
    for (int d = 0; d < 3; d++) faster[j] += sign * u[d] * (moved[d] + swept[d]);
  }
}

/* Rate of a spring's length, and g: what the coordinates change of it. */
static double parting(const Tables *t, Tangent *w, Int k, const double *a, const double *b,
                      const double *u, double length, const double *J_a, const double *J_b,
                      const double *e, double *room, double *faster) {
  Int nv = t->nv;
  double from[3], q[3], rate;
  point_speed(body(w, t->spring_a[k]), a, from);
  point_speed(body(w, t->spring_b[k]), b, q);
  for (int d = 0; d < 3; d++) q[d] -= from[d];
  rate = times(u, q, 3);
  add_faster(t, w, t->spring_a[k], J_a, a, u, -1.0, room, faster);
  add_faster(t, w, t->spring_b[k], J_b, b, u, 1.0, room, faster);
  for (Int j = 0; j < nv; j++)
    for (int d = 0; d < 3; d++) faster[j] += (q[d] - rate * u[d]) * e[d * nv + j] / length;
  return rate;
}

static void spring(const Tables *t, const Work *lanes, Tangent *w, Int k, double *C, double *K) {
  Int nv = t->nv, size = 6 * nv;
  double *J_a = w->lifted, *J_b = J_a + size, *e = J_b + size, *faster = e + 3 * nv;
  double *pushed = e + size, rate = 0.0;
  double law[3] = {t->spring_law[3 * k], t->spring_law[3 * k + 1], t->spring_law[3 * k + 2]};
  double a[3], b[3], d[3], u[3], from[3], to[3];
  point_at(body(w, t->spring_a[k]), t->spring_place_a + 3 * k, a);
  point_at(body(w, t->spring_b[k]), t->spring_place_b + 3 * k, b);
  lift(t, w, t->spring_a[k], J_a);
  lift(t, w, t->spring_b[k], J_b);
  for (int i = 0; i < 3; i++) d[i] = b[i] - a[i];
  double length = sqrt(times(d, d, 3));
  for (int i = 0; i < 3; i++) u[i] = d[i] / fmax(length, 1e-300);
  for (Int j = 0; j < nv; j++) {
    point_column(nv, J_a, a, j, from);
    point_column(nv, J_b, b, j, to);
    for (int i = 0; i < 3; i++) e[i * nv + j] = to[i] - from[i];
  }
  memset(faster, 0, nv * sizeof(double));
  if (law[1] != 0.0 && length > 0.0)
    rate = parting(t, w, k, a, b, u, length, J_a, J_b, e, pushed, faster);
  double tension = law[0] * (length - law[2]) + law[1] * rate;
  if (t->spring_kink[k] >= 0) {
    Kink now = kinked(t, lanes, t->spring_kink[k], length - law[2], rate);
    tension = now.force, law[0] = now.slope, law[1] = now.damping;
  }
  double per_length = length > 0.0 ? tension / length : law[0];
  spring_end(t, J_a, a, d, u, e, faster, per_length, law, 1.0, pushed, C, K);
  spring_end(t, J_b, b, d, u, e, faster, per_length, law, -1.0, pushed, C, K);
}

void load_tangent(const Tables *t, Work *lanes, Tangent *w, const Lane *scale, double *C, double *K) {
  for (Int k = 0; k < t->forces; k++)
    if (!t->force_follows[k]) dead_load(t, w, k, scale[k][0], K);
  for (Int k = 0; k < t->springs; k++) spring(t, lanes, w, k, C, K);
  touch_tangents(t, lanes, w, C, K);
}
