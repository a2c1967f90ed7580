/* Wheel torque that brings the body rates to a command, 3 numbers in [-1, 1], in one decision; fractions of the limits. */
#ifndef SATID_RATE_LOOP_H
#define SATID_RATE_LOOP_H

void satid_rate_loop(const float *observation, const double command[3], double action[]);

#endif
