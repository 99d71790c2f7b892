/* Contacts of two bodies: a ball in its socket, a pin in its hole, a corner or a collar at a wall.

   In the axes of A, with d from the middle of the hole to that of the pin and s a unit axis of A, let

     e = d  (BALL),   d - s (s . d)  (PIN),   s (s . d)  (WALL),      u = e / |e|  (WALL: s)

   so that x = u . e - gap and x' = u . d' are what a law of pieces (kinks.c) presses by, with N > 0
   beyond the rim. B is pressed by -N u; what touches is `radius` further out, where B slides by

     q = d' + radius W x u - u x',      and is rubbed by    - mu N tanh(|q| / v_0) q / |q|,

   mu with E exp(-(|q| / v_s)^2) more, which is stiction.

   d' and W are the motion of B as A sees it. On A the same acts, opposite, at the same places. */
#include "tangent.h"

enum { BALL_IN, PIN_IN, AT_WALL };
enum { GAP, FRICTION, SMOOTH, RADIUS, EXCESS, STRIBECK, WIDTH };

typedef struct { double loss; Kink law; } Touch;

static int rubs(const double *law) { return law[FRICTION] + law[EXCESS] != 0.0; }

/* How far it is beyond its rim at d, and u. */
static double beyond(const Tables *t, Int k, const double *d, double *u) {
  const double *s = t->touch_axis + 3 * k;
  double along = times(s, d, 3), length;
  for (int i = 0; i < 3; i++)
    u[i] = t->touch_shape[k] == BALL_IN ? d[i] : t->touch_shape[k] == PIN_IN ? d[i] - along * s[i] : s[i];
  if (t->touch_shape[k] == AT_WALL) return along - t->touch_law[WIDTH * k + GAP];
  length = sqrt(times(u, u, 3));
  for (int i = 0; i < 3; i++) u[i] /= fmax(length, 1e-300);
  return length - t->touch_law[WIDTH * k + GAP];
}

/* Force f on B at its middle and moment m about that, in axes of A; motion: d, d' and W. */
static Touch touch(const Tables *t, const Work *w, Int k, const double *motion, double *f, double *m) {
  const double *law = t->touch_law + WIDTH * k, *way = motion + 3, *turn = motion + 6;
  double u[3], q[3], x = beyond(t, k, motion, u), rate, fast;
  rate = times(u, way, 3);
  Touch now = {.law = kinked(t, w, t->touch_kink[k], x, rate)};
  now.loss = now.law.loss;
  for (int i = 0; i < 3; i++) f[i] = -now.law.force * u[i], m[i] = 0.0;
  if (!rubs(law) || now.law.force <= 0.0) return now;
  crossed(turn, u, q);
  for (int i = 0; i < 3; i++) q[i] = way[i] + law[RADIUS] * q[i] - rate * u[i];
  fast = sqrt(times(q, q, 3));
  double slow = fast / law[STRIBECK], mu = law[FRICTION] + law[EXCESS] * exp(-slow * slow);
  double rub = mu * now.law.force, held[3];
  /* tanh(x) / x is 1 at rest */
  double per_speed = fast > 1e-9 * law[SMOOTH] ? rub * tanh(fast / law[SMOOTH]) / fast : rub / law[SMOOTH];
  for (int i = 0; i < 3; i++) held[i] = -per_speed * q[i], f[i] += held[i];
  crossed(u, held, m);
  for (int i = 0; i < 3; i++) m[i] *= law[RADIUS];
  now.loss += per_speed * fast * fast;
  return now;
}

/* Motion of B as A sees it, in its axes, of all lanes: d, d' and W. */
static void motion_of(const Tables *t, Work *w, Int k, Lane *out) {
  const Node *A = node_at(w, t->touch_a[k]), *B = node_at(w, t->touch_b[k]);
  const double *a = t->touch_place_a + 3 * k, *b = t->touch_place_b + 3 * k;
  Lane way[3], own[3], at[3], turn_b[3], arm[3] = {lane(b[0]), lane(b[1]), lane(b[2])};
  turn(B->R, arm, way);
  for (int i = 0; i < 3; i++) way[i] += B->p[i] - A->p[i];
  turn_back(A->R, way, at);
  cross(B->w, arm, own);
  for (int i = 0; i < 3; i++) own[i] += B->v[i];
  turn(B->R, own, way);
  turn_back(A->R, way, out + 3);
  cross(A->w, at, own);
  turn(B->R, B->w, way);
  turn_back(A->R, way, turn_b);
  for (int i = 0; i < 3; i++) {
    out[i] = at[i] - a[i];
    out[3 + i] -= A->v[i] + own[i];
    out[6 + i] = turn_b[i] - A->w[i];
  }
}

static Touch in_lane(const Tables *t, Work *w, Int k, const Lane *motion, int l, double *f, double *m) {
  double one[9];
  for (int i = 0; i < 9; i++) one[i] = motion[i][l];
  return touch(t, w, k, one, f, m);
}

void apply_touches(const Tables *t, Work *w) {
  for (Int k = 0; k < t->touches; k++) {
    if (idle(t, w, t->touch_kink[k])) continue;
    Node *A = node_at(w, t->touch_a[k]), *B = node_at(w, t->touch_b[k]);
    const double *a = t->touch_place_a + 3 * k, *b = t->touch_place_b + 3 * k;
    Lane motion[9], f[3], m[3], world[3], own[3], moment[3], arm[3], at[3];
    motion_of(t, w, k, motion);
    for (int l = 0; l < LANES; l++) {
      double force[3], turning[3];
      in_lane(t, w, k, motion, l, force, turning);
      for (int i = 0; i < 3; i++) f[i][l] = force[i], m[i][l] = turning[i];
    }
    for (int i = 0; i < 3; i++) at[i] = motion[i] + a[i];
    cross(at, f, arm);
    for (int i = 0; i < 3; i++) A->F[i] += f[i], A->N[i] += arm[i] + m[i];
    turn(A->R, f, world);
    turn_back(B->R, world, own);
    turn(A->R, m, world);
    turn_back(B->R, world, moment);
    for (int i = 0; i < 3; i++) at[i] = lane(b[i]);
    cross(at, own, arm);
    for (int i = 0; i < 3; i++) B->F[i] -= own[i], B->N[i] -= arm[i] + moment[i];
  }
}

/* Of all of them: energy, J, or what they take, W. */
Lane touch_power(const Tables *t, Work *w, int stored) {
  Lane sum = lane(0), motion[9];
  double f[3], m[3];
  for (Int k = 0; k < t->touches; k++) {
    if (idle(t, w, t->touch_kink[k])) continue;
    motion_of(t, w, k, motion);
    for (int l = 0; l < LANES; l++) {
      Touch now = in_lane(t, w, k, motion, l, f, m);
      sum[l] += stored ? now.law.energy : now.loss;
    }
  }
  return sum;
}

/* How far they are beyond their rims, in the first lanes: (lanes, kinks); at rest. */
void touch_places(const Tables *t, Work *w, Int lanes, double *x) {
  Lane motion[9];
  for (Int k = 0; k < t->touches; k++) {
    motion_of(t, w, k, motion);
    for (Int l = 0; l < lanes; l++) {
      double d[3] = {motion[0][l], motion[1][l], motion[2][l]}, u[3];
      x[l * t->kinks + t->touch_kink[k]] = beyond(t, k, d, u);
    }
  }
}

/* Derivatives of f and m by motion, (6, 9), by central differences: Newton's iteration needs no more.
   Turning counts where it rubs. */
static void slopes(const Tables *t, const Work *w, Int k, const double *motion, double *out) {
  const double *law = t->touch_law + WIDTH * k;
  double far = 1e-6 * fmax(law[GAP], 1e-9), fast = 1e-4 * (rubs(law) ? law[SMOOTH] : 1.0);
  double spin = rubs(law) ? fast / fmax(law[RADIUS], 1e-6) : fast;
  for (int i = 0; i < 54; i++) out[i] = 0.0;
  for (int j = 0; j < (rubs(law) ? 9 : 6); j++) {
    double x[9], above[6], below[6], h = j < 3 ? far : j < 6 ? fast : spin;
    for (int i = 0; i < 9; i++) x[i] = motion[i];
    x[j] = motion[j] + h;
    touch(t, w, k, x, above, above + 3);
    x[j] = motion[j] - h;
    touch(t, w, k, x, below, below + 3);
    for (int i = 0; i < 6; i++) out[9 * i + j] = (above[i] - below[i]) / (2.0 * h);
  }
}

static const Frozen *body(const Tangent *w, Int node) {
  return node < 0 ? &w->base : w->frozen + node;
}

/* What columns e (3, nv) of d and W, in the world, change of force and moment: S (6, 9) in axes R. */
static void respond(const double *R, const double *S, int from, const double *d, const double *W,
                    double *force, double *moment) {
  double own[6] = {0}, out[6] = {0};
  for (int i = 0; i < 3; i++)
    for (int e = 0; e < 3; e++) own[i] += R[3 * e + i] * d[e], own[3 + i] += R[3 * e + i] * W[e];
  for (int i = 0; i < 6; i++)
    for (int e = 0; e < (from ? 6 : 3); e++) out[i] += S[9 * i + from + e] * own[e];
  rotated(R, out, force);
  rotated(R, out + 3, moment);
}

/* K -= J_a' [-g; -(p x g) - e x F - h] + J_b' [g + z x F; p x (..) + h + z x M] with g and h what force
   and moment change by in axes that turn with A, z = w_a - w_b; C alike without what turns and moves. */
void touch_tangent(const Tables *t, const Work *lanes, Tangent *w, Int k, const double *motion,
                   double *C, double *K) {
  Int nv = t->nv, size = 6 * nv;
  double *J_a = w->lifted, *J_b = J_a + size, *on_a = J_b + size, *on_b = on_a + size;
  const Frozen *A = body(w, t->touch_a[k]), *B = body(w, t->touch_b[k]);
  double S[54], f[3], m[3], F[3], M[3], p[3], d[3];
  touch(t, lanes, k, motion, f, m);
  slopes(t, lanes, k, motion, S);
  rotated(A->R, f, F), rotated(A->R, m, M), rotated(A->R, motion, d);
  rotated(B->R, t->touch_place_b + 3 * k, p);
  for (int i = 0; i < 3; i++) p[i] += B->p[i];
  lift(t, w, t->touch_a[k], J_a);
  lift(t, w, t->touch_b[k], J_b);
  for (int rates = 0; rates < 2; rates++) {
    for (Int j = 0; j < nv; j++) {
      double e[3], z[3], g[3], h[3], x[3], turn_a[3], turned[3], to[3];
      for (int i = 0; i < 3; i++) {
        turn_a[i] = J_a[(3 + i) * nv + j];
        z[i] = turn_a[i] - J_b[(3 + i) * nv + j], turned[i] = -z[i];
      }
      /* both at the point of B, of which A sees the difference */
      crossed(turned, p, x);
      for (int i = 0; i < 3; i++) e[i] = J_b[i * nv + j] - J_a[i * nv + j] + x[i];
      respond(A->R, S, rates ? 3 : 0, e, turned, g, h);
      crossed(p, g, x);
      crossed(e, F, to);
      for (int i = 0; i < 3; i++)
        on_a[i * nv + j] = -g[i], on_a[(3 + i) * nv + j] = -x[i] - h[i] - (rates ? 0.0 : to[i]);
      if (!rates) {
        crossed(z, F, x);
        for (int i = 0; i < 3; i++) g[i] += x[i];
        crossed(z, M, x);
        for (int i = 0; i < 3; i++) h[i] += x[i];
      }
      crossed(p, g, x);
      for (int i = 0; i < 3; i++) on_b[i * nv + j] = g[i], on_b[(3 + i) * nv + j] = x[i] + h[i];
    }
    add_transposed(nv, J_a, on_a, -1.0, rates ? C : K);
    add_transposed(nv, J_b, on_b, -1.0, rates ? C : K);
  }
}

void touch_tangents(const Tables *t, Work *lanes, Tangent *w, double *C, double *K) {
  Lane motion[9];
  double one[9];
  for (Int k = 0; k < t->touches; k++) {
    if (idle(t, lanes, t->touch_kink[k])) continue;
    motion_of(t, lanes, k, motion);
    for (int i = 0; i < 9; i++) one[i] = motion[i][0];
    touch_tangent(t, lanes, w, k, one, C, K);
  }
}
