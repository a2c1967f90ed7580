#include "satid_policy.h"

#define PI 3.141592653589793

static const double MOMENTS[3] = SATID_MOMENTS; /* kg m^2, of the prior */

void satid_read_modes(const float *observation, satid_mode_sheet *sheet, satid_modes *modes)
{
    for (int i = 0; i < 3; i++) {
        modes->rate[0][i] = (double)observation[SATID_AT_RATE + i];
        modes->most[0][i] = (double)observation[SATID_AT_CONTROL_AUTHORITY + i] / SATID_STEPS;
    }
    for (int m = 0; m < SATID_MODES; m++) {
        const float *mode = observation + SATID_AT_MODES + SATID_MODE_PARTS * m;
        const double frequency = 2.0 * PI * (double)mode[SATID_MODE_FREQUENCY];
        const double std = pow(10.0, (double)mode[SATID_MODE_FREQUENCY_STD] - SATID_LOG_OFFSET);
        const double slower = fmax(exp(-SATID_CAUTION * std), SATID_TINY);
        const double turned = fmax(frequency * slower, SATID_TINY), limit = (double)mode[SATID_MODE_DEFLECTION_LIMIT];
        double d[3], size = 0.0, own;
        for (int i = 0; i < 3; i++) {
            const double moment = MOMENTS[i] * (1.0 + (double)observation[SATID_AT_INERTIA + i]);
            d[i] = (double)mode[SATID_MODE_COUPLING + i] * sqrt(fmax(moment, 0.0));
            size += d[i] * d[i];
        }
        size = sqrt(size);
        if (sheet->known == 0) {
            sheet->turned[m] = frequency;
            sheet->size[m] = size;
        }
        own = sheet->turned[m] / turned;
        for (int i = 0; i < 3; i++) {
            modes->direction[0][m][i] = d[i] / fmax(size, SATID_TINY);
        }
        modes->swing[0][m][0] = (double)mode[SATID_MODE_DEFLECTION];
        modes->swing[0][m][1] = (double)mode[SATID_MODE_DEFLECTION_RATE] * own;
        modes->bent[0][m] = size / fmax(sheet->size[m], SATID_TINY) * own / turned;
        modes->turn[0][m][0] = cos(turned / SATID_STEPS);
        modes->turn[0][m][1] = sin(turned / SATID_STEPS);
        modes->turned[0][m] = turned;
        modes->limit[0][m] = limit > 0.0 && limit < SATID_BOUND ? limit : (double)INFINITY;
        for (int k = 0; k < 6; k++) {
            modes->pull[0][m][k] = (double)mode[SATID_MODE_CENTRIFUGAL + k] / (slower * slower);
        }
    }
    sheet->known = 1;
}
