/* What a turn of the body tells of the inertia; see satid_gym.control.corners.turn_gain. */
#ifndef SATID_TURN_GAIN_H
#define SATID_TURN_GAIN_H

#include "satid_core.h"

typedef struct {
    double tensor[3][3]; /* kg m^2 */
    double covariance[SATID_PARAMETERS][SATID_PARAMETERS]; /* of theta over its scale, and over that of what is measured */
} satid_inertia;

/* The inertia as observed, where axes reversed so many seconds ago. */
void satid_read_inertia(const float *observation, const double waited[3], satid_inertia *inertia);

/* Nats an axis that a change of the rate, over the limit, tells. */
double satid_turn_gain(const satid_inertia *inertia, const double turn[3]);

#endif
