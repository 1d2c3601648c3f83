//! What a driveline engineer expects of the step.

mod published;
mod raw;
mod step;
mod wear;
