/* A run by collocation: what is prescribed in time, the steps of a batch, and where the run is. */
#ifndef PINFLEX_MARCH_H
#define PINFLEX_MARCH_H

#include "stages.h"

enum { MOST_NODES = 25 }; /* of a piece of what is prescribed */

/* Columns position | velocity | acceleration of the motors (of driven ones the torque that is fed
   forward) | shares of the loads: values at the nodes of pieces of time, and by themselves at
   corners, where they may jump. */
typedef struct {
  Int columns, pieces, nodes, corners;
  const double *node, *weight;         /* [nodes] of every piece, on (-1, 1) */
  const double *end, *middle, *half;   /* [pieces] s */
  const double *value;                 /* [pieces, nodes, columns] */
  const double *corner;                /* [corners] s */
  const double *corner_value;          /* [corners, columns] */
  double gap;                          /* how near a corner a time is at it, s */
} Inputs;

/* Steps, one after the other: where each starts, its stages, and what the run was to do there. */
typedef struct {
  double *t, *h, *coarseness, *rate;   /* [steps] start, s; length, s */
  double *y0;                          /* [steps, nq] */
  double *v0, *a0;                     /* [steps, nv] */
  double *lam0;                        /* [steps, closures] */
  double *torque0;                     /* [steps, motors] */
  double *move, *turn, *a;             /* [steps, s, nv] stages */
  double *lam;                         /* [steps, s, closures] */
  double *torque, *position, *velocity; /* [steps, s, motors] of the motors */
  double *power;                       /* [steps, s, 2] */
  double *next, *ceiling, *before, *refused, *scale; /* [steps] the point it goes on from, see March */
  Int *number, *stop, *follows, *tangent, *serial; /* [steps] */
} Steps;

/* Where a run is, its settings, and its counts. Step 0 is the last one before the batch. */
typedef struct {
  Int capacity, count;               /* of the steps: room, and how many there are */
  Int tangents, tangent;             /* room for tangents, and the one in use */
  Int stops, stop;                   /* ends that steps have to meet, and the next of them */
  Int follows;                       /* whether step `count` predicts the next one */
  Int stale, number, unjudged, given;
  Int most, measured, by_mass;
  Int iterations, refreshed, factored, rejected, unresolved;
  Int event, side, landing;          /* events.c: the law, the side it leaves on, attempts so far */
  Int jumped;                        /* whether a, lam and torque are those before held forces changed */
  Stages *stages;
  const Inputs *inputs;
  Steps steps;
  const double *stop_at;             /* [stops] s */
  const Int *kind;                   /* [stops] of each, see march.c */
  const double *basis;               /* [s, s] values at the nodes to coefficients of powers */
  const double *basis_0;             /* [s+1, s+1] those at 0 and the nodes */
  const double *last;                /* [s] stages to the last Legendre coefficient */
  double *tangent_at;                /* [kept, wide] M, C, K (nv, nv), J (rows, nv) and what a chain has */
  const Int *measured_at;            /* [measured] */
  double *weight;                    /* [measured, measured] of the norm */
  double *input;                     /* [s, columns] */
  Int *piece;                        /* [kinks] that each law of pieces is in */
  double *hit;                       /* [kinks] speed at which it came there */
  double *placed;                    /* [s+1, nq] poses of the start and the stages */
  double *x;                         /* [s+1, kinks] and where laws of pieces are there */
  double *start_lu;                  /* [starts, size] matrix and room */
  double *start_x;                   /* [starts_x] */
  Int *start_pivot;                  /* [starts] */
  double *y;                         /* [nq] the state the next step starts from */
  double *v, *a;                     /* [nv] */
  double *lam;                       /* [closures] */
  double *torque;                    /* [motors] */
  double t, h, ceiling, before, refused, scale; /* next length and its limit, s; see march.c */
  double factored_h, size, solved;   /* s: of the factors, of the step to come, of the stages at hand */
  double resolution, least, round_off, seen, open, slack, slow, same_step;
  double planned, speed;             /* length of a step before it was cut, s; rate of what it meets */
  double idle_from, idle_to, order, first, shortest, held, growth, patience;
  double grain;                      /* lengths of an octave that steps may have; 0: any */
} March;

/* tangent.c: what blocks of a chain ask of each other, of the last tangent, to where they are kept */
void pinflex_joined(const Tables *t, char *memory, double *to);

/* inputs.c: all columns at a time */
void prescribed(const Inputs *in, double time, double *out);
/* the same at a corner as just before it */
void prescribed_before(const Inputs *in, double time, double *out);

/* What a motor is told at an instant: acceleration, or torque to begin with. */
typedef struct { const double *position, *velocity, *feed; } Told;

static inline Told told_at(const Stages *st, Int i) {
  Int n = i * st->motors;
  return (Told){st->position + n, st->velocity + n, st->feed + n};
}

/* pull.c: torques of driven motors at a state, r less these and what is held (where there is r), what
   they add to C and K, and the power of all motors and of what is held */
void pull(const Tables *t, const Stages *st, const Told *told, const double *y, const double *v,
          double *torque, double *r);
double motor_power(const Tables *t, const Stages *st, const double *torque, const double *v);
void pull_tangent(const Tables *t, const Stages *st, double *C, double *K);

/* place.c: y = y0 (+) move, and the move from y0 to y; prescribed motors where they are told to be */
void retract(const Tables *t, const Stages *st, const double *y0, const double *move, double *y);
void displacement(const Tables *t, const Stages *st, const double *y0, const double *y,
                  double *move);
void write_motors(const Stages *st, const double *position, double *y);
void circle_move(const double *q, double angle, double *out);
double circle_way(const double *a, const double *b);
void ball_move(const double *q, const double *m, double *out);
void ball_way(const double *q, const double *p, double *out);

/* free_bodies.c: the same of free and planar (flat) joints, and u - v */
void body_move(int flat, const double *q, const double *move, double *out);
void body_way(int flat, const double *q, const double *to, double *move);
void body_turn(int flat, const double *move, const double *v, double *out);

/* newton.c */
int pinflex_factor(const Tables *t, const Stages *st);
int pinflex_factor_tangent(const Tables *t, Stages *st, const double *M);

/* attempt.c: the step of length h; 0: Newton does not get there. take_inputs: where it starts, and
   what is prescribed at its stages. factor: for a step of length h, where that is not at hand. keep:
   as step `count` + 1. */
int attempt(const Tables *t, char *memory, March *m, double h);
void take_inputs(const Tables *t, March *m, double h);
int factor(const Tables *t, March *m, double h);
void keep(const Tables *t, char *memory, March *m, double h);

/* events.c: whether a solved step of length `size` keeps to its pieces, has to be taken anew (`size`),
   ends at a border, where the law `event` leaves its piece, leaves it at once, or none of these */
enum { PASSES, AGAIN, LANDS, AT_ONCE, LOST };
int land(const Tables *t, char *memory, March *m, double size);

/* march.c: the state after the step that is kept as number `count` */
void advance(const Tables *t, March *m);

/* start.c: a, lam and torque that belong to t, y and v; 0 where they are not unique */
int begin(const Tables *t, char *memory, March *m);

static inline Int tangent_width(const Tables *t) {
  return t->nv * (3 * t->nv + t->closures) + t->joined_at[t->blocks];
}

static inline void copy(double *to, const double *from, Int n) {
  for (Int i = 0; i < n; i++) to[i] = from[i];
}

#endif
