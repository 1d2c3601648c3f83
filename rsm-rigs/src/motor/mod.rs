//! The drive of a permanent-magnet AC motor in closed loop: controller, inverter, encoder, load, and the plant `pmac` behind them.
//!
//! ```text
//!   torque demand --Controller::references (1 kHz)--> i_d, i_q
//!                                                        |
//!   currents, angle --Controller::duties (PWM rate)------+--> duties --inverter--> voltages --machine (pmac)--> currents, speed, angle
//!                                                                                                   '--encoder--> angle, speed
//! ```
//!
//! In: a plant file of kind `pmac` and the settings of the drive. Out: traces. A controller knows nominal parameters only: what an effect
//! of the plant file changes, it has to find out. Nothing here draws random numbers but from a seed that the caller gives.

pub mod controller;

pub mod park;

pub mod circle_diagram;

pub mod surface;

pub mod current_loop;

pub mod field_oriented;

pub mod inverter;

pub mod encoder;

pub mod machine;
mod rotor;

pub mod noise;

pub mod closed_loop;

pub mod tasks;

pub mod figures;

pub mod limits;
