//! Further properties of the target loops: they cannot panic, and they are fast.

mod campaign;
mod clock;
mod object_code;
mod plants;
