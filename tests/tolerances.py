"""Errors of gyro and wheels of all kinds, which tests share, for each set of kinds has a filter to compile."""

ALL = {
    "gyro_bias": 1e-4,
    "gyro_scale": 1e-3,
    "gyro_alignment": 1e-3,
    "wheel_inertia": 2e-3,
    "wheel_alignment": 1e-3,
}
