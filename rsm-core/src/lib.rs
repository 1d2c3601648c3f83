//! rsm-core
pub mod basis;
pub mod model;
pub mod number;
pub mod run;
pub mod source;
pub mod tape;
pub mod toml_reader;
