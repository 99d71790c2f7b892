/* What is prescribed in time: on each piece the polynomial through values x_k at nodes z_k,

     x(t) = (sum_k w_k x_k / (z - z_k)) / (sum_k w_k / (z - z_k)),   z = (t - middle) / half

   Source: Berrut and Trefethen (2004), eq. 4.2: exact to a few units of round-off. */
#include "march.h"

static Int piece_of(const Inputs *in, double time) {
  Int low = 0, high = in->pieces - 1;
  while (low < high) {
    Int middle = (low + high) / 2;
    if (time > in->end[middle])
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

static void on_piece(const Inputs *in, Int piece, double time, double *out) {
  Int n = in->columns, nodes = in->nodes;
  const double *x = in->value + piece * nodes * n;
  double z = (time - in->middle[piece]) / in->half[piece], sum = 0.0, w[MOST_NODES];
  for (Int k = 0; k < nodes; k++) w[k] = in->weight[k] / (z - in->node[k]);
  for (Int k = 0; k < nodes; k++) sum += w[k];
  for (Int k = 0; !isfinite(sum) && k < nodes; k++)
    if (z == in->node[k]) {
      copy(out, x + k * n, n);
      return;
    }
  blends(1, nodes, n, w, x, out);
  for (Int i = 0; i < n; i++) out[i] /= sum;
}

void prescribed(const Inputs *in, double time, double *out) {
  Int n = in->columns;
  for (Int k = 0; k < in->corners; k++)
    if (fabs(time - in->corner[k]) <= in->gap) {
      copy(out, in->corner_value + k * n, n);
      return;
    }
  on_piece(in, piece_of(in, time), time, out);
}

void prescribed_before(const Inputs *in, double time, double *out) {
  Int piece = piece_of(in, time);
  if (piece > 0 && time < in->middle[piece] - in->half[piece]) piece--; /* just before a corner */
  on_piece(in, piece, time, out);
}
