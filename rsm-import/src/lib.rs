//! Converts records of other tools to records that `rsm` reads.
//!
//! In: the bytes of one or more files (tables in any usual encoding and separator, MDF and MAT files) and the user's options for their columns. Out:
//! one table with units at a constant period, and notes in words about every conversion; or every fault. A value that is not interpolated keeps its
//! bits. Units, times and offsets come from the files or from the user. If the program estimates one of them, a note reports it.
//!
//! ```
//! use rsm_import::{File, Wishes, import};
//!
//! let log = "Zeit [ms];Drehzahl [U/min]\n0,0;955,0\n1,0;955,5\n2,3;956,0\n3,1;956,5\n";
//! let file = File { name: "log.csv".into(), bytes: log.as_bytes().to_vec() };
//! let wishes = Wishes { columns: vec!["speed=Drehzahl".parse().unwrap()], ..Wishes::default() };
//! let record = import(&[file], &wishes).unwrap();
//! assert_eq!(record.columns[0].name, "speed");
//! assert_eq!(record.rows(), 4);
//! assert!(record.notes.iter().any(|note| note.contains("jitter")));
//! ```

// Only what a user of the library needs is public.
#![cfg_attr(not(test), warn(unreachable_pub))]

mod align;
mod clock;
mod decode;
mod format;
mod log;
mod mat;
mod mat73;
mod mdf;
mod record;
mod resample;
mod sheet;
mod wishes;

pub use align::Alignment;
pub use record::{Column, File, Record, import};
pub use wishes::{Named, Wishes};

/// The examples of the README run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
