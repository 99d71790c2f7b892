/* One robot in equal steps, out of tables that pinflex wrote (model.c): without Python.

   A step allocates nothing and is of a bounded number of iterations and tangents. */
#ifndef PINFLEX_ROBOT_H
#define PINFLEX_ROBOT_H

#include "alpha.h"

/* What model.c holds. */
typedef struct {
  const Tables *tables;
  const Stages *joints;
  const Alpha *settings;                       /* of its numbers alone */
  const double *predict, *low, *high;          /* (3, 4); stops of the motors, or NULL */
  const double *y, *v, *a, *s, *lam, *torque;  /* the start */
  const double *position, *scale;              /* of the motors, (motors,); shares of the loads */
  double dt;                                   /* step, s */
  Int frames;
  const Int *frame_node;                       /* (frames,), -1: the ground */
  const double *frame_place;                   /* (frames, 12) [R | p] */
  Int tips;                                    /* ends of beams */
  const Int *tip_at, *tip_n, *tip_curved;      /* (tips,) first coordinate, number; whether with G */
  const double *tip_rows;                      /* Phi (3, n), then G (3, n, n), one after the other */
  Int beams;                                   /* whose stress is told */
  const Int *beam_at, *beam_n, *beam_fibres;   /* (beams,) first coordinate, number; points of the rim */
  const double *beam_rows;                     /* E u', -E v'', -E w'' at STATIONS (3, n), one after the other */
  const double *beam_rim;                      /* y, z of fibres, one after the other */
  Int payload_node;                            /* of the tree; -1: nothing is carried */
  double payload_mass;                         /* at first, kg */
  const double *payload_place;                 /* (3,) of its centre, in the axes of the node */
  const double *payload_inertia;               /* (3, 3) about it, of a kg */
} Model;

extern const Model robot_model;

typedef struct Robot Robot;
enum { STATIONS = 9 }; /* of a beam, where its stress is looked at */
enum { ROBOT_DONE, ROBOT_STUCK, ROBOT_STOPPED };

Robot *robot_new(void);                 /* NULL without memory; all that is ever allocated */
void robot_free(Robot *r);
void robot_reset(Robot *r);             /* to the start, at time 0 */
void robot_damping(Robot *r, double k); /* k times the damping of joints and links of the model */

void robot_payload(Robot *r, double m); /* mass of what is carried, kg: its inertia goes with it */

/* Numbers that a step is given: torques of the motors; or their position, velocity and acceleration
   at its end, one after the other. */
Int robot_inputs(void);
/* One step of dt; what is not ROBOT_DONE leaves the robot where it was. */
int robot_step(Robot *r, const double *command);
double robot_time(const Robot *r);
Int robot_motor(const Robot *r);        /* that would have passed its stop */

/* Torque, position and velocity of the motors; x, y, z, rx, ry, rz of frames; u, v, w of tips; largest
   normal stress of beams. */
Int robot_outputs(void);
void robot_read(const Robot *r, double *out);

/* What outputs change by as what the last step was given does; 0: without memory or factors. The
   first call allocates. */
int robot_slope(Robot *r, const double *command, double *out);

Robot *robot_copy(const Robot *r);      /* NULL without memory */
void robot_take(Robot *r, const Robot *from);

#endif
