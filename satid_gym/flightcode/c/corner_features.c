#include "corner_features.h"

#include <string.h>

#include "corners.h" /* SCORE(X): X(feature, weight) of each */

static const double MOMENTUM[3] = SATID_MOMENTUM; /* N m s, of all wheels along each axis */

typedef struct {
    double waited, waited_slews, waited_early, waited_walk, reversals, reversals_2s, reversals_4s, reversals_12s,
        reversals_squared, reversals_uncertainty, reversals_elapsed, reversals_early, reversals_late, reversals_walk,
        reversals_slew, reversals_slewed, reversals_frequency, reversals_speed, unknown, unknown_12s, coupled,
        coupled_12s, any, any_uncertainty, any_elapsed, any_early, any_late, any_walk, any_slew, any_nis, any_frequency,
        any_deflection, gain, gain_1, gain_3, gain_10, gain_uncertainty, gain_early, gain_1_early, gain_walk,
        gain_1_walk, underway, fullness, fullness_beyond, load, load_beyond, peak, peak_3, peak_kept, peak_kept_frequency,
        drive, drive_frequency, drive_deflection, drive_speed, pull, pull_deflection, pull_speed;
} corner_features;

static void read_mode(satid_ways *ways, satid_nearest_mode *mode)
{
    memset(mode, 0, sizeof *mode);
#if SATID_MODES > 0
    const satid_modes *modes = &ways->modes;
    double pulled[1][SATID_CORNERS][SATID_MODES], farthest = -1.0;
    satid_core_pulled(&ways->modes, ways->corner, pulled);
    for (int m = 0; m < SATID_MODES; m++) {
        const double limit = modes->limit[0][m];
        const double deflection = modes->swing[0][m][0] / limit, speed = modes->swing[0][m][1] / limit;
        if (!(hypot(deflection, speed) > farthest)) {
            continue;
        }
        farthest = hypot(deflection, speed);
        mode->deflection = deflection;
        mode->speed = speed;
        mode->frequency = log(fmax(modes->turned[0][m], SATID_SLOWEST));
        for (int i = 0; i < 3; i++) {
            mode->direction[i] = modes->direction[0][m][i];
        }
        for (int c = 0; c < SATID_CORNERS; c++) {
            mode->pull[c] = pulled[0][c][m] / limit;
        }
    }
#if SATID_PEAK_3
    satid_core_peaks_of_turns(&ways->modes, ways->corner, SATID_LAG, 3, mode->peak_3);
#endif
#if SATID_PEAK_KEPT
    satid_core_peaks(&ways->modes, ways->corner, SATID_LAG, mode->peak_kept);
#endif
#else
    (void)ways;
#endif
}

void satid_read_choice(const float *observation, const double waited[3], satid_ways *ways, satid_choice *choice)
{
    const double left = (double)observation[SATID_AT_TIME_LEFT], time = SATID_DECISIONS * SATID_DECISION_PERIOD;
    satid_read_inertia(observation, waited, &choice->inertia);
    read_mode(ways, &choice->mode);
    choice->gone = 1.0 - left;
    choice->early = exp(-choice->gone * time / SATID_TURN_EARLY);
    choice->late = fmin(left * time / SATID_TURN_LATE, 1.0);
    choice->uncertainty = choice->slew = 0.0;
    for (int i = 0; i < 3; i++) {
        choice->authority[i] = fmin((double)observation[SATID_AT_CONTROL_AUTHORITY + i], ways->most[0][i]);
        choice->uncertainty += (double)observation[SATID_AT_UNCERTAINTY + i] / 3.0;
        choice->slew += log(2.0 * SATID_DECISION_PERIOD / choice->authority[i]) / 3.0;
        choice->slewed[i] = waited[i] * choice->authority[i] / (2.0 * SATID_DECISION_PERIOD);
    }
    for (int i = 0; i < 3; i++) {
        choice->unknown[i] = (double)observation[SATID_AT_UNCERTAINTY + i] - choice->uncertainty;
        choice->total[i] = MOMENTUM[i] * (double)observation[SATID_AT_WHEEL_MOMENTUM + i];
        for (int j = 0; j < 3; j++) {
            choice->total[i] += choice->inertia.tensor[i][j] * (double)observation[SATID_AT_RATE + j] * SATID_RATE_LIMIT;
        }
    }
}

/* Nats an axis that a turn to a corner tells in some decisions. */
static double gain(const float *observation, const satid_choice *choice, const double corner[3], double decisions)
{
    double turn[3];
    for (int i = 0; i < 3; i++) {
        const double most = decisions * choice->authority[i];
        turn[i] = fmin(fmax(corner[i] - (double)observation[SATID_AT_RATE + i], -most), most);
    }
    return satid_turn_gain(&choice->inertia, turn);
}

/* Largest shares of the wheels' momentum, and of the torque, that a corner takes along or about a body axis. */
static void wheels(const satid_choice *choice, const double corner[3], corner_features *f)
{
    const double(*J)[3] = choice->inertia.tensor, *total = choice->total;
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
        f->load = fmax(f->load, fabs(drift) * SATID_DECISION_PERIOD / choice->authority[i]);
    }
    f->load = fmin(f->load, 2.0);
    f->fullness_beyond = 3.0 * fmax(f->fullness - 0.7, 0.0);
    f->load_beyond = 3.0 * fmax(f->load - 0.5, 0.0);
}

static void modes(const satid_nearest_mode *mode, int number, double peak, const double corner[3], corner_features *f)
{
    const double pull = mode->pull[number];
    double drive = 0.0;
    for (int i = 0; i < 3; i++) {
        drive += corner[i] * mode->direction[i];
    }
    f->reversals_frequency = f->reversals * mode->frequency;
    f->reversals_speed = f->reversals * fabs(mode->speed);
    f->any_frequency = f->any * mode->frequency;
    f->any_deflection = f->any * fabs(mode->deflection);
    f->peak = fmin(peak, 1.2);
    f->peak_3 = fmin(mode->peak_3[0][number], 2.0);
    f->peak_kept = fmin(mode->peak_kept[0][number], 3.0);
    f->peak_kept_frequency = f->peak_kept * mode->frequency;
    f->drive = fabs(drive);
    f->drive_frequency = fabs(drive) * mode->frequency;
    f->drive_deflection = drive * mode->deflection;
    f->drive_speed = drive * mode->speed;
    f->pull = fabs(pull);
    f->pull_deflection = pull * mode->deflection;
    f->pull_speed = pull * mode->speed;
}

double satid_score(const float *observation, const satid_policy *policy, const satid_ways *ways,
                   const satid_choice *choice, int number)
{
    const double *corner = ways->corner[0][number];
    corner_features f = {0};
    double slowest = 0.0, total = 0.0;
    for (int i = 0; i < 3; i++) {
        const double waited = policy->waited[i], flat = tanh(waited / 12.0), coupled = fabs(choice->mode.direction[i]);
        slowest = fmax(slowest, fabs(corner[i] - (double)observation[SATID_AT_RATE + i]) / choice->authority[i]);
        if (SATID_SIDE(number, i) == policy->side[i]) {
            continue;
        }
        f.waited += waited >= SATID_TURN_HOLD ? waited / SATID_TURN_HOLD : -1.0;
        f.waited_slews += choice->slewed[i] >= SATID_TURN_SLEWS ? choice->slewed[i] / SATID_TURN_SLEWS : -1.0;
        f.reversals += 1.0;
        f.reversals_2s += exp(-waited / 2.0);
        f.reversals_4s += tanh(waited / 4.0);
        f.reversals_12s += flat;
        f.reversals_slewed += tanh(choice->slewed[i]);
        f.unknown += choice->unknown[i];
        f.unknown_12s += choice->unknown[i] * flat;
        f.coupled += coupled;
        f.coupled_12s += coupled * flat;
    }
    f.any = f.reversals > 0.0 ? 1.0 : 0.0;
    f.waited_early = f.waited * choice->early;
    f.reversals_squared = f.reversals * f.reversals / 3.0;
    f.reversals_uncertainty = f.reversals * choice->uncertainty;
    f.reversals_elapsed = f.reversals * choice->gone;
    f.reversals_early = f.reversals * choice->early;
    f.reversals_late = f.reversals * choice->late;
    f.reversals_slew = f.reversals * choice->slew;
    f.any_uncertainty = f.any * choice->uncertainty;
    f.any_elapsed = f.any * choice->gone;
    f.any_early = f.any * choice->early;
    f.any_late = f.any * choice->late;
    f.any_slew = f.any * choice->slew;
    f.any_nis = f.any * (double)observation[SATID_AT_NIS];
    f.gain = gain(observation, choice, corner, (double)INFINITY);
    f.gain_1 = gain(observation, choice, corner, 1.0);
    f.gain_3 = gain(observation, choice, corner, 3.0);
    f.gain_10 = gain(observation, choice, corner, 10.0);
    f.gain_uncertainty = f.gain * choice->uncertainty;
    f.gain_early = f.gain * choice->early;
    f.gain_1_early = f.gain_1 * choice->early;
    f.underway = tanh(slowest / 4.0);
#ifdef SATID_AT_INERTIA_WALK
    const double walk = (double)observation[SATID_AT_INERTIA_WALK];
    f.waited_walk = f.waited * walk;
    f.reversals_walk = f.reversals * walk;
    f.any_walk = f.any * walk;
    f.gain_walk = f.gain * walk;
    f.gain_1_walk = f.gain_1 * walk;
#endif
    wheels(choice, corner, &f);
    modes(&choice->mode, number, ways->peak[0][number], corner, &f);
#define ADD(feature, weight) \
    total += (double)weight * f.feature; \
    SATID_COUNT(2);
    SCORE(ADD)
#undef ADD
    return total;
}
