#include "rate_loop.h"

#include "satid_policy.h"

/* The observation in physical units, as satid_gym.control.decoded_observation reads it. */
static void decode(const float *observation, const satid_constants *own, satid_decoded *out)
{
    static const int ROW[3] = {0, 0, 1}, COLUMN[3] = {1, 2, 2};
    const float *change = observation + SATID_AT_INERTIA;
    for (int i = 0; i < 3; i++) {
        out->omega[0][i] = (double)observation[SATID_AT_RATE + i] * own->rate_limit[0][0];
        out->disturbance[0][i] = (double)observation[SATID_AT_DISTURBANCE + i] * own->disturbance_std[0][0];
        for (int j = 0; j < 3; j++) {
            out->inertia[0][i][j] = 0.0;
        }
        out->inertia[0][i][i] = own->prior[0][i][i] * (1.0 + (double)change[i]);
    }
    for (int k = 0; k < SATID_PARAMETERS - 3; k++) {
        const int i = ROW[k], j = COLUMN[k];
        const double scale = sqrt(own->prior[0][i][i] * own->prior[0][j][j]);
        out->inertia[0][i][j] = out->inertia[0][j][i] = own->prior[0][i][j] + scale * (double)change[3 + k];
    }
    for (int k = 0; k < SATID_PARAMETERS; k++) {
        out->inertia_std[0][k] = pow(10.0, (double)observation[SATID_AT_UNCERTAINTY + k] - SATID_LOG_OFFSET);
    }
    for (int k = 0; k < SATID_WHEELS; k++) {
        out->wheel_momentum[0][k] = (double)observation[SATID_AT_WHEEL_SPEED + k] * own->max_spin[0][k];
    }
    for (int i = 0; i < 3; i++) {
        double body = 0.0, stored = 0.0;
        for (int j = 0; j < 3; j++) {
            body += out->inertia[0][i][j] * out->omega[0][j];
        }
        for (int k = 0; k < SATID_WHEELS; k++) {
            stored += own->axes[0][i][k] * out->wheel_momentum[0][k];
        }
        out->momentum[0][i] = body + stored;
    }
}

void satid_rate_loop(const float *observation, const double command[3], double action[])
{
    satid_constants own = satid_first_constants;
    satid_decoded belief;
    double commands[1][3], actions[1][SATID_WHEELS];
    decode(observation, &own, &belief);
    for (int i = 0; i < 3; i++) {
        commands[0][i] = command[i];
    }
    satid_core_drive(&belief, commands, &own, SATID_MARGIN, SATID_DECISION_PERIOD, actions);
    for (int k = 0; k < SATID_WHEELS; k++) {
        action[k] = actions[0][k];
    }
}
