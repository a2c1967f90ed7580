/* Multilayer perceptron from observation to command; layers and what becomes of the command are in network.h. */
#include "satid_policy.h"

#include <string.h>

#include "command.h"
#include "network.h"

void satid_policy_reset(satid_policy *policy)
{
    memset(policy, 0, sizeof *policy);
}

static void layer(const float *weight, const float *bias, int inputs, int outputs, const double *x, double *y)
{
    for (int i = 0; i < outputs; i++) {
        double total = 0.0;
        for (int j = 0; j < inputs; j++) {
            total += (double)weight[i * inputs + j] * x[j];
        }
        y[i] = total + (double)bias[i];
    }
}

static void decide(const float *observation, double *command)
{
    double x[WIDEST], y[WIDEST];
    const float *weight = WEIGHTS, *bias = BIASES;
    for (int j = 0; j < SATID_OBSERVATION; j++) {
        x[j] = (double)observation[j];
    }
    for (int i = 0; i < LAYERS; i++) {
        const int inputs = SIZES[i], outputs = SIZES[i + 1];
        layer(weight, bias, inputs, outputs, x, y);
        weight += inputs * outputs;
        bias += outputs;
        for (int j = 0; j < outputs; j++) {
            x[j] = i + 1 < LAYERS ? ACTIVATION(y[j]) : SQUASH(y[j]);
        }
        SATID_COUNT(2 * inputs * outputs + 2 * outputs);
    }
    memcpy(command, x, (size_t)SIZES[LAYERS] * sizeof *x);
}

void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS])
{
    if (policy->decision % REPEAT == 0) {
        decide(observation, policy->command);
    }
    policy->decision++;
    satid_command(observation, policy->command, action);
}
