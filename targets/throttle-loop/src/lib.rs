//! The step of a drive-by-wire throttle that damps driveline shuffle.
