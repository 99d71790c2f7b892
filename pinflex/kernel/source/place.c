/* Poses and velocities of the stages from their accelerations:

     v_i = v_0 + h A_ij a_j,   move_i = h c_i v_0 + h^2 (A A)_ij a_j + h A_ij turn_j,
     y_i = y_0 (+) move_i,     turn = u - v,  u the rate of the exponential coordinates `move`

   For a ball, u = v + 1/2 m x v + k m x (m x v) with k = (1 - (x/2) cot(x/2)) / x^2, x = |m|. */
#include "march.h"

/* Rate of turn in exponential coordinates less that of the body. */
static void ball_turn(const double *m, const double *v, double *out) {
  double p[3] = {m[1] * v[2] - m[2] * v[1], m[2] * v[0] - m[0] * v[2], m[0] * v[1] - m[1] * v[0]};
  double q[3] = {m[1] * p[2] - m[2] * p[1], m[2] * p[0] - m[0] * p[2], m[0] * p[1] - m[1] * p[0]};
  double square = m[0] * m[0] + m[1] * m[1] + m[2] * m[2], half = 0.5 * sqrt(square);
  /* Below, the series 1/12 + x^2/720 + x^4/30240 is exact to round-off. */
  double k = square < 1e-3 ? 1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0)
                           : (1.0 - half / tan(half)) / square;
  for (int d = 0; d < 3; d++) out[d] = 0.5 * p[d] + k * q[d];
}

/* q times the quaternion of a rotation vector, scalar last, kept on the sphere. */
void ball_move(const double *q, const double *m, double *out) {
  double half = 0.5 * sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
  double k = half > 1e-8 ? 0.5 * sin(half) / half : 0.5, w = cos(half);
  double x = k * m[0], y = k * m[1], z = k * m[2];
  double p[4] = {q[3] * x + q[0] * w + q[1] * z - q[2] * y,
                 q[3] * y - q[0] * z + q[1] * w + q[2] * x,
                 q[3] * z + q[0] * y - q[1] * x + q[2] * w,
                 q[3] * w - q[0] * x - q[1] * y - q[2] * z};
  double grown = 0.5 * (3.0 - p[0] * p[0] - p[1] * p[1] - p[2] * p[2] - p[3] * p[3]);
  for (int d = 0; d < 4; d++) out[d] = grown * p[d];
}

/* The shorter rotation vector that takes one quaternion to another. */
void ball_way(const double *q, const double *p, double *out) {
  double w = q[3] * p[3] + q[0] * p[0] + q[1] * p[1] + q[2] * p[2];
  double v[3] = {q[3] * p[0] - p[3] * q[0] - (q[1] * p[2] - q[2] * p[1]),
                 q[3] * p[1] - p[3] * q[1] - (q[2] * p[0] - q[0] * p[2]),
                 q[3] * p[2] - p[3] * q[2] - (q[0] * p[1] - q[1] * p[0])};
  double sign = w < 0.0 ? -1.0 : 1.0, sine = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  double k = sine < 1e-150 ? 2.0 : 2.0 * atan2(sine, sign * w) / sine;
  for (int d = 0; d < 3; d++) out[d] = sign * k * v[d];
}

void circle_move(const double *q, double angle, double *out) {
  double grown = 0.5 * (3.0 - q[0] * q[0] - q[1] * q[1]), c = cos(angle), s = sin(angle);
  double x = grown * q[0], y = grown * q[1];
  out[0] = x * c - y * s, out[1] = y * c + x * s;
}

/* The angle from one (cos, sin) to another. */
double circle_way(const double *a, const double *b) {
  return atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
}

void retract(const Tables *t, const Stages *st, const double *y0, const double *move, double *y) {
  for (Int k = 0; k < st->plain; k++)
    y[st->plain_q[k]] = y0[st->plain_q[k]] + move[st->plain_v[k]];
  for (Int k = 0; k < st->circles; k++)
    circle_move(y0 + st->circle_q[k], move[st->circle_v[k]], y + st->circle_q[k]);
  for (Int k = 0; k < st->balls; k++)
    ball_move(y0 + st->ball_q[k], move + st->ball_v[k], y + st->ball_q[k]);
  for (Int k = 0; k < st->bodies; k++)
    body_move(st->body_flat[k], y0 + st->body_q[k], move + st->body_v[k], y + st->body_q[k]);
  for (Int i = 0; i < t->nv - t->nv_rigid; i++)
    y[t->nq_rigid + i] = y0[t->nq_rigid + i] + move[t->nv_rigid + i];
}

void displacement(const Tables *t, const Stages *st, const double *y0, const double *y,
                  double *move) {
  for (Int k = 0; k < st->plain; k++)
    move[st->plain_v[k]] = y[st->plain_q[k]] - y0[st->plain_q[k]];
  for (Int k = 0; k < st->circles; k++)
    move[st->circle_v[k]] = circle_way(y0 + st->circle_q[k], y + st->circle_q[k]);
  for (Int k = 0; k < st->balls; k++)
    ball_way(y0 + st->ball_q[k], y + st->ball_q[k], move + st->ball_v[k]);
  for (Int k = 0; k < st->bodies; k++)
    body_way(st->body_flat[k], y0 + st->body_q[k], y + st->body_q[k], move + st->body_v[k]);
  for (Int i = 0; i < t->nv - t->nv_rigid; i++)
    move[t->nv_rigid + i] = y[t->nq_rigid + i] - y0[t->nq_rigid + i];
}

void write_motors(const Stages *st, const double *position, double *y) {
  for (Int k = 0; k < led(st); k++) {
    double *q = y + st->motor_q[k];
    q[0] = position[k];
    if (st->motor_paired[k]) q[0] = cos(position[k]), q[1] = sin(position[k]);
  }
}

/* out += k W_ij x_j of stages i, over the first n of nv columns */
static void add_weighted(const Stages *st, Int nv, Int n, double k, const double *W,
                         const double *x, double *out) {
  for (Int i = 0; i < st->s; i++)
    blend(st->s, n, nv, k, W + i * st->s, x, out + i * nv);
}

EXPORT void pinflex_place(const Tables *t, const Stages *st) {
  Int nv = t->nv, rigid = t->nv_rigid;
  double h = st->h;
  for (Int i = 0; i < st->s; i++)
    for (Int d = 0; d < nv; d++) {
      st->v[i * nv + d] = st->v0[d];
      st->move[i * nv + d] = h * st->c[i] * st->v0[d];
    }
  add_weighted(st, nv, nv, h, st->A, st->a, st->v);
  add_weighted(st, nv, nv, h * h, st->A2, st->a, st->move);
  for (Int i = 0; i < st->s; i++)
    for (Int k = 0; k < led(st); k++)
      st->v[i * nv + st->motor_v[k]] = st->velocity[i * st->motors + k];
  if (st->balls + st->bodies) {
    double *seen = st->change; /* free until the correction */
    for (Int i = 0; i < st->s * nv; i++) seen[i] = st->move[i];
    add_weighted(st, nv, rigid, h, st->A, st->turn, seen);
    for (Int i = 0; i < st->s; i++) {
      for (Int k = 0; k < st->balls; k++) {
        Int at = i * nv + st->ball_v[k];
        ball_turn(seen + at, st->v + at, st->turn + at);
      }
      for (Int k = 0; k < st->bodies; k++) {
        Int at = i * nv + st->body_v[k];
        body_turn(st->body_flat[k], seen + at, st->v + at, st->turn + at);
      }
    }
    add_weighted(st, nv, rigid, h, st->A, st->turn, st->move);
    for (Int i = 0; i < st->s * nv; i++) seen[i] = 0.0;
  }
  for (Int i = 0; i < st->s; i++) {
    retract(t, st, st->y0, st->move + i * nv, st->y + i * t->nq);
    write_motors(st, st->position + i * st->motors, st->y + i * t->nq);
  }
}
