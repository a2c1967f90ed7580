/* Panels and tanks as observed; see satid_gym.control.observed_modes. */
#ifndef SATID_MODES_H
#define SATID_MODES_H

#include "satid_core.h"

/* What the first observation says of the modes. Begin with zeros. */
typedef struct {
    int32_t known;
    double turned[SATID_MODES > 0 ? SATID_MODES : 1]; /* angle in a decision */
    double size[SATID_MODES > 0 ? SATID_MODES : 1];   /* |d| */
} satid_mode_sheet;

/* Modes with their whole limits; the sheet is filled where nothing is known yet. */
void satid_read_modes(const float *observation, satid_mode_sheet *sheet, satid_modes *modes);

#endif
