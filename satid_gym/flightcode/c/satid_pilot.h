/* Pilot: filter, policy and rate loop for one satellite. All state is in the caller's satid_pilot; nothing is allocated.
   Begin with a struct of zeros. Units are SI, vectors in the body frame. */
#ifndef SATID_PILOT_H
#define SATID_PILOT_H

#include "satid_core.h"
#include "satid_policy.h"

typedef enum {
    SATID_WAITING,  /* for the first good readings; no torque */
    SATID_FLYING,
    SATID_COASTING, /* no torque, for want of readings or of a filter that can be trusted */
    SATID_OVER      /* no torque, after the horizon */
} satid_state;

/* what was wrong in the last step, in satid_status.flags */
enum {
    SATID_NO_GYRO = 1,
    SATID_NO_WHEELS = 2,
    SATID_GYRO_REFUSED = 4,    /* not finite, or beyond any limit: a wrong unit or a fault */
    SATID_WHEELS_REFUSED = 8,
    SATID_REPEATED = 16,       /* a stamp that was there before; the readings were ignored */
    SATID_LATE = 32,           /* a stamp before the last, or none that is a number; likewise */
    SATID_BLIND = 64,          /* no gyro for longer than SATID_PATIENCE */
    SATID_UNDECIDED = 128,     /* a decision is due and there are no wheel speeds */
    SATID_LOST = 256,          /* the filter broke down: start again */
    SATID_NO_ACTION = 512,     /* the policy gave no number */
    SATID_NO_TORQUE = 1024,    /* the rate loop gave no number */
    SATID_STALE = 2048,        /* stamps have been wrong for longer than SATID_PATIENCE: start again */
    SATID_UNMODELLED = 4096,   /* the innovations are not those of a consistent filter */
    SATID_ATTITUDE_REFUSED = 8192, /* not finite, or no quaternion of length 1 */
    SATID_AHEAD = 16384,       /* a stamp far ahead, ignored until the next confirms it */
    SATID_REJECTED = 32768     /* a reading that the filter's gate rejects */
};

typedef struct {
    satid_state state;
    uint32_t flags;
    uint32_t missing, refused, rejected, repeated, late, ahead; /* readings */
    uint32_t missed;                           /* decisions that passed altogether */
    double nis;         /* normalised innovation squared of the last update, per degree of freedom; 0 without one */
    double nis_mean;    /* its running mean: 1 of a consistent filter */
    double colour;      /* of the innovations, over its limit */
    double rate_max;    /* largest body rate so far, over its limit */
    double bend_max;    /* largest deflection of panels and slosh so far, over its limit */
} satid_status;

typedef struct {
    satid_status status;
    double torque[SATID_WHEELS]; /* commanded, N m */
    double begun, time, seen, heard, steered; /* s: start; last update, stamp, gyro reading, and torque of the rate loop */
    double ahead;    /* s: stamp that the next has to confirm; -INFINITY: none */
    double usual;    /* s, by which readings may be apart */
    int32_t decided; /* decisions */
    uint32_t passed; /* stamps in a row that were wrong */
#if SATID_TRACKER
    int32_t seen_attitude; /* 1: one was given for the readings to come */
    double sun[3];
#endif
    satid_belief belief;
    satid_task task;
    satid_readings readings;
    satid_report report;
    satid_work work;
    satid_policy policy;
    float observation[1][SATID_OBSERVATION];
} satid_pilot;

/* Begin a flight, or begin again; the torque is to be commanded until the next call. Readings that are not good leave
   it waiting, and satid_step then begins with the first that are. */
void satid_start(satid_pilot *pilot, double time, const double gyro[3], const double wheel_speed[SATID_WHEELS],
                 double torque[SATID_WHEELS]);

/* Take in the readings of one instant, s, rad/s; a null pointer or all NAN is a missing reading. What is commanded is
   always finite and within the motors' limits. */
void satid_step(satid_pilot *pilot, double time, const double *gyro, const double *wheel_speed,
                double torque[SATID_WHEELS]);

#if SATID_TRACKER
/* Give a new reading of the star tracker, a quaternion from body to inertial, scalar last, before the start or step of
   the same instant, which takes it; a null pointer or all NAN is none. One that is refused is left out, at the start
   too. */
void satid_see(satid_pilot *pilot, const double *attitude);

/* Direction of the Sun, inertial frame, of any length, for a policy that observes it; it is kept when a flight begins
   again. Until it is given, or if it is no direction, (0, 0, 0) is observed. */
void satid_set_sun(satid_pilot *pilot, const double sun[3]);
#endif

/* Estimate of the inertia Jxx, Jyy, Jzz and, of the full tensor, Jxy, Jxz, Jyz, with standard deviations, kg m^2. */
void satid_estimate(const satid_pilot *pilot, double theta[SATID_PARAMETERS], double std[SATID_PARAMETERS]);

#endif
