//! A static that one context owns.

use core::cell::UnsafeCell;

/// A value that one context owns: an interrupt, or `main` while no interrupt is enabled.
#[derive(Debug)]
pub struct Own<T>(UnsafeCell<T>);

// SAFETY: `of` is called from one context at a time only.
unsafe impl<T> Sync for Own<T> {}

impl<T> Own<T> {
    /// A static with its first value.
    pub const fn new(value: T) -> Self {
        Own(UnsafeCell::new(value))
    }

    /// The value.
    ///
    /// # Safety
    /// The caller is in the context that owns the value, and has no other reference to it.
    #[allow(clippy::mut_from_ref)]
    pub unsafe fn of(&self) -> &mut T {
        // SAFETY: see above.
        unsafe { &mut *self.0.get() }
    }
}
