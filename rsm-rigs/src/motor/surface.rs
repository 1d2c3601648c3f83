//! References from response surfaces: what replaces the circle diagram.
//!
//! In: a model file with the surface `weakening_current` (torque in N m, speed in rad/s, to A) and, if it is to know how much torque there is,
//! `limit_current` (torque, current in A, speed). Out: references. No trigonometry, one square root. The interpreter gives the bits of the
//! emitted evaluators.
//!
//! `limit_current` is the weakening current at which a current vector of a given length meets the voltage limit. At the drive's own limit it leaves
//! i_q at most sqrt(I^2 - i_w^2); a demand beyond is cut there before `weakening_current` is asked.
//!
//! Torque is signed: against the speed the resistive drop helps, so a braking motor needs less weakening. Backwards is forwards in a mirror.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};
use rsm_core::tape::Tape;

use super::controller::{Demand, Known, References};
use super::field_oriented::{FieldOriented, Weakening};

/// The lowered surfaces of a motor's model.
#[derive(Debug, Clone)]
pub struct Surfaces {
    weakening: Tape,
    limit: Option<Tape>,
}

impl Surfaces {
    /// From a checked model.
    ///
    /// # Errors
    /// No surface `weakening_current` of torque and speed; a `limit_current` that is not of torque, current and speed.
    pub fn new(model: &Checked) -> Result<Self, Faults> {
        Ok(Surfaces {
            weakening: weakening_tape(model)?,
            limit: find(model, "limit_current", &["torque", "current", "speed"])?,
        })
    }
}

/// The tape of the surface `weakening_current`.
pub(crate) fn weakening_tape(model: &Checked) -> Result<Tape, Faults> {
    find(model, "weakening_current", &["torque", "speed"])?.ok_or_else(|| {
        let what = format!("model `{}`: there is no surface `weakening_current`", model.model().name);
        Faults::one(Fault::whole_file("model", what))
    })
}

/// The tape of a surface, if there is one of this name; it must have these inputs.
fn find(model: &Checked, name: &str, inputs: &[&str]) -> Result<Option<Tape>, Faults> {
    let Some(index) = model.model().surfaces.iter().position(|surface| surface.name == name) else { return Ok(None) };
    let found = &model.model().surfaces[index].inputs;
    if found != inputs {
        let what = format!("surface `{name}`: found the inputs {}, expected {}", found.join(", "), inputs.join(", "));
        return Err(Faults::one(Fault::whole_file("model", what)));
    }
    Ok(Some(lower::surface(model, index, Precision::F64)))
}

/// References from surfaces.
#[derive(Debug, Clone)]
pub struct SurfaceReferences<'s> {
    known: Known,
    weakening: Interpreter<'s, f64>,
    limit: Option<Interpreter<'s, f64>>,
    /// The torque of the last references, forwards: at which the limit is asked for. It moves the limit by the resistive drop only, so
    /// the difference to this tick's is small and gone with the next.
    last_torque: f64,
}

impl<'s> SurfaceReferences<'s> {
    /// The references of a motor.
    #[must_use]
    pub fn new(known: Known, surfaces: &'s Surfaces) -> Self {
        SurfaceReferences {
            known,
            weakening: Interpreter::new(&surfaces.weakening),
            limit: surfaces.limit.as_ref().map(Interpreter::new),
            last_torque: 0.0,
        }
    }
}

impl Weakening for SurfaceReferences<'_> {
    fn references(&mut self, demand: &Demand) -> References {
        let (mirror, speed) = (1f64.copysign(demand.speed_rad_s), demand.speed_rad_s.abs());
        let (limit, k_t) = (self.known.current_limit, self.known.torque_constant());
        let mut wanted = (mirror * demand.torque_nm / k_t).clamp(-limit, limit);
        if let Some(surface) = &mut self.limit {
            let weakening = surface.eval(&[self.last_torque, limit, speed]).clamp(0.0, limit);
            let most = (limit * limit - weakening * weakening).sqrt();
            wanted = wanted.clamp(-most, most);
        }
        self.last_torque = k_t * wanted;
        let weakening = self.weakening.eval(&[k_t * wanted, speed]).clamp(0.0, limit);
        // What the weakening needs comes first: without it the torque would not be there either.
        let most = (limit * limit - weakening * weakening).sqrt();
        References { i_d_a: -weakening, i_q_a: mirror * wanted.clamp(-most, most) }
    }
}

/// A controller with references from surfaces.
pub type SurfaceController<'s> = FieldOriented<SurfaceReferences<'s>>;

impl<'s> SurfaceController<'s> {
    /// The controller of a motor.
    #[must_use]
    pub fn with_surfaces(known: Known, surfaces: &'s Surfaces) -> Self {
        FieldOriented::new(known, SurfaceReferences::new(known, surfaces))
    }
}
