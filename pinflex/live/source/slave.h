/* One robot as a slave of a co-simulation, whatever the version of the standard.

   Value references: inputs, outputs, damping, payload (where one is carried), time. Inputs are those
   at the end of a step; over several steps of dt led motors go on with the velocity and acceleration
   that they were given. */
#ifndef PINFLEX_SLAVE_H
#define PINFLEX_SLAVE_H

#include "robot.h"
#include <stddef.h>

#if defined(_WIN32)
#define FMI __declspec(dllexport)
#else
#define FMI __attribute__((visibility("default")))
#endif

typedef struct Slave Slave;
typedef void (*Say)(const Slave *s, const char *text); /* what is wrong, to the master */

struct Slave {
  Robot *robot;
  double *command, *now, *out;  /* inputs; those of a step; outputs */
  double *known, *unknown;      /* changes of inputs, and of outputs by them */
  double damping, payload, begun;
  char *name;
  Say say;
  void *to;                     /* of the master: its environment, or its callbacks */
  void (*log)(void);            /* its function, of a type that `say` knows; or NULL */
};

extern const char robot_guid[]; /* in model.c, of the FMU it was written for */

/* NULL: another FMU's, or no memory. */
Slave *slave_new(const char *name, const char *guid, Say say, void *to, void (*log)(void));
void slave_free(Slave *s);
void slave_start(Slave *s);  /* with the parameters that are set */
void slave_reset(Slave *s);
/* 0 where they said what is wrong. */
int slave_get(const Slave *s, const unsigned *at, size_t n, double *x);
int slave_set(Slave *s, const unsigned *at, size_t n, const double *x);
int slave_step(Slave *s, double h);
/* dy of outputs by dx of inputs, of the last step of dt. */
int slave_slope(Slave *s, const unsigned *of, size_t n, const unsigned *by, size_t m, const double *dx,
                double *dy);
int slave_take(Slave *s, const Slave *from);
Slave *slave_copy(const Slave *s);

#endif
