/* From corner to corner of the rate envelope by a score, through ways that modes leave open, or as far in each decision
   as modes allow; see satid_gym.control.corners.tour. */
#include "satid_policy.h"

#include <string.h>

#include "corner_features.h"

static const double SHARE[3] = SATID_SHARES; /* of the rate limit that noise leaves */

static void find_ways(const float *observation, satid_policy *policy, satid_ways *ways)
{
    for (int i = 0; i < 3; i++) {
        ways->most[0][i] = INFINITY;
        for (int c = 0; c < SATID_CORNERS; c++) {
            ways->corner[0][c][i] = ways->rate[0][c][i] = SATID_SIDE(c, i) * SHARE[i];
        }
    }
    memset(ways->peak, 0, sizeof ways->peak);
#if SATID_MODES > 0
    satid_read_modes(observation, &policy->sheet, &ways->modes);
#if SATID_SHAPED
    double held[1][3], edge[1][3], share[1] = {SATID_SHARE};
    for (int i = 0; i < 3; i++) {
        held[0][i] = (double)observation[SATID_AT_COMMAND + i];
        edge[0][i] = SHARE[i];
    }
    satid_core_bear(&ways->modes, ways->rate, share, ways->corner);
    satid_core_shape(&ways->modes, held, ways->corner, edge, share, ways->rate, ways->most);
#endif
    for (int m = 0; m < SATID_MODES; m++) {
        ways->modes.limit[0][m] *= SATID_SHARE;
    }
#if !SATID_SHAPED
    satid_core_peaks_of_turns(&ways->modes, ways->corner, SATID_LAG, 1, ways->peak);
#endif
#else
    (void)observation;
    (void)policy;
#endif
}

void satid_policy_reset(satid_policy *policy)
{
    memset(policy, 0, sizeof *policy);
    for (int i = 0; i < 3; i++) {
        policy->side[i] = 1.0;
        policy->waited[i] = SATID_TURN_HOLD * (3.0 - i) / 3.0; /* so that the axes do not begin together */
    }
}

void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS])
{
    satid_ways ways;
    satid_choice choice;
    double best = -(double)INFINITY, chosen[3] = {(double)NAN, (double)NAN, (double)NAN}; /* where no score is a number */
    find_ways(observation, policy, &ways);
    satid_read_choice(observation, policy->waited, &ways, &choice);
    for (int i = 0; i < 3; i++) {
        action[i] = (double)NAN;
    }
    for (int c = 0; c < SATID_CORNERS; c++) {
        const double peak = ways.peak[0][c];
        const double score = peak <= 1.0 ? satid_score(observation, policy, &ways, &choice, c) : -SATID_CLOSED * peak;
        if (score > best) {
            best = score;
            for (int i = 0; i < 3; i++) {
                chosen[i] = SATID_SIDE(c, i);
                action[i] = ways.rate[0][c][i];
            }
        }
    }
    for (int i = 0; i < 3; i++) {
        policy->waited[i] = (chosen[i] == policy->side[i] ? policy->waited[i] : 0.0) + SATID_DECISION_PERIOD;
        policy->side[i] = chosen[i];
    }
}
