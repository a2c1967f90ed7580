#include "turn_gain.h"

#include "satid_policy.h"

static const double INERTIA[3][3] = SATID_INERTIA; /* kg m^2, of the prior */
static const int PRODUCTS[3][2] = {{0, 1}, {0, 2}, {1, 2}};

static void axes_of(int k, int *i, int *j)
{
    *i = k < 3 ? k : PRODUCTS[k - 3][0];
    *j = k < 3 ? k : PRODUCTS[k - 3][1];
}

void satid_read_inertia(const float *observation, const double waited[3], satid_inertia *inertia)
{
    const double soonest = fmin(fmin(waited[0], waited[1]), waited[2]);
    const double noise = SATID_TURN_NOISE * (1.0 / soonest + 1.0 / SATID_TURN_HOLD);
    double std[SATID_PARAMETERS];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            inertia->tensor[i][j] = 0.0;
        }
    }
    for (int k = 0; k < SATID_PARAMETERS; k++) {
        int i, j;
        axes_of(k, &i, &j);
        std[k] = pow(10.0, (double)observation[SATID_AT_UNCERTAINTY + k] - SATID_LOG_OFFSET);
        inertia->tensor[i][j] = sqrt(INERTIA[i][i] * INERTIA[j][j]) * (double)observation[SATID_AT_INERTIA + k];
        inertia->tensor[i][j] += INERTIA[i][j];
        inertia->tensor[j][i] = inertia->tensor[i][j];
        for (int l = 0; l < SATID_PARAMETERS; l++) {
            inertia->covariance[k][l] = k == l ? std[k] * std[k] / noise : 0.0;
        }
    }
#ifdef SATID_AT_STATE_CORRELATION
    const float *correlation = observation + SATID_AT_STATE_CORRELATION;
    for (int r = 0; r < SATID_STATES; r++) {
        for (int c = r + 1; c < SATID_STATES; c++) {
            if (r < 3 && c >= 3 && c < 3 + SATID_PARAMETERS) {
                continue; /* not here but in "correlation" */
            }
            if (r >= 3 && c < 3 + SATID_PARAMETERS) {
                inertia->covariance[r - 3][c - 3] = (double)*correlation * std[r - 3] * std[c - 3] / noise;
                inertia->covariance[c - 3][r - 3] = inertia->covariance[r - 3][c - 3];
            }
            correlation++;
        }
    }
#endif
}

double satid_turn_gain(const satid_inertia *inertia, const double turn[3])
{
    double told[3][SATID_PARAMETERS] = {{0.0}}, s[3][3];
    for (int k = 0; k < SATID_PARAMETERS; k++) {
        int i, j;
        axes_of(k, &i, &j);
        told[i][k] = turn[j] * sqrt(INERTIA[j][j] / INERTIA[i][i]);
        told[j][k] = turn[i] * sqrt(INERTIA[i][i] / INERTIA[j][j]);
    }
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            s[i][j] = i == j ? 1.0 : 0.0;
            for (int k = 0; k < SATID_PARAMETERS; k++) {
                for (int l = 0; l < SATID_PARAMETERS; l++) {
                    s[i][j] += told[i][k] * inertia->covariance[k][l] * told[j][l];
                }
            }
        }
    }
    SATID_COUNT(27 * SATID_PARAMETERS * SATID_PARAMETERS);
    const double det = s[0][0] * (s[1][1] * s[2][2] - s[1][2] * s[1][2]) -
                       s[0][1] * (s[0][1] * s[2][2] - s[0][2] * s[1][2]) +
                       s[0][2] * (s[0][1] * s[1][2] - s[1][1] * s[0][2]);
    return log(fmax(det, 1.0)) / 6.0; /* rounding of what is observed may make it less than 1 */
}
