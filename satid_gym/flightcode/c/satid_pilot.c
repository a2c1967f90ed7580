#include "satid_pilot.h"

#include <string.h>

#define SAME 1e-6          /* of the sample period, within which two intervals are the same */
#define SPEED_MAX 1.5      /* a reading beyond this many limits is a wrong unit or a fault */
#define RATE_MAX 10.0
#define LENGTH_SLACK 1e-3  /* of a quaternion */
#define USUAL_SAMPLES 10   /* by which readings may be apart, whatever the patience */
#define STEPS_MAX (SATID_DECISIONS * SATID_SAMPLES + 1) /* samples of the longest gap that is crossed */

enum { GOOD, MISSING, REFUSED };

static int judge(const double *reading, int count, const double *limit, double factor)
{
    int missing = 0, wrong = 0;
    if (reading == NULL) {
        return MISSING;
    }
    for (int k = 0; k < count; k++) {
        missing += isnan(reading[k]) ? 1 : 0;
        wrong += !(fabs(reading[k]) <= factor * limit[k]) ? 1 : 0;
    }
    return missing == count ? MISSING : wrong > 0 ? REFUSED : GOOD;
}

static int judge_gyro(const double *gyro)
{
    const double limit[3] = {SATID_RATE_LIMIT, SATID_RATE_LIMIT, SATID_RATE_LIMIT};
    return judge(gyro, 3, limit, RATE_MAX);
}

#if SATID_TRACKER
static int judge_attitude(const double *attitude)
{
    const double limit[4] = {1.0, 1.0, 1.0, 1.0};
    const int found = judge(attitude, 4, limit, 1.0 + LENGTH_SLACK);
    double square = 0.0;
    for (int k = 0; found == GOOD && k < 4; k++) {
        square += attitude[k] * attitude[k];
    }
    return found == GOOD && fabs(sqrt(square) - 1.0) > LENGTH_SLACK ? REFUSED : found;
}

void satid_see(satid_pilot *pilot, const double *attitude)
{
    pilot->seen_attitude = judge_attitude(attitude) == MISSING ? 0 : 1;
    for (int k = 0; k < 4; k++) {
        pilot->readings.tracker.reading[k] = pilot->seen_attitude ? attitude[k] : NAN;
    }
}

void satid_set_sun(satid_pilot *pilot, const double sun[3])
{
    const double length = sqrt(sun[0] * sun[0] + sun[1] * sun[1] + sun[2] * sun[2]);
    for (int i = 0; i < 3; i++) { /* no direction, as none was given */
        pilot->sun[i] = isfinite(length) && length > 0.0 ? sun[i] / length : 0.0;
        pilot->task.sun[i] = pilot->sun[i];
    }
}
#endif

static void count(satid_status *status, int found, uint32_t missing, uint32_t refused)
{
    if (found == MISSING) {
        status->missing++;
        status->flags |= missing;
    } else if (found == REFUSED) {
        status->refused++;
        status->flags |= refused;
    }
}

/* Command a fraction of the motors' limits, or of the rate limit, until the next decision. */
static void hold(satid_pilot *pilot, const double *fraction)
{
    for (int k = 0; k < SATID_ACTIONS; k++) {
        pilot->task.command[k] = fraction[k];
    }
#if SATID_RATE_CONTROL
    for (int i = 0; i < 3; i++) {
        pilot->task.tracking.reference[i] = fraction[i] * SATID_RATE_LIMIT;
    }
    memset(pilot->torque, 0, sizeof pilot->torque);
#else
    for (int k = 0; k < SATID_WHEELS; k++) {
        pilot->torque[k] = fraction[k] * pilot->task.torque_max[k];
    }
#endif
    memcpy(pilot->work.torque, pilot->torque, sizeof pilot->torque);
}

static void coast(satid_pilot *pilot, uint32_t flag)
{
    const double rest[SATID_ACTIONS] = {0.0};
    hold(pilot, rest);
    pilot->status.state = SATID_COASTING;
    pilot->status.flags |= flag;
}

/* Whether the filter broke down, after which only a new start helps. */
static bool is_lost(const satid_pilot *pilot)
{
    bool good = true;
    for (int i = 0; i < SATID_OBSERVATION; i++) {
        good = good && isfinite(pilot->observation[0][i]);
    }
    for (int i = 0; i < SATID_STATES; i++) {
        good = good && isfinite(pilot->belief.mean[i]) && isfinite(pilot->belief.covariance[i][i]);
    }
    return !good;
}

/* Decisions that should have been taken by now and were not; half a sample early counts. */
static int32_t due_at(const satid_pilot *pilot, double time)
{
    const double elapsed = (time - pilot->begun + 0.5 * SATID_SAMPLE_PERIOD) / SATID_DECISION_PERIOD;
    const int32_t due = elapsed < (double)SATID_DECISIONS ? (int32_t)elapsed : SATID_DECISIONS;
    return due + 1 - pilot->decided;
}

/* Ask the policy, once for each decision that is due, so that one that counts them keeps up. */
static void decide(satid_pilot *pilot, int32_t due)
{
    double action[SATID_ACTIONS];
    bool good = true;
    for (int32_t i = 0; i < due; i++) {
        satid_policy_act(&pilot->policy, pilot->observation[0], action);
    }
    pilot->decided += due;
    pilot->status.missed += (uint32_t)(due - 1);
    pilot->task.nis_sum = 0.0;
    pilot->task.nis_count = 0;
    for (int k = 0; k < SATID_ACTIONS; k++) {
        good = good && isfinite(action[k]);
        action[k] = (double)(float)fmin(fmax(action[k], -1.0), 1.0); /* actions are float in Python */
    }
    if (good) {
        hold(pilot, action);
        pilot->status.state = SATID_FLYING;
    } else {
        coast(pilot, SATID_NO_ACTION);
    }
}

/* Follow the rate that the policy commands, where it commands one and the wheels' speed was told. */
static void steer(satid_pilot *pilot, bool told)
{
#if SATID_RATE_CONTROL
    bool good = true;
    if (told && pilot->status.state == SATID_FLYING) {
        const double dt = pilot->time - pilot->steered;
        pilot->steered = pilot->time;
        satid_core_steer(&pilot->readings, &pilot->belief, &pilot->task, &pilot->work, dt);
        for (int k = 0; k < SATID_WHEELS; k++) {
            good = good && fabs(pilot->work.torque[k]) <= pilot->task.torque_max[k];
        }
    } else {
        memset(pilot->work.torque, 0, sizeof pilot->work.torque);
        satid_core_let_go(&pilot->task);
    }
    if (!good) {
        memset(pilot->work.torque, 0, sizeof pilot->work.torque);
        pilot->status.flags |= SATID_NO_TORQUE;
    }
    memcpy(pilot->torque, pilot->work.torque, sizeof pilot->torque);
#else
    (void)pilot;
    (void)told;
#endif
}

/* Take the attitude that `satid_see` was given for these readings, if it is good, and no other later. */
static void take_attitude(satid_pilot *pilot)
{
#if SATID_TRACKER
    const int found = pilot->seen_attitude ? judge_attitude(pilot->readings.tracker.reading) : MISSING;
    count(&pilot->status, found == REFUSED ? REFUSED : GOOD, 0, SATID_ATTITUDE_REFUSED);
    pilot->readings.tracker.fresh = found == GOOD ? 1 : 0;
    pilot->seen_attitude = 0;
#else
    (void)pilot;
#endif
}

static void monitor(satid_pilot *pilot)
{
    satid_report *report = &pilot->report;
    satid_status *status = &pilot->status;
    satid_core_note_peaks(&pilot->readings, &pilot->belief, report);
    satid_core_tell(&pilot->belief, report);
    for (int i = 0; i < 3; i++) {
        status->rate_max = fmax(status->rate_max, report->peak_rate[i] / SATID_RATE_LIMIT);
    }
    status->bend_max = report->peak_bend;
    status->nis_mean = report->nis_mean;
    status->colour = report->colour;
    status->flags |= report->unmodelled != 0 ? SATID_UNMODELLED : 0;
}

/* Give the filter what is there; across a gap it takes as many steps as samples are missing. */
static void update(satid_pilot *pilot, double time, const double *gyro, const double *wheel_speed)
{
    double dt = time - pilot->time;
    const double samples = rint(dt / SATID_SAMPLE_PERIOD);
    const int32_t steps = samples < 1.0 ? 1 : (int32_t)samples;
    memcpy(pilot->readings.tachometer, wheel_speed, sizeof pilot->readings.tachometer);
    pilot->readings.gyro_flagged = gyro == NULL ? 1 : 0;
    if (gyro != NULL) {
        memcpy(pilot->readings.gyro, gyro, sizeof pilot->readings.gyro);
        pilot->heard = time;
    }
    if (fabs(dt - steps * SATID_SAMPLE_PERIOD) < SAME * SATID_SAMPLE_PERIOD) {
        dt = steps * SATID_SAMPLE_PERIOD;
    }
    if (steps > 1) {
        satid_core_cross_gap(&pilot->belief, &pilot->task, dt);
    }
    pilot->belief.substeps = SATID_SUBSTEPS * steps;
    pilot->belief.rejected = 0;
    pilot->status.nis = satid_core_take(&pilot->readings, &pilot->belief, &pilot->task, &pilot->work, dt, pilot->observation);
    pilot->belief.substeps = SATID_SUBSTEPS;
    pilot->status.rejected += (uint32_t)pilot->belief.rejected;
    pilot->status.flags |= pilot->belief.rejected > 0 ? SATID_REJECTED : 0;
    pilot->time = time;
    monitor(pilot);
}

/* End the flight at the horizon, and coast where the filter is blind or lost. */
static void look_after(satid_pilot *pilot, double time)
{
    const double rest[SATID_ACTIONS] = {0.0};
    if (pilot->decided + due_at(pilot, time) > SATID_DECISIONS) {
        hold(pilot, rest);
        pilot->status.state = SATID_OVER;
    } else if (is_lost(pilot)) {
        coast(pilot, SATID_LOST);
    } else if (time - pilot->heard > SATID_PATIENCE) {
        coast(pilot, SATID_BLIND);
    }
}

/* Whether the readings of a stamp are left out: it has passed, or is so far ahead that the next has to confirm it, which
   is further on by no more than this one was ahead. */
static bool is_wrong(satid_pilot *pilot, double time)
{
    const double since = time - pilot->seen, further = time - pilot->ahead, slack = SAME * SATID_SAMPLE_PERIOD;
    satid_status *status = &pilot->status;
    pilot->passed++;
    if (!isfinite(time) || since < -slack) {
        status->late++;
        status->flags |= SATID_LATE;
        return true;
    }
    if (since < slack) {
        status->repeated++;
        status->flags |= SATID_REPEATED;
        return true;
    }
    if (since > pilot->usual + slack) {
        if (!(further >= slack && further <= pilot->ahead - pilot->seen + slack)) {
            status->ahead++;
            status->flags |= SATID_AHEAD;
            pilot->ahead = time;
            return true;
        }
        pilot->usual = fmax(pilot->usual, further);
    }
    pilot->seen = time;
    pilot->ahead = -INFINITY;
    pilot->passed = 0;
    return false;
}

void satid_start(satid_pilot *pilot, double time, const double gyro[3], const double wheel_speed[SATID_WHEELS],
                 double torque[SATID_WHEELS])
{
#if SATID_TRACKER
    const satid_readings given = pilot->readings;
    const int32_t seen = pilot->seen_attitude;
    const double sun[3] = {pilot->sun[0], pilot->sun[1], pilot->sun[2]};
#endif
    memset(pilot, 0, sizeof *pilot);
    pilot->belief = satid_first_belief;
    pilot->task = satid_first_task;
    memset(torque, 0, sizeof pilot->torque);
#if SATID_TRACKER
    pilot->readings.tracker = given.tracker;
    pilot->seen_attitude = seen;
    satid_set_sun(pilot, sun);
#endif
    take_attitude(pilot);
    {
        const int of_gyro = judge_gyro(gyro);
        const int of_wheels = judge(wheel_speed, SATID_WHEELS, pilot->task.wheel_speed_max, SPEED_MAX);
        count(&pilot->status, of_gyro, SATID_NO_GYRO, SATID_GYRO_REFUSED);
        count(&pilot->status, of_wheels, SATID_NO_WHEELS, SATID_WHEELS_REFUSED);
        if (of_gyro != GOOD || of_wheels != GOOD || !isfinite(time)) {
            return;
        }
    }
    pilot->begun = pilot->time = pilot->seen = pilot->heard = pilot->steered = time;
    pilot->ahead = -INFINITY;
    pilot->usual = fmax(SATID_PATIENCE, USUAL_SAMPLES * SATID_SAMPLE_PERIOD);
    memcpy(pilot->readings.gyro, gyro, sizeof pilot->readings.gyro);
    memcpy(pilot->readings.tachometer, wheel_speed, sizeof pilot->readings.tachometer);
    pilot->status.state = SATID_FLYING;
    pilot->status.nis_mean = 1.0;
    satid_policy_reset(&pilot->policy);
    satid_core_begin(&pilot->readings, &pilot->belief, &pilot->task, &pilot->work, pilot->observation);
    if (is_lost(pilot)) {
        coast(pilot, SATID_LOST);
    } else {
        decide(pilot, 1);
    }
    steer(pilot, true);
    memcpy(torque, pilot->torque, sizeof pilot->torque);
}

void satid_step(satid_pilot *pilot, double time, const double *gyro, const double *wheel_speed,
                double torque[SATID_WHEELS])
{
    satid_status *status = &pilot->status;
    int of_gyro, of_wheels;
    int32_t due;
    if (status->state == SATID_WAITING) {
        const satid_status before = *status; /* it counts on while it waits */
        satid_start(pilot, time, gyro, wheel_speed, torque);
        status->missing += before.missing;
        status->refused += before.refused;
        return;
    }
    of_gyro = judge_gyro(gyro);
    of_wheels = judge(wheel_speed, SATID_WHEELS, pilot->task.wheel_speed_max, SPEED_MAX);
    status->flags = 0;
    count(status, of_gyro, SATID_NO_GYRO, SATID_GYRO_REFUSED);
    count(status, of_wheels, SATID_NO_WHEELS, SATID_WHEELS_REFUSED);
    take_attitude(pilot);
    if (is_wrong(pilot, time)) {
        if (pilot->passed * SATID_SAMPLE_PERIOD > SATID_PATIENCE && status->state != SATID_OVER) {
            coast(pilot, SATID_STALE);
            steer(pilot, false);
        }
        memcpy(torque, pilot->torque, sizeof pilot->torque);
        return;
    }
    due = due_at(pilot, time);
    if (of_wheels == GOOD && (time - pilot->time) / SATID_SAMPLE_PERIOD < (double)STEPS_MAX) {
        const int32_t decision = pilot->decided + (due > 1 ? due : 1) - 1;
        pilot->task.decision = decision < SATID_DECISIONS ? decision : SATID_DECISIONS;
        update(pilot, time, of_gyro == GOOD ? gyro : NULL, wheel_speed);
    }
    look_after(pilot, time);
    if (due > 0 && status->state != SATID_OVER) {
        if (of_wheels != GOOD) {
            coast(pilot, SATID_UNDECIDED);
        } else if (time - pilot->heard <= SATID_PATIENCE && !is_lost(pilot)) {
            decide(pilot, due);
        }
    }
    steer(pilot, of_wheels == GOOD);
    memcpy(torque, pilot->torque, sizeof pilot->torque);
}

void satid_estimate(const satid_pilot *pilot, double theta[SATID_PARAMETERS], double std[SATID_PARAMETERS])
{
    for (int k = 0; k < SATID_PARAMETERS; k++) {
        theta[k] = pilot->belief.mean[3 + k];
        std[k] = sqrt(pilot->belief.covariance[3 + k][3 + k] + SATID_SCALE_VARIANCE * theta[k] * theta[k]);
    }
}
