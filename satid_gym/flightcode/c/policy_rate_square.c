/* Square waves of body rate, a third of a period apart; see satid_gym.policies.rate_square. */
#include "satid_policy.h"

#include "command.h"

void satid_policy_reset(satid_policy *policy)
{
    policy->decision = 0;
}

void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS])
{
    double command[3];
    for (int i = 0; i < 3; i++) {
        const double phase = (policy->decision + 0.5) * SATID_DECISION_PERIOD / SATID_PERIOD + i / 3.0;
        command[i] = fmod(phase, 1.0) < 0.5 ? 1.0 : -1.0;
    }
    policy->decision++;
    satid_command(observation, command, action);
}
