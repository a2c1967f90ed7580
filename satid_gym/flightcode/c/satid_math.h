/* Arithmetic as the core has it, where C has none or another. */
#ifndef SATID_MATH_H
#define SATID_MATH_H

#include <math.h>
#include <stdint.h>

/* operations of the translated functions, for `satid export --measure` */
#ifdef SATID_COUNTING
extern unsigned long satid_operations;
#define SATID_COUNT(n) (satid_operations += (unsigned long)(n))
static inline double satid_counted(double x)
{
    satid_operations++;
    return x;
}
#else
#define SATID_COUNT(n) ((void)0)
#endif

/* the first of two that compare neither way, so that what is not a number in it stays */
static inline double satid_min(double a, double b)
{
    return b < a ? b : a;
}

static inline double satid_max(double a, double b)
{
    return b > a ? b : a;
}

static inline int satid_min_integer(int a, int b)
{
    return b < a ? b : a;
}

static inline int satid_max_integer(int a, int b)
{
    return b > a ? b : a;
}

static inline double satid_square(double x)
{
    return x * x;
}

static inline double satid_sign(double x)
{
    return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x;
}

/* towards zero, as far as an integer goes; the least one of what is not a number */
static inline int satid_integer(double x)
{
    if (!(x > -2147483647.0)) {
        return INT32_MIN;
    }
    return x < 2147483647.0 ? (int)x : INT32_MAX;
}

/* towards minus infinity */
static inline int satid_floor_divide(int a, int b)
{
    const int quotient = a / b;
    return a % b != 0 && (a % b < 0) != (b < 0) ? quotient - 1 : quotient;
}

static inline int satid_modulo(int a, int b)
{
    return a - b * satid_floor_divide(a, b);
}

#endif
