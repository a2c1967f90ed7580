/* Replays recorded readings, and compares torque and estimate with what Python made of them. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "satid_pilot.h"

#define SKY (4 * SATID_TRACKER)
#define COLUMNS (4 + SKY + 2 * SATID_WHEELS + 2 * SATID_PARAMETERS) /* of vectors.csv */
#define LINE_MAX 4096
#define TOLERANCE 1e-6

#ifdef SATID_COUNTING
unsigned long satid_operations = 0;
#endif

static satid_pilot pilot;

/* 1: a row; 0: there is none left; -1: it is damaged. */
static int read_row(FILE *file, double row[COLUMNS])
{
    char line[LINE_MAX], *at = line;
    if (fgets(line, sizeof line, file) == NULL) {
        return 0;
    }
    for (int k = 0; k < COLUMNS; k++) {
        char *end;
        row[k] = strtod(at, &end);
        if (end == at) {
            return -1;
        }
        at = *end == ',' ? end + 1 : end;
    }
    return 1;
}

/* what is not a number is as far off as can be */
static double number(double x)
{
    return isnan(x) ? INFINITY : x;
}

int main(int count, char **words)
{
    const char *name = count > 1 ? words[1] : "vectors.csv";
    double row[COLUMNS], torque[SATID_WHEELS], theta[SATID_PARAMETERS], std[SATID_PARAMETERS];
    const double *speed = row + 4, *expected = speed + SATID_WHEELS + SKY, *estimate = expected + SATID_WHEELS;
    double worst_torque = 0.0, worst_theta = 0.0, worst_std = 0.0, seconds = 0.0;
    char head[LINE_MAX];
    long rows = 0;
    int found;
#ifdef SATID_COUNTING
    unsigned long most = 0;
#endif
    FILE *file = fopen(name, "r");
    if (file == NULL || fgets(head, sizeof head, file) == NULL) {
        fprintf(stderr, "cannot read %s: give the file of test vectors\n", name);
        return 2;
    }
    while ((found = read_row(file, row)) > 0) {
        const clock_t begun = clock();
#ifdef SATID_COUNTING
        const unsigned long before = satid_operations;
#endif
#if SATID_TRACKER
        satid_see(&pilot, speed + SATID_WHEELS);
#endif
        if (rows == 0) {
            satid_start(&pilot, row[0], row + 1, speed, torque);
        } else {
            satid_step(&pilot, row[0], row + 1, speed, torque);
        }
#ifdef SATID_COUNTING
        most = satid_operations - before > most ? satid_operations - before : most;
#endif
        seconds += (double)(clock() - begun) / CLOCKS_PER_SEC;
        satid_estimate(&pilot, theta, std);
        for (int k = 0; k < SATID_WHEELS; k++) {
            const double off = number(fabs(torque[k] - expected[k]) / pilot.task.torque_max[k]);
            worst_torque = fmax(worst_torque, off);
        }
        for (int k = 0; k < SATID_PARAMETERS; k++) {
            const double off = number(fabs(theta[k] - estimate[k]) / pilot.belief.theta_scale[k]);
            const double of_std = number(fabs(std[k] / estimate[SATID_PARAMETERS + k] - 1.0));
            worst_theta = fmax(worst_theta, off);
            worst_std = fmax(worst_std, of_std);
        }
        rows++;
    }
    fclose(file);
    if (found < 0) {
        fprintf(stderr, "row %ld of %s is damaged: export again\n", rows + 1, name);
        return 2;
    }
    printf("%ld readings: torque differs by at most %.1e of its limit, theta by %.1e of its scale, its std by %.1e\n", rows,
           worst_torque, worst_theta, worst_std);
    printf("%.2f us a reading, %u bytes of state\n", 1e6 * seconds / (double)(rows > 0 ? rows : 1), (unsigned)sizeof pilot);
#ifdef SATID_COUNTING
    printf("%lu operations a reading, at most %lu\n", satid_operations / (unsigned long)(rows > 0 ? rows : 1), most);
#endif
    if (rows == 0 || !(worst_torque <= TOLERANCE && worst_theta <= TOLERANCE && worst_std <= TOLERANCE)) {
        fprintf(stderr, "more than %.0e: this is not the flight that Python flew\n", TOLERANCE);
        return 1;
    }
    return 0;
}
