/* The robot from its start, motors held by what held them there: a table on the standard output. */
#include "robot.h"
#include <stdio.h>
#include <stdlib.h>

int main(int count, char **given) {
  long steps = count > 1 ? strtol(given[1], NULL, 10) : 1000;
  Int nm = robot_model.joints->motors;
  Robot *robot = robot_new();
  double *command = calloc((size_t)robot_inputs() + 1, sizeof *command);
  double *out = calloc((size_t)robot_outputs() + 1, sizeof *out);
  if (!robot || !command || !out) return 1;
  for (Int k = 0; k < nm; k++)
    command[k] = robot_model.joints->prescribed ? robot_model.position[k] : robot_model.torque[k];
  int said = ROBOT_DONE;
  for (long step = 0; step <= steps && said == ROBOT_DONE; step++) {
    robot_read(robot, out);
    printf("%.17g", robot_time(robot));
    for (Int k = 0; k < robot_outputs(); k++) printf(",%.17g", out[k]);
    printf("\n");
    if (step < steps) said = robot_step(robot, command);
  }
  free(command), free(out), robot_free(robot);
  return said;
}
