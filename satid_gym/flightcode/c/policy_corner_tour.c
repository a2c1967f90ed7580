/* From corner to corner of the rate envelope by a score, where nothing bends; see satid_gym.control.corners.choice. */
#include "satid_policy.h"

#include "command.h"
#include "corners.h" /* SCORE(X): X(feature, weight) of each */

#define AUTHORITY(i) (double)observation[SATID_AT_CONTROL_AUTHORITY + (i)]

static const double INERTIA[3][3] = SATID_INERTIA;   /* kg m^2, of the prior */
static const double MOMENTUM[3] = SATID_MOMENTUM;    /* N m s, of all wheels along each axis */
static const double SHARE[3] = SATID_SHARES;         /* of the rate limit that noise leaves */
static const int PRODUCTS[3][2] = {{0, 1}, {0, 2}, {1, 2}};

typedef struct {
    double uncertainty, unknown[3], gone, early, late, slew, slewed[3];
    double covariance[SATID_PARAMETERS][SATID_PARAMETERS]; /* of theta over its scale, and over that of what is measured */
    double tensor[3][3], total[3];
} belief;

typedef struct {
    double waited, waited_slews, waited_early, waited_walk, reversals, reversals_2s, reversals_4s, reversals_12s,
        reversals_squared, reversals_uncertainty, reversals_elapsed, reversals_early, reversals_late, reversals_walk,
        reversals_slew, reversals_slewed, unknown, unknown_12s, any, any_uncertainty, any_elapsed, any_early,
        any_late, any_walk, any_slew, any_nis, gain, gain_1, gain_3, gain_10, gain_uncertainty, gain_early,
        gain_1_early, gain_walk, gain_1_walk, underway, fullness, fullness_beyond, load, load_beyond;
} corner_features;

static void axes_of(int k, int *i, int *j)
{
    *i = k < 3 ? k : PRODUCTS[k - 3][0];
    *j = k < 3 ? k : PRODUCTS[k - 3][1];
}

static void read_inertia(const float *observation, const double *waited, belief *seen)
{
    const double soonest = fmin(fmin(waited[0], waited[1]), waited[2]);
    const double noise = SATID_TURN_NOISE * (1.0 / soonest + 1.0 / SATID_TURN_HOLD);
    double std[SATID_PARAMETERS];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            seen->tensor[i][j] = 0.0;
        }
    }
    for (int k = 0; k < SATID_PARAMETERS; k++) {
        int i, j;
        axes_of(k, &i, &j);
        std[k] = pow(10.0, (double)observation[SATID_AT_UNCERTAINTY + k] - 2.0);
        seen->tensor[i][j] = sqrt(INERTIA[i][i] * INERTIA[j][j]) * (double)observation[SATID_AT_INERTIA + k];
        seen->tensor[i][j] += INERTIA[i][j];
        seen->tensor[j][i] = seen->tensor[i][j];
        for (int l = 0; l < SATID_PARAMETERS; l++) {
            seen->covariance[k][l] = k == l ? std[k] * std[k] / noise : 0.0;
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
                seen->covariance[r - 3][c - 3] = (double)*correlation * std[r - 3] * std[c - 3] / noise;
                seen->covariance[c - 3][r - 3] = seen->covariance[r - 3][c - 3];
            }
            correlation++;
        }
    }
#endif
}

static void read(const float *observation, const double *waited, belief *seen)
{
    const double left = (double)observation[SATID_AT_TIME_LEFT], time = SATID_DECISIONS * SATID_DECISION_PERIOD;
    read_inertia(observation, waited, seen);
    seen->gone = 1.0 - left;
    seen->early = exp(-seen->gone * time / SATID_TURN_EARLY);
    seen->late = fmin(left * time / SATID_TURN_LATE, 1.0);
    seen->uncertainty = seen->slew = 0.0;
    for (int i = 0; i < 3; i++) {
        seen->uncertainty += (double)observation[SATID_AT_UNCERTAINTY + i] / 3.0;
        seen->slew += log(2.0 * SATID_DECISION_PERIOD / AUTHORITY(i)) / 3.0;
        seen->slewed[i] = waited[i] * AUTHORITY(i) / (2.0 * SATID_DECISION_PERIOD);
    }
    for (int i = 0; i < 3; i++) {
        seen->unknown[i] = (double)observation[SATID_AT_UNCERTAINTY + i] - seen->uncertainty;
        seen->total[i] = MOMENTUM[i] * (double)observation[SATID_AT_WHEEL_MOMENTUM + i];
        for (int j = 0; j < 3; j++) {
            seen->total[i] += seen->tensor[i][j] * (double)observation[SATID_AT_RATE + j] * SATID_RATE_LIMIT;
        }
    }
}

/* Nats an axis that a turn to a corner tells in some decisions. */
static double gain(const float *observation, const belief *seen, const double corner[3], double decisions)
{
    double turn[3], told[3][SATID_PARAMETERS] = {{0.0}}, s[3][3];
    for (int i = 0; i < 3; i++) {
        const double most = decisions * AUTHORITY(i);
        turn[i] = fmin(fmax(corner[i] - (double)observation[SATID_AT_RATE + i], -most), most);
    }
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
                    s[i][j] += told[i][k] * seen->covariance[k][l] * told[j][l];
                }
            }
        }
    }
    const double det = s[0][0] * (s[1][1] * s[2][2] - s[1][2] * s[1][2]) -
                       s[0][1] * (s[0][1] * s[2][2] - s[0][2] * s[1][2]) +
                       s[0][2] * (s[0][1] * s[1][2] - s[1][1] * s[0][2]);
    return log(fmax(det, 1.0)) / 6.0; /* rounding of what is observed may make it less than 1 */
}

/* Largest shares of the wheels' momentum, and of the torque, that a corner takes along or about a body axis. */
static void wheels(const float *observation, const belief *seen, const double corner[3], corner_features *f)
{
    const double(*J)[3] = seen->tensor, *total = seen->total;
    const double torque[3] = {
        total[1] * corner[2] - total[2] * corner[1],
        total[2] * corner[0] - total[0] * corner[2],
        total[0] * corner[1] - total[1] * corner[0],
    };
    double minor[3][3], determinant; /* minors with their signs */
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            minor[i][j] = J[a][c] * J[b][d] - J[a][d] * J[b][c];
        }
    }
    determinant = J[0][0] * minor[0][0] + J[0][1] * minor[0][1] + J[0][2] * minor[0][2];
    f->fullness = f->load = 0.0;
    for (int i = 0; i < 3; i++) {
        double body = 0.0, drift = 0.0;
        for (int j = 0; j < 3; j++) {
            body += J[i][j] * corner[j] * SATID_RATE_LIMIT;
            drift += minor[j][i] * torque[j] / determinant;
        }
        f->fullness = fmax(f->fullness, fabs(total[i] - body) / MOMENTUM[i]);
        f->load = fmax(f->load, fabs(drift) * SATID_DECISION_PERIOD / AUTHORITY(i));
    }
    f->load = fmin(f->load, 2.0);
    f->fullness_beyond = 3.0 * fmax(f->fullness - 0.7, 0.0);
    f->load_beyond = 3.0 * fmax(f->load - 0.5, 0.0);
}

static double score(const float *observation, const belief *seen, const satid_policy *policy, const double side[3])
{
    corner_features f = {0};
    double corner[3], slowest = 0.0, total = 0.0;
    for (int i = 0; i < 3; i++) {
        const double waited = policy->waited[i], flat = tanh(waited / 12.0);
        corner[i] = side[i] * SHARE[i];
        slowest = fmax(slowest, fabs(corner[i] - (double)observation[SATID_AT_RATE + i]) / AUTHORITY(i));
        if (side[i] == policy->side[i]) {
            continue;
        }
        f.waited += waited >= SATID_TURN_HOLD ? waited / SATID_TURN_HOLD : -1.0;
        f.waited_slews += seen->slewed[i] >= SATID_TURN_SLEWS ? seen->slewed[i] / SATID_TURN_SLEWS : -1.0;
        f.reversals += 1.0;
        f.reversals_2s += exp(-waited / 2.0);
        f.reversals_4s += tanh(waited / 4.0);
        f.reversals_12s += flat;
        f.reversals_slewed += tanh(seen->slewed[i]);
        f.unknown += seen->unknown[i];
        f.unknown_12s += seen->unknown[i] * flat;
    }
    f.any = f.reversals > 0.0 ? 1.0 : 0.0;
    f.waited_early = f.waited * seen->early;
    f.reversals_squared = f.reversals * f.reversals / 3.0;
    f.reversals_uncertainty = f.reversals * seen->uncertainty;
    f.reversals_elapsed = f.reversals * seen->gone;
    f.reversals_early = f.reversals * seen->early;
    f.reversals_late = f.reversals * seen->late;
    f.reversals_slew = f.reversals * seen->slew;
    f.any_uncertainty = f.any * seen->uncertainty;
    f.any_elapsed = f.any * seen->gone;
    f.any_early = f.any * seen->early;
    f.any_late = f.any * seen->late;
    f.any_slew = f.any * seen->slew;
    f.any_nis = f.any * (double)observation[SATID_AT_NIS];
    f.gain = gain(observation, seen, corner, (double)INFINITY);
    f.gain_1 = gain(observation, seen, corner, 1.0);
    f.gain_3 = gain(observation, seen, corner, 3.0);
    f.gain_10 = gain(observation, seen, corner, 10.0);
    f.gain_uncertainty = f.gain * seen->uncertainty;
    f.gain_early = f.gain * seen->early;
    f.gain_1_early = f.gain_1 * seen->early;
    f.underway = tanh(slowest / 4.0);
#ifdef SATID_AT_INERTIA_WALK
    const double walk = (double)observation[SATID_AT_INERTIA_WALK];
    f.waited_walk = f.waited * walk;
    f.reversals_walk = f.reversals * walk;
    f.any_walk = f.any * walk;
    f.gain_walk = f.gain * walk;
    f.gain_1_walk = f.gain_1 * walk;
#endif
    wheels(observation, seen, corner, &f);
#define ADD(feature, weight) total += (double)weight * f.feature;
    SCORE(ADD)
#undef ADD
    return total;
}

void satid_policy_reset(satid_policy *policy)
{
    policy->decision = 0;
    for (int i = 0; i < 3; i++) {
        policy->side[i] = 1.0;
        policy->waited[i] = SATID_TURN_HOLD * (3.0 - i) / 3.0; /* so that the axes do not begin together */
    }
}

void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS])
{
    belief seen;
    double best = -(double)INFINITY, chosen[3] = {(double)NAN, (double)NAN, (double)NAN}; /* where no score is a number */
    read(observation, policy->waited, &seen);
    for (int c = 0; c < 8; c++) {
        const double side[3] = {c & 4 ? 1.0 : -1.0, c & 2 ? 1.0 : -1.0, c & 1 ? 1.0 : -1.0};
        const double found = score(observation, &seen, policy, side);
        if (found > best) {
            best = found;
            for (int i = 0; i < 3; i++) {
                chosen[i] = side[i];
            }
        }
    }
    for (int i = 0; i < 3; i++) {
        policy->waited[i] = (chosen[i] == policy->side[i] ? policy->waited[i] : 0.0) + SATID_DECISION_PERIOD;
        policy->side[i] = chosen[i];
    }
    policy->decision++;
    satid_command(observation, chosen, action);
}
