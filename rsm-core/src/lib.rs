//! rsm-core
pub mod basis;
pub mod bernstein;
pub mod certificate;
pub mod check;
pub mod exact;
pub mod interval;
pub mod lower;
pub mod model;
pub mod model_file;
pub mod names;
pub mod number;
pub mod rounding;
pub mod run;
pub mod source;
pub mod tape;
pub mod toml_reader;
