/* Square waves of body rate whose reversals spare the modes; see satid_gym.policies.shaped_square. */
#include "satid_policy.h"

#include <string.h>

#include "command.h"

void satid_policy_reset(satid_policy *policy)
{
    memset(policy, 0, sizeof *policy);
    for (int i = 0; i < 3; i++) {
        policy->phase[i] = 0.5 * SATID_DECISION_PERIOD / SATID_PERIOD + i / 3.0;
    }
}

void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS])
{
    double wave[1][1][3], edge[1][3], share[1] = {SATID_SHARE}, rate[1][1][3], slowest[1][3];
    satid_modes modes;
    for (int i = 0; i < 3; i++) {
        wave[0][0][i] = SATID_AMPLITUDE * (fmod(policy->phase[i], 1.0) < 0.5 ? 1.0 : -1.0);
        edge[0][i] = 1.0;
        slowest[0][i] = INFINITY;
    }
    satid_read_modes(observation, &policy->sheet, &modes);
    satid_core_shape(&modes, policy->reference, wave, edge, share, rate, slowest);
    for (int i = 0; i < 3; i++) {
        policy->reference[0][i] = rate[0][0][i];
        policy->phase[i] += 1.0 / fmax(SATID_PERIOD / SATID_DECISION_PERIOD,
                                       4.0 * SATID_AMPLITUDE * (1.0 + SATID_DWELL) / slowest[0][i]);
    }
    satid_command(observation, policy->reference[0], action);
}
