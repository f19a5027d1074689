//! Computed recordings with known true values, for tests, benchmarks and examples: a walk and a standing trial. The errors of a
//! real sensor can be added: the offsets and the noise of its cells.

mod ellipse;
mod insole;
mod sensor;
mod standing;
mod walk;

pub use ellipse::loaded_frame;
pub use insole::insole;
pub use sensor::add_sensor_errors;
pub use standing::{SyntheticStanding, standing};
pub use walk::{SyntheticWalk, Walk, walk};

/// A linear congruential generator with Knuth's MMIX constants. It is small, and results in the same numbers on every machine.
struct Random(u64);

impl Random {
    /// The next random number, uniformly distributed between `1 - spread` and `1 + spread`.
    fn around_one(&mut self, spread: f64) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let unit = (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        1.0 + spread * (2.0 * unit - 1.0)
    }
}
