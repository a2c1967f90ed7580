/* Script: the action of each decision, fixed before the flight. */
#include "satid_policy.h"

#include "script.h"

void satid_policy_reset(satid_policy *policy)
{
    policy->decision = 0;
}

void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS])
{
    (void)observation;
    for (int k = 0; k < SATID_ACTIONS; k++) {
        action[k] = policy->decision < SATID_DECISIONS ? SCRIPT[policy->decision][k] : 0.0;
    }
    policy->decision++;
}
