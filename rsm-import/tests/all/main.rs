//! Files of other tools, read from outside the crate.

mod mat;
mod mdf;
mod two_loggers;
