/* Moves of free bodies: m = (rho, theta) in the body's axes, from its pose (p, R) to

     p + R V rho,  R exp(theta),   V = I + a [theta] + b [theta]^2,   V^-1 = I - [theta]/2 + k [theta]^2
     a = (1 - cos x) / x^2,  b = (x - sin x) / x^3,  k = (1 - (x/2) cot(x/2)) / x^2,  x = |theta|

   and their rates from the body's velocities v, with c = (x/2) cot(x/2) and s = ((x/2) / sin(x/2))^2:

     u = v + 1/2 [m, v] + A [m, [m, v]] + B [m, [m, [m, [m, v]]]]
     A = (2 (1 - c) + (c - s) / 2) / x^2,   B = ((1 - c) + (c - s) / 2) / x^4

   Planar joints are these in x, y and the turn about z. Source: Bullo and Murray (1995). */
#include "march.h"
#include "moments.h"

static const double SMALL = 1e-2; /* x^2 below which series end under round-off */

/* V theta-wise: out = rho + a theta x rho + b theta x (theta x rho) */
static void carried(const double *theta, const double *rho, double a, double b, double *out) {
  double first[3], second[3];
  crossed(theta, rho, first);
  crossed(theta, first, second);
  for (int d = 0; d < 3; d++) out[d] = rho[d] + a * first[d] + b * second[d];
}

/* The six rates or moves of a joint that has three of them, and its pose as one in space. */
static void widen(int flat, const double *x, double *six) {
  for (int d = 0; d < 6; d++) six[d] = flat ? 0.0 : x[d];
  if (flat) six[0] = x[0], six[1] = x[1], six[5] = x[2];
}

static void narrow(int flat, const double *six, double *x) {
  if (flat) x[0] = six[0], x[1] = six[1], x[2] = six[5];
  else for (int d = 0; d < 6; d++) x[d] = six[d];
}

/* R of the joint, row by row. */
static void attitude(int flat, const double *q, double *R) {
  if (flat) {
    double turned[9] = {q[2], -q[3], 0, q[3], q[2], 0, 0, 0, 1};
    for (int d = 0; d < 9; d++) R[d] = turned[d];
    return;
  }
  double x = q[3], y = q[4], z = q[5], w = q[6];
  double turned[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
  for (int d = 0; d < 9; d++) R[d] = turned[d];
}

void body_move(int flat, const double *q, const double *move, double *out) {
  double m[6], R[9], shift[3], world[3];
  widen(flat, move, m);
  double square = times(m + 3, m + 3, 3), x = sqrt(square), half = sin(0.5 * x);
  double a = square < SMALL ? 0.5 - square * (1.0 / 24 - square * (1.0 / 720 - square / 40320))
                            : 2.0 * half * half / square;
  double b = square < SMALL
                 ? 1.0 / 6 - square * (1.0 / 120 - square * (1.0 / 5040 - square / 362880))
                 : (x - sin(x)) / (square * x);
  carried(m + 3, m, a, b, shift);
  attitude(flat, q, R);
  rotated(R, shift, world);
  for (int d = 0; d < 3 - flat; d++) out[d] = q[d] + world[d];
  if (flat) circle_move(q + 2, m[5], out + 2);
  else ball_move(q + 3, m + 3, out + 3);
}

void body_way(int flat, const double *q, const double *to, double *move) {
  double R[9], away[3] = {0}, shift[3], m[6] = {0};
  attitude(flat, q, R);
  for (int d = 0; d < 3 - flat; d++) away[d] = to[d] - q[d];
  for (int d = 0; d < 3; d++) shift[d] = R[d] * away[0] + R[3 + d] * away[1] + R[6 + d] * away[2];
  if (flat) m[5] = circle_way(q + 2, to + 2);
  else ball_way(q + 3, to + 3, m + 3);
  double square = times(m + 3, m + 3, 3), half = 0.5 * sqrt(square);
  double k = square < SMALL ? 1.0 / 12 + square * (1.0 / 720 + square * (1.0 / 30240 + square / 1209600))
                            : (1.0 - half / tan(half)) / square;
  carried(m + 3, shift, -0.5, k, m);
  narrow(flat, m, move);
}

/* u - v */
void body_turn(int flat, const double *move, const double *v, double *out) {
  double m[6], six[6], first[6], second[6], third[6], fourth[6];
  widen(flat, move, m);
  widen(flat, v, six);
  double square = times(m + 3, m + 3, 3), half = 0.5 * sqrt(square), A, B;
  if (square < SMALL) {
    A = 1.0 / 12 - square * square * (1.0 / 30240 + square / 604800);
    B = -1.0 / 720 - square * (1.0 / 15120 + square / 403200);
  } else {
    double c = half / tan(half), s = half / sin(half), bent = 0.5 * (c - s * s);
    A = (2.0 * (1.0 - c) + bent) / square, B = (1.0 - c + bent) / (square * square);
  }
  motion_cross(m, six, first);
  motion_cross(m, first, second);
  motion_cross(m, second, third);
  motion_cross(m, third, fourth);
  for (int d = 0; d < 6; d++) six[d] = 0.5 * first[d] + A * second[d] + B * fourth[d];
  narrow(flat, six, out);
}
