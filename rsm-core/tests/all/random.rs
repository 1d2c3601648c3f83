//! Random numbers from a seed.

/// The generator splitmix64 (Steele, Lea, Flood, 2014).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    pub(crate) fn share(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        let share = self.share();
        // Computed with halves, because the width of the range of all numbers exceeds the largest number.
        2.0 * (low / 2.0 * (1.0 - share) + high / 2.0 * share)
    }

    /// Any number, from random bits.
    pub(crate) fn any(&mut self) -> f64 {
        loop {
            let value = f64::from_bits(self.bits());
            if value.is_finite() {
                return value;
            }
        }
    }

    /// A number some units in the last place away.
    pub(crate) fn beside(&mut self, value: f64) -> f64 {
        let steps = self.bits() % 9;
        (0..steps).fold(value, |value, _| if self.0 & 1 == 0 { value.next_up() } else { value.next_down() })
    }
}
