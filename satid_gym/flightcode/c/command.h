/* What becomes of a policy's command: see satid_gym.control.rate_loop. */
#ifndef SATID_COMMAND_H
#define SATID_COMMAND_H

#include "satid_policy.h"

#if SATID_COMMAND_IS_RATE && !SATID_RATE_CONTROL
#include "rate_loop.h"
#endif

static void satid_command(const float *observation, const double *command, double action[SATID_ACTIONS])
{
#if SATID_COMMAND_IS_RATE && !SATID_RATE_CONTROL
    satid_rate_loop(observation, command, action);
#else
#if SATID_COMMAND_IS_RATE
    static const double SHARE[3] = SATID_SHARES; /* of the rate limit that noise leaves */
#endif
    (void)observation;
    for (int k = 0; k < SATID_ACTIONS; k++) {
        action[k] = command[k] < -1.0 ? -1.0 : command[k] > 1.0 ? 1.0 : command[k]; /* NaN stays, and is seen */
#if SATID_COMMAND_IS_RATE
        action[k] *= SHARE[k];
#endif
    }
#endif
}

#endif
