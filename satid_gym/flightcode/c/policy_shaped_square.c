/* Square waves of body rate whose reversals spare the modes; see satid_gym.policies.shaped_square and
   satid_gym.control.mode_shaping. */
#include "satid_policy.h"

#include <string.h>

#include "command.h"

#define PI 3.141592653589793
#define BOUND 10.0          /* of what is observed */
#define SLACK (1.0 + 1e-9)  /* however the limit is rounded */
#define LARGE 1e6           /* cost of what does not spare a mode */
#define TINY 1e-12          /* of a length, so that none is divided by 0 */
#define FARTHEST 100.0      /* of a bisection */
#define HALVINGS 45
#define CHANGE_MAX (2.0 * sqrt(3.0))
#define SIDE 41             /* choices of a change of rate, of each kind */

static const double MOMENTS[3] = SATID_MOMENTS; /* kg m^2, of the prior */

static double clip(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x; /* NaN stays, and is seen */
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void read_coupling(const float *observation, const float *mode, double d[3])
{
    for (int i = 0; i < 3; i++) {
        const double moment = MOMENTS[i] * (1.0 + (double)observation[SATID_AT_INERTIA + i]);
        d[i] = (double)mode[SATID_MODE_COUPLING + i] * sqrt(fmax(moment, 0.0));
    }
}

/* Deflection to which a rotation pulls the mode, were it as quick as is estimated. */
static double pull_of(const float *mode, const double rate[3])
{
    const float *k = mode + SATID_MODE_CENTRIFUGAL;
    const double x = rate[0], y = rate[1], z = rate[2];
    return (double)k[0] * x * x + (double)k[1] * y * y + (double)k[2] * z * z
           + 2.0 * ((double)k[3] * x * y + (double)k[4] * x * z + (double)k[5] * y * z);
}

/* Change of the rate along d nearest to the wanted one that spares the mode; the largest that does of one at rest. */
static double spare(const float *mode, double nominal, double growth, double wanted, double pull, double *most)
{
    const double slower = fmax(exp(-SATID_CAUTION * pow(10.0, (double)mode[SATID_MODE_FREQUENCY_STD] - 2.0)), TINY);
    const double turned = 2.0 * PI * (double)mode[SATID_MODE_FREQUENCY] * slower, pulled = pull / (slower * slower);
    const double limited = (double)mode[SATID_MODE_DEFLECTION_LIMIT];
    const double given = limited > 0.0 && limited < BOUND ? limited : (double)INFINITY;
    const double bent = fmax(growth * nominal / (turned * turned), TINY), limit = SATID_SHARE * given;
    const double reach = fmin(given / bent, CHANGE_MAX);
    const double x = (double)mode[SATID_MODE_DEFLECTION] - pulled;
    const double y = (double)mode[SATID_MODE_DEFLECTION_RATE] * nominal / turned;
    double best = 0.0, least = INFINITY;
    *most = fmin(0.5 * limit / bent, CHANGE_MAX);
    for (int i = 0; i < 2 * SIDE + 1; i++) {
        const double share = i % SIDE == SIDE - 1 ? 1.0 : -1.0 + (i % SIDE) * 0.05;
        const double choice = i < SIDE ? 2.0 * *most * share : i < 2 * SIDE ? reach * share : clip(wanted, -reach, reach);
        const double centre = -choice * bent, out = x - centre;
        const bool spared = hypot(out, y) + fabs(centre) <= SLACK * limit - fabs(pulled);
        const double real = centre + out * cos(turned) + y * sin(turned), imaginary = y * cos(turned) - out * sin(turned);
        const double cost = spared ? fabs(choice - wanted) : LARGE + hypot(real, imaginary);
        if (cost < least) {
            least = cost;
            best = choice;
        }
    }
    return best;
}

/* Nearest to a change of those within bounds that are `given` along a direction, or come nearest to it. */
static void turn_to(double given, const double direction[3], double change[3], const double low[3], const double high[3])
{
    double least = -FARTHEST, most = FARTHEST;
    for (int h = 0; h < HALVINGS; h++) {
        const double middle = 0.5 * (least + most);
        double found = 0.0;
        for (int i = 0; i < 3; i++) {
            found += direction[i] * clip(change[i] + middle * direction[i], low[i], high[i]);
        }
        if (found < given) {
            least = middle;
        } else {
            most = middle;
        }
    }
    for (int i = 0; i < 3; i++) {
        change[i] = clip(change[i] + most * direction[i], low[i], high[i]);
    }
}

void satid_policy_reset(satid_policy *policy)
{
    memset(policy, 0, sizeof *policy);
    for (int i = 0; i < 3; i++) {
        policy->phase[i] = 0.5 * SATID_DECISION_PERIOD / SATID_PERIOD + i / 3.0;
    }
}

void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS])
{
    double wave[3], change[3], low[3], high[3], slowest[3];
    for (int i = 0; i < 3; i++) {
        const double side = fmod(policy->phase[i], 1.0) < 0.5 ? 1.0 : -1.0;
        wave[i] = SATID_AMPLITUDE * side;
        change[i] = wave[i] - policy->reference[i];
        low[i] = -1.0 - policy->reference[i];
        high[i] = 1.0 - policy->reference[i];
        slowest[i] = INFINITY;
    }
    for (int m = 0; m < SATID_MODES; m++) {
        const float *mode = observation + SATID_AT_MODES + SATID_MODE_PARTS * m;
        double d[3], size, given, most;
        read_coupling(observation, mode, d);
        size = sqrt(dot(d, d));
        if (policy->begun == 0) { /* the first observation is that of the data sheet */
            policy->nominal[m] = 2.0 * PI * (double)mode[SATID_MODE_FREQUENCY];
            policy->size[m] = size;
        }
        for (int i = 0; i < 3; i++) {
            d[i] /= fmax(size, TINY);
        }
        given = spare(mode, policy->nominal[m], size / fmax(policy->size[m], TINY), dot(d, change), pull_of(mode, wave),
                      &most);
        turn_to(given, d, change, low, high);
        for (int i = 0; i < 3; i++) {
            slowest[i] = fmin(slowest[i], most / fmax(fabs(d[i]), TINY));
        }
    }
    policy->begun = 1;
    for (int i = 0; i < 3; i++) {
        policy->reference[i] += clip(change[i], low[i], high[i]);
        policy->phase[i] += 1.0 / fmax(SATID_PERIOD / SATID_DECISION_PERIOD,
                                       4.0 * SATID_AMPLITUDE * (1.0 + SATID_DWELL) / slowest[i]);
    }
    satid_command(observation, policy->reference, action);
}
