//! The 1 kHz step of a permanent-magnet AC motor in flux weakening.
