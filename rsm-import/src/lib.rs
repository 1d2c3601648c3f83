//! Records of other tools, made into records that `rsm` reads.
//!
//! In: the bytes of one file or more (tables in any usual encoding and separator, MAT files) and what the user says of their columns. Out: one table
//! with units at a constant period, and notes in words about everything that was done; or every fault. A value that is not interpolated keeps its
//! bits. Units, times and offsets come from the files or from the user. If the program estimates one of them, the notes say so.
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

// What is public is what a user of the library needs.
#![cfg_attr(not(test), warn(unreachable_pub))]

mod align;
mod clock;
mod decode;
mod format;
mod log;
mod mat;
mod mat73;
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
