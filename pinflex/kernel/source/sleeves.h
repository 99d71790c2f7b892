/* A sleeve on a beam at one state, see sleeve_rows.c. */
#ifndef PINFLEX_SLEEVES_H
#define PINFLEX_SLEEVES_H

#include "jets.h"
#include "kernel.h"

/* Variables of the jets: s, the section's place, then

     COORDINATES  the nine z = (p, e_x, e_y) of frame b in frame a, and the eta of the stretches
     TIME         time alone, by which z and eta move
     NOTHING      none */
enum { COORDINATES, TIME, NOTHING };
enum { FIRST = 10 }; /* variable of the coordinates */

/* A sleeve on stretch `on`. eta: of all bodies, with their rates where TIME counts. reached: first
   variable of the stretches on - 1, on, on + 1; 0: their coordinates are none. */
typedef struct {
  const Tables *t;
  Int sleeve, on, low, high; /* the stretches that its ends are on */
  double z[9], dz[9], ddz[9], s, s_low, s_high;
  const double *eta, *rate, *growth;
  Int reached[3];
  Room room;
} Sleeve;

/* track.c: a section of a stretch at s, and its axes where R is wanted; held: s stays */
void section(Sleeve *w, Int stretch, double s, int held, Jet *r, Jet *R);
/* Rows (u, v, w, rz, ry, rx and the shear strains at the far end) differentiated `order` times. */
enum { TRACK_ROWS = 8 };
void track_rows(Sleeve *w, Int stretch, double s, Int order, int held, Jet *rows);

/* Sorts of rows, see sleeve_rows.c. */
enum { HOLD, RIGHT, LEFT, PIVOT, TILT, CHORD, TWIST };

/* sleeve_rows.c: where the sleeve is, then its rows as jets */
void find_sleeve(Sleeve *w);
void sleeve_rows(Sleeve *w, int by, int second, Jet *rows);
double sleeve_place(const Sleeve *w); /* of its middle on the link, m */

enum { MOST_SLEEVE_ROWS = 12 };

typedef struct { double R[9], p[3]; } Pose;

/* sleeves.c: the sleeve of a lane, where it is, and frames a and b; R (h_p, h_ex, h_ey) of a jet */
void sleeve_of_lane(const Tables *t, const Work *lanes, Int sleeve, int l, Sleeve *w, Pose *a,
                    Pose *b);
void normals(const Pose *a, const double *h, double *n);

#endif
