/* Forces at frames, and springs with dampers between two frames.

   A dead load stays as it is in the world, a follower turns with its frame; both come times a scale
   in time. A spring from p_a to p_b along u pulls by k (|d| - l) + c u . (v_b - v_a). Their energy is

     - F . p  of dead loads    k (|d| - l)^2 / 2  of springs

   A spring whose law has pieces pulls by that (kinks.c). */
#include "kernel.h"

static void apply_forces(const Tables *t, Work *w, const Lane *scale) {
  for (Int k = 0; k < t->forces; k++) {
    Node *n = node_at(w, t->force_node[k]);
    const double *place = t->force_place + 3 * k, *load = t->force_load + 6 * k;
    Lane p[3], F[3], M[3], arm[3], world[3];
    for (int d = 0; d < 3; d++) p[d] = lane(place[d]);
    for (int part = 0; part < 2; part++) {
      Lane *own = part ? M : F;
      for (int d = 0; d < 3; d++) world[d] = scale[k] * load[3 * part + d];
      if (t->force_follows[k])
        for (int d = 0; d < 3; d++) own[d] = world[d];
      else
        turn_back(n->R, world, own);
    }
    cross(p, F, arm);
    for (int d = 0; d < 3; d++) n->F[d] -= F[d], n->N[d] -= M[d] + arm[d];
  }
}

/* Place and, with dampers, velocity in the world of a point fixed in a node. */
static void point_of(const Tables *t, const Node *n, const double *local, Lane *p, Lane *v) {
  Lane own[3], at[3] = {lane(local[0]), lane(local[1]), lane(local[2])};
  turn(n->R, at, p);
  for (int d = 0; d < 3; d++) p[d] += n->p[d];
  if (!t->dampers) return;
  cross(n->w, at, own);
  for (int d = 0; d < 3; d++) own[d] += n->v[d];
  turn(n->R, own, v);
}

/* Length of a spring, and its rate where it has a damper; d: from end to end. */
static Lane stretch(const Tables *t, Work *w, Int k, Lane *d, Lane *rate) {
  Lane a[3], b[3], v_a[3], v_b[3], length;
  point_of(t, node_at(w, t->spring_a[k]), t->spring_place_a + 3 * k, a, v_a);
  point_of(t, node_at(w, t->spring_b[k]), t->spring_place_b + 3 * k, b, v_b);
  for (int i = 0; i < 3; i++) d[i] = b[i] - a[i];
  length = dot(d, d);
  for (int l = 0; l < LANES; l++) length[l] = fmax(sqrt(length[l]), 1e-300);
  if (t->spring_law[3 * k + 1] == 0.0) {
    *rate = lane(0);
    return length;
  }
  for (int i = 0; i < 3; i++) v_b[i] -= v_a[i];
  *rate = dot(d, v_b) / length;
  return length;
}

static void pull(Node *n, const double *local, const Lane *force, double sign) {
  Lane own[3], arm[3], at[3] = {lane(local[0]), lane(local[1]), lane(local[2])};
  turn_back(n->R, force, own);
  cross(at, own, arm);
  for (int d = 0; d < 3; d++) n->F[d] += sign * own[d], n->N[d] += sign * arm[d];
}

void spring_lengths(const Tables *t, Work *w, Int k, Lane *length) {
  Lane d[3], rate;
  *length = stretch(t, w, k, d, &rate);
}

static void apply_springs(const Tables *t, Work *w) {
  for (Int k = 0; k < t->springs; k++) {
    Node *A = node_at(w, t->spring_a[k]), *B = node_at(w, t->spring_b[k]);
    const double *law = t->spring_law + 3 * k;
    Lane d[3], rate, length = stretch(t, w, k, d, &rate);
    Lane tension = law[0] * (length - law[2]) + law[1] * rate;
    for (int l = 0; t->spring_kink[k] >= 0 && l < LANES; l++)
      tension[l] = kinked(t, w, t->spring_kink[k], length[l] - law[2], rate[l]).force;
    for (int i = 0; i < 3; i++) d[i] *= tension / length;
    pull(A, t->spring_place_a + 3 * k, d, -1.0);
    pull(B, t->spring_place_b + 3 * k, d, 1.0);
  }
}

Lane damper_power(const Tables *t, Work *w) {
  Lane d[3], rate, power = lane(0);
  for (Int k = 0; k < t->springs; k++) {
    const double *law = t->spring_law + 3 * k;
    Lane length = stretch(t, w, k, d, &rate), loss = law[1] * rate * rate;
    for (int l = 0; t->spring_kink[k] >= 0 && l < LANES; l++)
      loss[l] = kinked(t, w, t->spring_kink[k], length[l] - law[2], rate[l]).loss;
    power += loss;
  }
  return t->touches ? power + touch_power(t, w, 0) : power;
}

Lane load_energy(const Tables *t, Work *w, const Lane *scale) {
  Lane d[3], rate, energy = lane(0), p[3], v[3];
  for (Int k = 0; k < t->forces; k++) {
    if (t->force_works[k]) continue;
    point_of(t, node_at(w, t->force_node[k]), t->force_place + 3 * k, p, v);
    for (int i = 0; i < 3; i++) energy -= scale[k] * t->force_load[6 * k + i] * p[i];
  }
  for (Int k = 0; k < t->springs; k++) {
    Lane longer = stretch(t, w, k, d, &rate) - t->spring_law[3 * k + 2];
    Lane held = 0.5 * t->spring_law[3 * k] * longer * longer;
    for (int l = 0; t->spring_kink[k] >= 0 && l < LANES; l++)
      held[l] = kinked(t, w, t->spring_kink[k], longer[l], 0.0).energy;
    energy += held;
  }
  return t->touches ? energy + touch_power(t, w, 1) : energy;
}

void apply_loads(const Tables *t, Work *w, const Lane *scale) {
  apply_forces(t, w, scale);
  apply_springs(t, w);
  apply_touches(t, w);
}
