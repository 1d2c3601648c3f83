//! What the target loops promise beyond their answers: they cannot panic, and they are quick.

mod campaign;
mod clock;
mod object_code;
mod plants;
