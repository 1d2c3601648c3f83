//! Bodies and joints with the effects that are possible on them.
//!
//! In: numbers of effects, and the data of a body from the equations of a plant. Out: its acceleration. Formulas: docs/book/src/reference/plants.md,
//! sections 3 and 4.5.

use super::{Site, SiteKind, Slots, TIME, Truth};
use crate::flow::State;

/// The part behind a spring, with a share of the inertia.
#[derive(Debug, Clone)]
struct Far {
    ratio: f64,
    stiffness: f64,
    damping: f64,
    position: usize,
    speed: usize,
}

/// A rotation or a translation.
#[derive(Debug, Clone)]
pub struct Body {
    /// The speed below which the sign of a friction is smoothed.
    width: f64,
    coulomb: f64,
    asymmetric: Option<[f64; 2]>,
    viscous: [Option<f64>; 2],
    stribeck: Option<[f64; 3]>,
    square: f64,
    load: f64,
    load_rate: f64,
    wave: [f64; 3],
    imbalance: [f64; 2],
    spring: [f64; 2],
    ripple: f64,
    far: Option<Far>,
}

/// A body at an instant, before the effects.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// Position.
    pub position: f64,
    /// Speed.
    pub speed: f64,
    /// The inertia of the site, which an effect may split.
    pub inertia: f64,
    /// The inertia that rotates with it rigidly.
    pub beside: f64,
    /// The sum of efforts, without the load.
    pub effort: f64,
    /// A load against forward motion.
    pub load: f64,
    /// The viscous friction of the equations.
    pub viscous: f64,
    /// The effort of the drive.
    pub drive: f64,
}

impl Body {
    /// The body at a site.
    pub fn new(truth: &Truth, site: &Site, slots: &mut Slots) -> Self {
        let of = |kind: &str, number: &str| truth.effect(site.name, kind, number);
        let or = |kind: &str, number: &str| truth.or(site.name, kind, number, 0.0);
        let turns = site.kind == SiteKind::Rotation;
        let (load, rate) = if turns { ("torque", "torque_rate") } else { ("force", "force_rate") };
        let around = if turns {
            or("cogging-torque", "cycles")
        } else {
            std::f64::consts::TAU / truth.or(site.name, "cogging-torque", "pitch", 1.0)
        };
        let far = of("shaft-compliance", "inertia_ratio").map(|ratio| Far {
            ratio,
            stiffness: or("shaft-compliance", "stiffness"),
            damping: or("shaft-compliance", "damping"),
            position: slots.take(),
            speed: slots.take(),
        });
        Body {
            width: if turns { 1.0 } else { 1e-3 },
            coulomb: or("coulomb-friction", load),
            asymmetric: of("asymmetric-friction", "forward").map(|forward| [forward, or("asymmetric-friction", "backward")]),
            viscous: [of("asymmetric-friction", "viscous_forward"), of("asymmetric-friction", "viscous_backward")],
            stribeck: of("stribeck-friction", "coulomb")
                .map(|coulomb| [coulomb, or("stribeck-friction", "static"), or("stribeck-friction", "stribeck_velocity")]),
            square: or("quadratic-drag", "coefficient") + or("windage", "coefficient"),
            load: or("constant-load", load),
            load_rate: or("load-drift", rate),
            wave: [or("cogging-torque", "amplitude"), around, or("cogging-torque", "phase")],
            imbalance: [or("imbalance", "amplitude"), or("imbalance", "phase")],
            spring: [or("static-load-spring", "stiffness"), or("static-load-spring", "rest")],
            ripple: or("combustion-ripple", "amplitude"),
            far,
        }
    }

    /// The split-off part starts together with the body.
    pub fn start(&self, position: f64, speed: f64, y: &mut State) {
        if let Some(far) = &self.far {
            y[far.position] = position;
            y[far.speed] = speed;
        }
    }

    fn friction(&self, v: f64, nominal: f64) -> f64 {
        let sign = (v / self.width).tanh();
        let mut sum = self.coulomb * sign + self.square * v * v.abs();
        if let Some([coulomb, at_rest, velocity]) = self.stribeck {
            sum += (coulomb + (at_rest - coulomb) * (-(v / velocity).powi(2)).exp()) * sign;
        }
        if let Some(levels) = self.asymmetric {
            let way = usize::from(v < 0.0);
            sum += levels[way] * sign + (self.viscous[way].unwrap_or(nominal) - nominal) * v;
        }
        sum
    }

    /// The acceleration. Also writes the rates of the split-off part.
    pub fn acceleration(&self, motion: &Motion, y: &State, dy: &mut State) -> f64 {
        let Motion { position, speed, inertia, beside, .. } = *motion;
        let time = y[TIME];
        let load = motion.load + self.load + self.load_rate * time;
        let mut effort = motion.effort - self.friction(speed, motion.viscous);
        effort += self.wave[0] * (self.wave[1] * position + self.wave[2]).sin();
        effort += self.imbalance[0] * (position + self.imbalance[1]).sin();
        effort -= self.spring[0] * (position - self.spring[1]);
        effort += self.ripple * motion.drive * (3.0 * position).sin();
        let Some(far) = &self.far else { return (effort - load) / (inertia + beside) };
        let spring = far.stiffness * (position - y[far.position]) + far.damping * (speed - y[far.speed]);
        dy[far.position] = y[far.speed];
        dy[far.speed] = (spring - load) / (far.ratio * inertia);
        (effort - spring) / ((1.0 - far.ratio) * inertia + beside)
    }

    /// The usual magnitudes of the split-off part.
    pub fn scale(&self, site: &Site, scale: &mut State) {
        if let Some(far) = &self.far {
            scale[far.position] = 0.01 * site.position;
            scale[far.speed] = 0.01 * site.speed;
        }
    }
}

/// A spring between two bodies.
#[derive(Debug, Clone)]
pub struct Joint {
    gap: f64,
    cubic: f64,
    capacity: f64,
    /// Level, stiffness and state index of a friction parallel to the spring.
    bristle: Option<(f64, f64, usize)>,
}

impl Joint {
    /// The joint at a site.
    pub fn new(truth: &Truth, site: &Site, slots: &mut Slots) -> Self {
        let of = |kind: &str, number: &str| truth.effect(site.name, kind, number);
        let level = of("hysteresis", "level");
        Joint {
            gap: of("backlash", "gap").unwrap_or(0.0),
            cubic: of("clutch-stiffening", "cubic_stiffness").unwrap_or(0.0),
            capacity: of("clutch-slip", "capacity").unwrap_or(f64::INFINITY),
            bristle: level.map(|level| (level, truth.or(site.name, "hysteresis", "stiffness", 1.0), slots.take())),
        }
    }

    /// 0 in the gap, 1 and 2 on its two sides; 1 without a gap.
    pub fn regime(&self, twist: f64) -> u8 {
        if self.gap == 0.0 || twist > 0.5 * self.gap {
            1
        } else if twist < -0.5 * self.gap {
            2
        } else {
            0
        }
    }

    /// The effort from twist and rate, in a regime. Also writes the rate of the bristle.
    pub fn effort(&self, law: impl Fn(f64, f64) -> f64, twist: f64, rate: f64, regime: u8, y: &State, dy: &mut State) -> f64 {
        let (pressed, damped) = match regime {
            0 => (0.0, 0.0),
            1 => (twist - 0.5 * self.gap, rate),
            _ => (twist + 0.5 * self.gap, rate),
        };
        let mut effort = law(pressed, damped) + self.cubic * twist.powi(3);
        if let Some((level, stiffness, bend)) = self.bristle {
            effort += stiffness * y[bend];
            dy[bend] = rate - stiffness * rate.abs() / level * y[bend];
        }
        effort.clamp(-self.capacity, self.capacity)
    }

    /// The usual magnitudes of its states.
    pub fn scale(&self, site: &Site, scale: &mut State) {
        if let Some((_, _, bend)) = self.bristle {
            scale[bend] = 0.01 * site.position;
        }
    }
}
