/* What is known when a corner is chosen; see satid_gym.control.corners.choice and features. */
#ifndef SATID_CORNER_FEATURES_H
#define SATID_CORNER_FEATURES_H

#include "satid_policy.h"
#include "turn_gain.h"

#define SATID_CORNERS 8
#define SATID_SIDE(corner, axis) ((corner) & (4 >> (axis)) ? 1.0 : -1.0)

/* Ways to the corners: the rates at these, and of the next decision, over the limit. */
typedef struct {
    double corner[1][SATID_CORNERS][3], rate[1][SATID_CORNERS][3];
    double peak[1][SATID_CORNERS]; /* of the modes, over their limit; above 1 a way is closed */
    double most[1][3]; /* change of the rate in a decision that the modes allow */
#if SATID_MODES > 0
    satid_modes modes;
#endif
} satid_ways;

/* The mode that is nearest to its limit, what is over this, ln(w T), and what is forecast of all: the peak at a corner
   that is left for the best after three decisions, and at one that is kept; zeros where there is none. */
typedef struct {
    double direction[3], deflection, speed, frequency, pull[SATID_CORNERS];
    double peak_3[1][SATID_CORNERS], peak_kept[1][SATID_CORNERS];
} satid_nearest_mode;

typedef struct {
    satid_inertia inertia;
    satid_nearest_mode mode;
    double uncertainty, unknown[3], gone, early, late, slew, slewed[3], total[3] /* N m s */, authority[3];
} satid_choice;

void satid_read_choice(const float *observation, const double waited[3], satid_ways *ways, satid_choice *choice);

double satid_score(const float *observation, const satid_policy *policy, const satid_ways *ways,
                   const satid_choice *choice, int number);

#endif
