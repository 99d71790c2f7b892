/* Newton and Euler along the tree: motion outward, wrenches inward, each in the node's own axes.

   A point at r of a frame with rates w, alpha and acceleration a of its origin, that moves in it by
   v and b, is accelerated by

     a + alpha x r + w x (w x r) + 2 w x v + b

   Source: Featherstone (2008), 5.3, written in three-vectors; gravity is in a of the base. */
#include "kernel.h"
#include <string.h>

static void accelerate(const Node *n, const Lane *r, Lane *out) {
  Lane along = dot(n->w, r), square = dot(n->w, n->w);
  cross(n->alpha, r, out);
  for (int d = 0; d < 3; d++) out[d] += n->a[d] + n->w[d] * along - square * r[d];
}

static void add_relative(const Node *n, const Lane *v, const Lane *b, Lane *out) {
  Lane swept[3];
  cross(n->w, v, swept);
  for (int d = 0; d < 3; d++) out[d] += 2.0 * swept[d] + b[d];
}

/* Rotation by an angle about a fixed axis (Rodrigues). */
static void about_axis(const double *n, Lane c, Lane s, Lane *M) {
  double x = n[0], y = n[1], z = n[2];
  Lane u = 1.0 - c;
  M[0] = u * (x * x) + c, M[1] = u * (x * y) - s * z, M[2] = u * (x * z) + s * y;
  M[3] = u * (x * y) + s * z, M[4] = u * (y * y) + c, M[5] = u * (y * z) - s * x;
  M[6] = u * (x * z) - s * y, M[7] = u * (y * z) + s * x, M[8] = u * (z * z) + c;
}

/* Rotation of a quaternion, scalar last. */
static void of_quaternion(const Lane *q, Lane *M) {
  Lane x = q[0], y = q[1], z = q[2], s = q[3];
  M[0] = 1.0 - 2.0 * (y * y + z * z), M[1] = 2.0 * (x * y - s * z), M[2] = 2.0 * (x * z + s * y);
  M[3] = 2.0 * (x * y + s * z), M[4] = 1.0 - 2.0 * (x * x + z * z), M[5] = 2.0 * (y * z - s * x);
  M[6] = 2.0 * (x * z - s * y), M[7] = 2.0 * (y * z + s * x), M[8] = 1.0 - 2.0 * (x * x + y * y);
}

static const double UP[3] = {0, 0, 1};

/* E = R0 R(q), and the offset u of the origin in the joint's axes; tells whether there is one. */
static int place(const Tables *t, Int i, const Lane *Q, Node *n, Lane *u) {
  const double *R0 = t->R0 + 9 * i, *axis = t->axis + 3 * i;
  Lane M[9], c, s;
  switch (t->kind[i]) {
    case REVOLUTE:
      sine_cosine(Q[0], &s, &c);
      about_axis(axis, c, s, M);
      break;
    case CIRCLE: about_axis(axis, Q[0], Q[1], M); break;
    case BALL: of_quaternion(Q, M); break;
    case FREE: of_quaternion(Q + 3, M); break;
    case PLANAR: about_axis(UP, Q[2], Q[3], M); break;
    default:
      for (int k = 0; k < 9; k++) n->E[k] = lane(R0[k]);
      for (int d = 0; d < 3; d++) u[d] = t->kind[i] == SLIDE ? axis[d] * Q[0] : Q[d];
      return 1;
  }
  for (int d = 0; d < 3; d++)
    for (int e = 0; e < 3; e++)
      n->E[3 * d + e] = R0[3 * d] * M[e] + R0[3 * d + 1] * M[3 + e] + R0[3 * d + 2] * M[6 + e];
  if (t->kind[i] != FREE && t->kind[i] != PLANAR) return 0;
  u[0] = Q[0], u[1] = Q[1], u[2] = t->kind[i] == FREE ? Q[2] : lane(0);
  return 1;
}

/* Velocity and acceleration of the offset in the parent's axes. Those of free and planar joints
   are given in the turning axes of the body: b = E (dv/dt + w_j x v). */
static void slip(const Tables *t, Int i, const Node *n, const Lane *V, const Lane *A, Lane *v,
                 Lane *b) {
  const double *R0 = t->R0 + 9 * i, *axis = t->axis + 3 * i;
  Lane x[3], z[3];
  if (t->kind[i] == SLIDE || t->kind[i] == TRANSLATION) {
    for (int d = 0; d < 3; d++) {
      x[d] = t->kind[i] == SLIDE ? axis[d] * V[0] : V[d];
      z[d] = t->kind[i] == SLIDE ? axis[d] * A[0] : A[d];
    }
    turn_by(R0, x, v);
    turn_by(R0, z, b);
    return;
  }
  int flat = t->kind[i] == PLANAR;
  Lane spin[3] = {flat ? lane(0) : V[3], flat ? lane(0) : V[4], flat ? V[2] : V[5]};
  Lane own[3] = {V[0], V[1], flat ? lane(0) : V[2]};
  cross(spin, own, z);
  z[0] += A[0], z[1] += A[1];
  if (!flat) z[2] += A[2];
  turn(n->E, own, v);
  turn(n->E, z, b);
}

/* Rate of turn s of the joint in the node's axes and its derivative; none for joints that slide. */
static int spin(const Tables *t, Int i, const Lane *V, const Lane *A, Lane *s, Lane *ds) {
  const double *axis = t->axis + 3 * i;
  Int first = 0;
  switch (t->kind[i]) {
    case SLIDE:
    case TRANSLATION: return 0;
    case PLANAR:
      s[0] = s[1] = ds[0] = ds[1] = lane(0);
      s[2] = V[2], ds[2] = A[2];
      return 1;
    case FREE: first = 3; /* fall through */
    case BALL:
      for (int d = 0; d < 3; d++) s[d] = V[first + d], ds[d] = A[first + d];
      return 1;
    default:
      for (int d = 0; d < 3; d++) s[d] = axis[d] * V[0], ds[d] = axis[d] * A[0];
      return 1;
  }
}

/* A joint that turns about an axis k of the node before, at its origin, mixes the two others: E holds
   cosine and sine alone. Nodes of a beam are mostly such. In line, for axes that are known there. */
static inline void mix(Lane c, Lane s, int i, int j, const Lane *v, Lane *out) {
  Lane x = c * v[i] - s * v[j];
  out[j] = s * v[i] + c * v[j], out[i] = x, out[3 - i - j] = v[3 - i - j];
}

/* `reach` of such a joint, k, i, j in the order of x, y, z; its pose, where it is wanted; and inward. */
#define INLINE static inline __attribute__((always_inline))
INLINE void about(const Tables *t, Work *w, Int at, int placed, int k, int i, int j) {
  Node *n = w->node + at;
  const Node *up = node_at(w, t->parent[at]);
  const Lane *Q = w->Q + t->node_q[at];
  Lane c, s, rate = w->V[t->node_v[at]];
  if (t->kind[at] == CIRCLE) c = Q[0], s = Q[1];
  else sine_cosine(Q[0], &s, &c);
  n->E[0] = c, n->E[1] = s;
  mix(c, -s, i, j, up->a, n->a);
  mix(c, -s, i, j, up->w, n->w);
  mix(c, -s, i, j, up->alpha, n->alpha);
  if (w->moving) mix(c, -s, i, j, up->v, n->v);
  n->alpha[i] += n->w[j] * rate, n->alpha[j] -= n->w[i] * rate;
  n->alpha[k] += w->A[t->node_v[at]], n->w[k] += rate;
  for (int d = 0; placed && d < 3; d++) { /* rows of R E */
    n->p[d] = up->p[d];
    mix(c, -s, i, j, up->R + 3 * d, n->R + 3 * d);
  }
}

INLINE void hand_on(const Node *n, Node *up, int i, int j) {
  Lane F[3], N[3];
  mix(n->E[0], n->E[1], i, j, n->F, F);
  mix(n->E[0], n->E[1], i, j, n->N, N);
  for (int d = 0; d < 3; d++) up->F[d] += F[d], up->N[d] += N[d];
}

/* w' = E'w + s,  alpha' = E'alpha + ds + (E'w) x s,  a' = E' (acceleration of the origin) */
static void reach(const Tables *t, Work *w, Int i) {
  Node *n = w->node + i;
  const Node *up = node_at(w, t->parent[i]);
  const Lane *V = w->V + t->node_v[i], *A = w->A + t->node_v[i];
  Lane u[3], v[3], b[3], acceleration[3], s[3], ds[3];
  int slides = place(t, i, w->Q + t->node_q[i], n, u);
  for (int d = 0; d < 3; d++) n->r[d] = lane(t->p0[3 * i + d]);
  if (slides) {
    Lane shift[3];
    turn_by(t->R0 + 9 * i, u, shift);
    for (int d = 0; d < 3; d++) n->r[d] += shift[d];
    slip(t, i, n, V, A, v, b);
  }
  accelerate(up, n->r, acceleration);
  if (slides) add_relative(up, v, b, acceleration);
  turn_back(n->E, acceleration, n->a);
  turn_back(n->E, up->w, n->w);
  turn_back(n->E, up->alpha, n->alpha);
  if (w->moving) {
    Lane carried[3];
    cross(up->w, n->r, carried);
    for (int d = 0; d < 3; d++) carried[d] += up->v[d] + (slides ? v[d] : lane(0));
    turn_back(n->E, carried, n->v);
  }
  if (!spin(t, i, V, A, s, ds)) return;
  cross(n->w, s, v);
  for (int d = 0; d < 3; d++) n->alpha[d] += ds[d] + v[d], n->w[d] += s[d];
}

/* R' = R E,  p' = p + R r */
static void pose(const Tables *t, Work *w, Int i) {
  Node *n = w->node + i;
  const Node *up = node_at(w, t->parent[i]);
  Lane shift[3];
  turn(up->R, n->r, shift);
  for (int d = 0; d < 3; d++) {
    n->p[d] = up->p[d] + shift[d];
    for (int e = 0; e < 3; e++)
      n->R[3 * d + e] = up->R[3 * d] * n->E[e] + up->R[3 * d + 1] * n->E[3 + e]
                        + up->R[3 * d + 2] * n->E[6 + e];
  }
}

/* F = m (acceleration of the centre),  N = I alpha + w x I w + com x F */
static void inertia(const Tables *t, Work *w, Int i) {
  Node *n = w->node + i;
  if (t->mass[i] == 0.0) {
    for (int d = 0; d < 3; d++) n->F[d] = n->N[d] = lane(0);
    const double *I = t->inertia + 9 * i;
    if (I[0] + I[4] + I[8] == 0.0) return;
  }
  Lane com[3], momentum[3], swept[3];
  for (int d = 0; d < 3; d++) com[d] = lane(t->com[3 * i + d]);
  accelerate(n, com, n->F);
  for (int d = 0; d < 3; d++) n->F[d] *= t->mass[i];
  turn_by(t->inertia + 9 * i, n->w, momentum);
  turn_by(t->inertia + 9 * i, n->alpha, n->N);
  cross(n->w, momentum, swept);
  cross(com, n->F, momentum);
  for (int d = 0; d < 3; d++) n->N[d] += swept[d] + momentum[d];
}

/* Mass points at s = p + R u of their node: F += m s'',  N += s x F,  g = R' F. */
static void mass_points(const Tables *t, Work *w) {
  for (Int k = 0; k < t->points; k++) {
    Node *n = node_at(w, t->point_node[k]);
    const double *R = t->point_R + 9 * k, *p = t->point_p + 3 * k;
    Lane *V = w->V + t->point_v[k];
    Lane s[3], v[3], b[3], F[3], N[3];
    turn_by(R, w->Q + t->point_q[k], s);
    turn_by(R, V, v);
    turn_by(R, w->A + t->point_v[k], b);
    for (int d = 0; d < 3; d++) s[d] += p[d];
    accelerate(n, s, F);
    add_relative(n, v, b, F);
    for (int d = 0; d < 3; d++) F[d] *= t->point_mass[k];
    cross(s, F, N);
    for (int d = 0; d < 3; d++) n->F[d] += F[d], n->N[d] += N[d];
    turn_back_by(R, F, V);
  }
}

/* Twists by c about an axis n fixed in their node, inertia I about it alone:
   g = I (alpha.n + c''),   N += g n + I (w.n + c') (w x n) */
static void twists(const Tables *t, Work *w) {
  for (Int k = 0; k < t->twists; k++) {
    Node *n = node_at(w, t->twist_node[k]);
    const double *axis = t->twist_axis + 3 * k;
    Lane ax[3] = {lane(axis[0]), lane(axis[1]), lane(axis[2])}, swept[3];
    Lane *V = w->V + t->twist_v[k];
    Lane moment = t->twist_inertia[k] * (dot(n->alpha, ax) + w->A[t->twist_v[k]]);
    Lane momentum = t->twist_inertia[k] * (dot(n->w, ax) + V[0]);
    cross(n->w, ax, swept);
    for (int d = 0; d < 3; d++) n->N[d] += moment * axis[d] + momentum * swept[d];
    V[0] = moment;
  }
}

void outward(const Tables *t, Work *w, int placed) {
  memset(&w->base, 0, sizeof w->base);
  for (int d = 0; d < 3; d++) w->base.R[4 * d] = lane(1.0), w->base.a[d] = lane(-t->gravity[d]);
  for (Int i = 0; i < t->nodes; i++) {
    switch (t->about[i]) {
      case 0: about(t, w, i, placed, 0, 1, 2); break;
      case 1: about(t, w, i, placed, 1, 2, 0); break;
      case 2: about(t, w, i, placed, 2, 0, 1); break;
      default:
        reach(t, w, i);
        if (placed) pose(t, w, i);
    }
    inertia(t, w, i);
  }
  mass_points(t, w);
  twists(t, w);
}

/* Forces of a node on its own coordinates, in place of their rates. */
static void deliver(const Tables *t, Work *w, Int i) {
  const Node *n = w->node + i;
  const double *axis = t->axis + 3 * i;
  Lane *g = w->V + t->node_v[i];
  switch (t->kind[i]) {
    case REVOLUTE:
    case CIRCLE: g[0] = axis[0] * n->N[0] + axis[1] * n->N[1] + axis[2] * n->N[2]; break;
    case SLIDE:
      /* E = R0 here: the node's own axes are those of the joint. */
      g[0] = axis[0] * n->F[0] + axis[1] * n->F[1] + axis[2] * n->F[2];
      break;
    case TRANSLATION:
      for (int d = 0; d < 3; d++) g[d] = n->F[d];
      break;
    case BALL:
      for (int d = 0; d < 3; d++) g[d] = n->N[d];
      break;
    case FREE:
      for (int d = 0; d < 3; d++) g[d] = n->F[d], g[3 + d] = n->N[d];
      break;
    default: g[0] = n->F[0], g[1] = n->F[1], g[2] = n->N[2];
  }
}

/* (F, N) of the parent += (E F, E N + r x E F) */
void inward(const Tables *t, Work *w) {
  for (Int i = t->nodes - 1; i >= 0; i--) {
    const Node *n = w->node + i;
    deliver(t, w, i);
    if (t->parent[i] < 0) continue;
    Node *up = w->node + t->parent[i];
    switch (t->about[i]) {
      case 0: hand_on(n, up, 1, 2); continue;
      case 1: hand_on(n, up, 2, 0); continue;
      case 2: hand_on(n, up, 0, 1); continue;
    }
    Lane F[3], N[3], arm[3];
    turn(n->E, n->F, F);
    turn(n->E, n->N, N);
    cross(n->r, F, arm);
    for (int d = 0; d < 3; d++) up->F[d] += F[d], up->N[d] += N[d] + arm[d];
  }
}
