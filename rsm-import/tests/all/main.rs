//! Files of other tools, read from outside the crate.

mod mat;
mod two_loggers;
